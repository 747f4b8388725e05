"""Generalized inverses G of J: pseudoinverse, weighted pseudoinverse, null-space component.

J (m, n) is the Jacobian, J⁺ its pseudoinverse, and r = n − m. An inverse has J G = I, so that
``q̇ = G ẋ`` moves the frame with ẋ. The columns of N (n, r) are an orthonormal basis of the null
space of J; W (m, r) is the null-space component of G: ``G = J⁺ + N Wᵀ``. Numbers in parentheses,
such as (21), are equations of the paper.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from ..base.arguments import Array, as_matrices
from ..base.errors import InputError, SingularityError

RANK_TOLERANCE = 1e-6
"""J has full rank if the sine of the angle between each row and the span of the other rows is above
this."""


def pseudoinverse(J: ArrayLike) -> Array:
    """Evaluate the minimum-norm inverse ``J⁺ = Jᵀ (J Jᵀ)⁻¹``.

    The inverse is computed as ``J⁺ = Q R⁻ᵀ`` from ``Jᵀ = Q R``, which does not square the condition
    number of J.

    Parameters
    ----------
    J : (..., m, n) array
        Jacobians of full row rank, m ≤ n.

    Returns
    -------
    (..., n, m) array

    Raises
    ------
    SingularityError
        If J loses rank.
    """
    Q, R = row_factor(J)
    return Q @ np.swapaxes(np.linalg.inv(R), -1, -2)


def weighted_pseudoinverse(J: ArrayLike, M: ArrayLike) -> Array:
    """Evaluate the inverse ``J⁺_M = M⁻¹ Jᵀ (J M⁻¹ Jᵀ)⁻¹``, which minimises ``q̇ᵀ M q̇``.

    If M is the joint-space inertia, the inverse minimises the kinetic energy.

    Parameters
    ----------
    J : (..., m, n) array
    M : (..., n, n) array
        Symmetric positive definite; broadcast against J.

    Returns
    -------
    (..., n, m) array

    Raises
    ------
    SingularityError
        If J loses rank, or M is not positive definite.
    """
    J, M = as_matrices(("J", J, "m n"), ("M", M, "n n"))
    try:
        L = np.linalg.cholesky(M)  # M = L Lᵀ
    except np.linalg.LinAlgError:
        raise SingularityError(
            "the weight M has an eigenvalue of 0 or below; "
            "give a positive definite M, such as diag(w) with all w > 0"
        ) from None
    # In y = Lᵀ q̇ the weighted norm is the Euclidean one: J⁺_M = L⁻ᵀ (J L⁻ᵀ)⁺.
    L_inv_T = np.swapaxes(np.linalg.inv(L), -1, -2)
    return L_inv_T @ pseudoinverse(J @ L_inv_T)


def pseudoinverse_derivative(J: ArrayLike, H: ArrayLike) -> Array:
    """Evaluate ∂J⁺/∂q, the derivatives of the pseudoinverse with respect to all joints.

    ``∂J⁺/∂q_k = −J⁺ H_k J⁺ + (I − J⁺J) H_kᵀ (J Jᵀ)⁻¹`` with ``H_k = ∂J/∂q_k``. The factor ``(J
    Jᵀ)⁻¹`` is computed as ``J⁺ᵀ J⁺``. This derivative makes the Lie brackets of J⁺, which test
    repeatability, exact.

    Parameters
    ----------
    J : (..., m, n) array
    H : (..., m, n, n) array
        ``H[..., a, i, k] = ∂J[..., a, i]/∂q[k]``.

    Returns
    -------
    (..., n, m, n) array
        ``[..., i, a, k] = ∂J⁺[..., i, a]/∂q[k]``.
    """
    J, H = as_matrices(("J", J, "m n"), ("H", H, "m n n"))
    G = pseudoinverse(J)
    onto_null = np.eye(J.shape[-1]) - G @ J
    Hk = np.moveaxis(H, -1, -3)  # (..., k, m, n)
    G1 = G[..., None, :, :]
    P1 = onto_null[..., None, :, :]
    inverse_gram = np.swapaxes(G1, -1, -2) @ G1  # (J Jᵀ)⁻¹
    dG = -G1 @ Hk @ G1 + P1 @ np.swapaxes(Hk, -1, -2) @ inverse_gram
    return np.moveaxis(dG, -3, -1)


def null_component(G: ArrayLike, N: ArrayLike) -> Array:
    """Evaluate the null-space component ``W = Gᵀ N``, (..., m, r), of an inverse G of J.

    G (..., n, m) is a generalized inverse, and N (..., n, r) is an orthonormal basis of the null
    space of J. Inverses of the same J differ only in W: ``G = J⁺ + N Wᵀ`` (21), (22).
    """
    G, N = as_matrices(("G", G, "n m"), ("N", N, "n r"))
    return np.swapaxes(G, -1, -2) @ N


def from_null_component(J: ArrayLike, N: ArrayLike, W: ArrayLike) -> Array:
    """Build the generalized inverse ``G = J⁺ + N Wᵀ`` (..., n, m) from its component W (21).

    J is (..., m, n), W (..., m, r), and N (..., n, r) an orthonormal basis of the null space of J.
    Each W gives one inverse, and each inverse has one W.
    """
    J, N, W = as_matrices(("J", J, "m n"), ("N", N, "n r"), ("W", W, "m r"))
    return pseudoinverse(J) + N @ np.swapaxes(W, -1, -2)


def inverse_condition_number(J: Array) -> Array:
    """Evaluate the inverse condition number ``σ_min / σ_max`` of J (..., m, n): 0 at rank loss."""
    values = np.linalg.svd(J, compute_uv=False)
    return values[..., -1] / np.maximum(values[..., 0], np.finfo(float).tiny)


def row_factor(
    J: ArrayLike, mode: Literal["reduced", "complete"] = "reduced"
) -> tuple[Array, Array]:
    """Factor ``Jᵀ = Q R`` for J (..., m, n), and check that J has full rank.

    The columns of Q are orthonormal, and R is upper triangular. J⁺ and the null space are both
    computed from this factorisation. With ``mode="complete"``, Q is square, and its last n − m
    columns span the null space of J.

    Returns
    -------
    Q : (..., n, m) array, or (..., n, n) if ``mode="complete"``
    R : (..., m, m) array

    Raises
    ------
    InputError
        If J has more rows than columns.
    SingularityError
        If J loses rank; the message gives the number of rank-deficient matrices in the batch.
    """
    (J,) = as_matrices(("J", J, "m n"))
    m, n = J.shape[-2:]
    if m > n:
        raise InputError(
            f"J is {m} × {n}, with more coordinates than joints, so no G has J G = I; "
            f"control at most {n} coordinates"
        )
    Q, R = np.linalg.qr(np.swapaxes(J, -1, -2), mode="complete")  # half the time of "reduced"
    R = R[..., :m, :]
    Q = Q if mode == "complete" else Q[..., :, :m]
    # |R_jj| / ‖R_:j‖ is the sine of the angle between row j of J and the span of the rows before:
    # independent of the units of the rows.
    diagonal = np.diagonal(R, axis1=-2, axis2=-1)
    size = np.linalg.norm(R, axis=-2)
    lost = ~(np.abs(diagonal) > RANK_TOLERANCE * size).all(axis=-1)
    if np.any(lost):
        where = "" if lost.ndim == 0 else f" at {int(lost.sum())} of {lost.size} configurations"
        raise SingularityError(f"the Jacobian loses rank{where}: the arm is at a singularity")
    return Q, R
