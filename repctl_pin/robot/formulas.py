"""Formulas of a serial chain, arrays in, arrays out: its kinematic Hessian, and the turn between two tool axes."""

from __future__ import annotations

from math import atan2, hypot, pi

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


def axis_turn(R: Array, goal: Array) -> Array:
    """Measure the turn (2,) about the tool's own x and y that takes its z axis to a goal's by the shortest way, rad.

    Parameters
    ----------
    R, goal : (3, 3) arrays
        The tool's orientation, and the goal's.
    """
    x, y, z = R.T.dot(goal[:, 2]).tolist()  # the goal's axis as the tool sees it
    sine = hypot(x, y)
    if sine < 1e-12:  # parallel: nothing to turn; opposite: any way round will do
        return np.array([0.0 if z > 0 else pi, 0.0])
    ratio = atan2(sine, z) / sine
    return np.array([-y * ratio, x * ratio])
