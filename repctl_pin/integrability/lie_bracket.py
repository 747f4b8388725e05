"""Lie brackets of the columns of G, their defects Δ, and the drift predicted from Δ.

The Lie bracket [g_a, g_b] of columns a and b of an inverse G is the joint motion left after a small
loop of the frame along a, b, −a, −b, per area of the loop. Its part in the null space of J, the
defect Δ_ab, is drift: the frame is back at its start, but the configuration is not. G is repeatable
in a region if all its defects are 0 there, the Lie bracket condition (24). Numbers in parentheses,
Corollary 1 and Proposition 1 are those of the paper (docs/notation.md). An inverse G of the
Jacobian J has J G = I; J⁺ is the pseudoinverse. An argument ``strategy`` is the inverse G. Letters:
n joints, m task coordinates.

``_Defects`` are the defects of an inverse at K configurations, which are 0 where it is repeatable.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..base.arguments import Array, flag, read_only, vector
from ..model.length import joint_scale
from ..strategies.strategy import Inverse
from .derivative import derivative, require_inverse


def brackets(G: Array, dG: Array) -> Array:
    """Evaluate the Lie brackets ``[g_a, g_b] = (∂g_b/∂q) g_a − (∂g_a/∂q) g_b`` (4) of G's columns.

    J⁺ can be tested without computing it, because the columns of Jᵀ span the same space
    (Corollary 1): pass Jᵀ as ``G``, and its derivative as ``dG``. The result is then the brackets
    of the columns of Jᵀ.

    Parameters
    ----------
    G : (..., n, m) array
        Inverse, or another matrix with the same column space.
    dG : (..., n, m, n) array
        ``[..., i, a, k] = ∂G[i, a]/∂q[k]``.

    Returns
    -------
    (..., m, m, n) array
        ``[..., a, b, :]`` is [g_a, g_b], antisymmetric in a and b.
    """
    along = np.einsum("...ibk,...ka->...abi", dG, G)  # (∂g_b/∂q) g_a
    return along - np.swapaxes(along, -3, -2)


def defects(J: Array, G: Array, dG: Array) -> Array:
    """Evaluate the defects ``Δ_ab = (I − G J) [g_a, g_b]`` (5), (24): (..., m, m, n).

    ``[..., a, b, :]`` is Δ_ab. Without redundancy, n = m, exact zeros are returned. J (..., m, n)
    is the Jacobian, G (..., n, m) the inverse, and dG (..., n, m, n) the derivative of G by q, with
    the index of q last.
    """
    m, n = J.shape[-2:]
    outside = np.eye(n) - G @ J if n > m else np.zeros((n, n))
    return np.einsum("...ij,...abj->...abi", outside, brackets(G, dG))


@dataclass(frozen=True, eq=False)
@read_only
class _Defects:
    """Defects of an inverse at K configurations, which are 0 where it is repeatable.

    Attributes
    ----------
    delta : (K, m, m, n) array
        Δ_ab, in the joints' units per unit of task coordinate a and of b.
    relative : (K, m, m, n) array
        Relative defects Λ_cd, per rad: the defects of pairs c, d of vectors of an orthonormal basis
        of G's column space. They do not depend on units and task axes, see :func:`measure`.
    error : (K,) array
        Estimated error of :attr:`norm`, per rad, computed from the estimated error of ∂G/∂q.
    exact : bool
        True if ∂G/∂q is computed by a formula, False if by differences.
    J, G : (K, m, n), (K, n, m) arrays
        Jacobian and inverse at these configurations.
    """

    delta: Array
    relative: Array
    error: Array
    exact: bool
    J: Array
    G: Array

    @property
    def norm(self) -> Array:
        """Norm of the relative defects, ``sqrt(Σ_{c<d} ‖Λ_cd‖²)``: (K,).

        The norm is 0 if and only if all defects are 0 at the configuration.
        """
        return np.sqrt(np.sum(self.relative**2, axis=(1, 2, 3)) / 2)


def measure(strategy: Inverse, Q: Array) -> _Defects:
    """Evaluate the defects and the relative defects of an inverse at every row of Q (K, n).

    Relative defects do not depend on the units or the axes of the task. Let L be the diagonal
    matrix of the units of the joints (1 rad, or the arm length for prismatic joints), and ``L⁻¹ G =
    B R`` a QR decomposition. The columns of ``G R⁻¹`` span the column space of G (Proposition 1),
    and have the defects ``Λ_cd = L⁻¹ Σ_ab R⁻¹[a, c] R⁻¹[b, d] Δ_ab``. So Λ_cd is the drift per area
    of a loop whose sides are measured as joint motion, along the basis vectors c and d.
    """
    found = derivative(strategy, Q)
    L = joint_scale(strategy.task, Q[0])
    delta = defects(found.J, found.G, found.dG)
    basis, R = np.linalg.qr(found.G / L[:, None])
    sign = np.sign(np.diagonal(R, axis1=1, axis2=2))[:, None]  # positive diagonal of R: smooth in q
    basis = basis * sign
    R = R * np.swapaxes(sign, 1, 2)
    R_inv = np.linalg.inv(R)
    relative = np.einsum("Kac,Kbd,Kabi->Kcdi", R_inv, R_inv, delta, optimize=True) / L

    # An error e_k of L⁻¹ ∂G/∂q_k moves Λ_cd by at most ‖P‖ √n Σ_k e_k (|Q_kc| ‖R⁻¹_d‖₁ + |Q_kd|
    # ‖R⁻¹_c‖₁).
    n = found.G.shape[1]
    P = (np.eye(n) - found.G @ found.J) * L / L[:, None]
    size = np.linalg.norm(P, 2, axis=(1, 2)) * np.sqrt(n)
    along = np.einsum("Kk,Kkc->Kc", found.error * L, np.abs(basis))
    spread = np.abs(R_inv).sum(axis=1)
    pairs = along[:, :, None] * spread[:, None, :]
    error = size * np.sqrt(np.sum((pairs + np.swapaxes(pairs, 1, 2)) ** 2, axis=(1, 2)) / 2)
    return _Defects(delta, relative, error, found.exact, found.J, found.G)


def bracket_defect(strategy: Inverse, q: ArrayLike, *, relative: bool = False) -> Array:
    """Evaluate the defects ``Δ_ab = (I − G J) [g_a, g_b]`` for all a < b (4), (5), (24).

    Δ_ab is the drift, per area, of a small loop of the frame along the task coordinates a and b. An
    inverse is repeatable in a region if and only if all defects are 0 throughout it. The values are
    exact for J⁺ and for J⁺ with a constant weight (from the kinematic Hessian), and for a
    repeatable inverse whose potentials have second derivatives. Otherwise they are computed by
    extrapolated differences.

    Parameters
    ----------
    strategy
        Any inverse ``q̇ = G(q) ẋ``.
    q : (n,) array
        Configuration, rad (m for prismatic joints).
    relative
        True to return the defects of an orthonormal basis of G's column space instead, per rad,
        which do not depend on units and task axes; the pairs are then pairs of basis vectors.

    Returns
    -------
    (pairs, n) array
        One row Δ_ab per pair, in the order (a, b) = (0, 1), (0, 2), …, (1, 2), …, in the joints'
        units per unit of task coordinate a and of b (rad/m² for two lengths).

    Raises
    ------
    InputError
        If q does not have n numbers.
    SingularityError
        If J, or G, is singular at q.

    Examples
    --------
    >>> rp.bracket_defect(control, q0).shape  # one pair of task coordinates
    (1, 3)
    >>> bool(np.abs(rp.bracket_defect(design.inverse, q0)).max() < 1e-9)
    True
    """
    relative = flag(relative, "relative")
    found = measure(strategy, _as_row(strategy, q))
    a, b = np.triu_indices(strategy.task.m, 1)
    return (found.relative if relative else found.delta)[0, a, b]


def drift_per_area(strategy: Inverse, q: ArrayLike) -> Array:
    """Predict the joint drift per enclosed area of a small closed loop.

    A loop of the frame along the directions a, b, −a and −b, of area A, ends at the configuration
    ``q + A Δ_ab + o(A)``, so ``‖Δ_ab‖`` is the drift per area.

    Parameters
    ----------
    strategy
        Any inverse.
    q : (n,) array
        Configuration of the loop, rad (m for prismatic joints).

    Returns
    -------
    (k, k) array
        Drift per area, rad/m² (m/m² for prismatic joints), for loops in the plane of translations a
        and b; k = 3, or 2 for an ``xy``, ``xz`` or ``yz`` task. 0 on the diagonal.

    Raises
    ------
    InputError
        If q does not have n numbers.
    SingularityError
        If J, or G, is singular at q.

    Examples
    --------
    >>> rp.drift_per_area(control, q0).round(4)  # rad/m²
    array([[0.    , 0.0147],
           [0.0147, 0.    ]])
    """
    k = min(3, require_inverse(strategy).task.m)
    return np.linalg.norm(measure(strategy, _as_row(strategy, q)).delta[0, :k, :k], axis=-1)


def _as_row(strategy: Inverse, q: ArrayLike) -> Array:
    """Check the strategy and a configuration q, and return q as an array (1, n).

    InputError is raised if the strategy is not an inverse, or q does not have n numbers.
    """
    return vector(q, require_inverse(strategy).task.n, "q")[None]
