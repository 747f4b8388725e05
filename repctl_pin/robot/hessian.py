"""The kinematic Hessian of a serial chain, written out from the columns of its Jacobian."""

from __future__ import annotations

import numpy as np

from ..arguments import Array


def chain_hessians(twists: Array, R: Array | None = None) -> Array:
    r"""Differentiate a frame's Jacobian along every joint of a serial chain.

    With columns :math:`J_i = (v_i, \omega_i)` (a prismatic joint has :math:`\omega_i = 0`):

    .. math:: \partial v_i/\partial q_k = \omega_{\min(i,k)} \times v_{\max(i,k)}, \qquad
              \partial \omega_i/\partial q_k = \omega_k \times \omega_i \;\text{ if } k < i
              \text{ else } 0.

    In the frame's own axes, :math:`\partial(R^T\omega_i)/\partial q_k = R^T(\omega_i \times \omega_k)` if
    :math:`k > i`, else 0.

    Parameters
    ----------
    twists : (K, n, 6) array
        The columns J_i of K Jacobians, world axes.
    R : (K, 3, 3) array, optional
        The frame's rotation, where the angular rows are wanted in its own axes.

    Returns
    -------
    (K, 6, n, n) array
        ``[:, a, i, k] = ∂J[a, i]/∂q[k]``.
    """
    K, n = twists.shape[:2]
    v, w = twists[..., :3], twists[..., 3:]
    i, k = np.indices((n, n))
    H = np.zeros((K, 6, n, n))
    H[:, :3] = np.moveaxis(np.cross(w[:, np.minimum(i, k)], v[:, np.maximum(i, k)]), -1, 1)
    turn = np.moveaxis(np.cross(w[:, k], w[:, i]), -1, 1)  # ω_k × ω_i, (K, 3, n, n)
    H[:, 3:] = turn * (k < i) if R is None else -np.einsum("Kba,Kbik->Kaik", R, turn) * (k > i)
    return H
