"""Augmented Jacobian J_V = [J; Vᵀ] (30), (37), its inverse (31), and the leaf margin.

V are the gradients of the r potentials that a repeatable inverse keeps constant. At an algorithmic
singularity J has full rank, but J_V is singular, and the repeatable inverse does not exist. The
leaf margin is the distance from such singularities. Numbers in parentheses are equations of the
paper. J (m, n) is the Jacobian, and V is (n, r) with r = n − m.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..base.arguments import Array, as_matrices
from ..base.errors import InputError, SingularityError
from .inverses import RANK_TOLERANCE

SINGULAR = "J_V is singular: J loses rank, or a gradient V of the potentials is in J's row space"


def augmented_inverse(J: ArrayLike, V: ArrayLike) -> Array:
    """Invert the augmented Jacobian ``J_V = [J; Vᵀ]`` (37).

    The first m columns of the inverse are the repeatable inverse G_r, with ``J G_r = I`` and ``Vᵀ
    G_r = 0``. V are the gradients of the potentials that G_r keeps constant.

    Parameters
    ----------
    J : (..., m, n) array
    V : (..., n, r) array
        Gradients of the potentials.

    Returns
    -------
    (..., n, n) array
        J_V⁻¹.

    Raises
    ------
    SingularityError
        If J_V is singular.
    """
    J, V = as_matrices(("J", J, "m n"), ("V", V, "n r"))
    (m, n), r = J.shape[-2:], V.shape[-1]
    if m + r != n:
        raise InputError(
            f"J_V = [J; Vᵀ] is not square: J is {m} × {n}, and V has {r} columns; "
            f"give V with {n - m} columns, one potential per degree of redundancy"
        )
    J_V = np.empty((*np.broadcast_shapes(J.shape[:-2], V.shape[:-2]), n, n))
    J_V[..., :m, :], J_V[..., m:, :] = J, np.swapaxes(V, -1, -2)
    try:
        inverse = np.linalg.inv(J_V)
    except np.linalg.LinAlgError:
        raise SingularityError(SINGULAR) from None
    regular = is_regular(J_V, inverse)
    if not np.all(regular):
        where = (
            ""
            if np.ndim(regular) == 0
            else f", at {np.sum(~regular)} of {np.size(regular)} configurations"
        )
        raise SingularityError(SINGULAR + where)
    return inverse


def is_regular(A: Array, inverse: Array) -> NDArray[np.bool_]:
    """Test which square matrices are numerically regular, given their inverses.

    In a regular matrix, the sine of the angle between each row and the span of the other rows is
    above 1e-6. For row i it is ``1 / (‖row_i of A‖ ‖column_i of A⁻¹‖)``, which depends neither on
    the units of the rows nor on the scale of a potential.

    Parameters
    ----------
    A, inverse : (..., n, n) arrays
        The matrices and their inverses.

    Returns
    -------
    (...) array of bool
        True where A is regular.
    """
    with np.errstate(over="ignore", invalid="ignore"):  # rows whose square overflows are singular
        size = np.sum(A**2, axis=-1) * np.sum(inverse**2, axis=-2)
    return size.max(axis=-1) < RANK_TOLERANCE**-2


def repeatable_inverse(G_d: ArrayLike, N: ArrayLike, V: ArrayLike) -> Array:
    """Correct a desired inverse so that its motions keep the potentials h constant.

    N spans the null space of J, and V are the gradients of h. ``G_r = G_d − N (Vᵀ N)⁻¹ Vᵀ G_d``
    (32), (38).

    Parameters
    ----------
    G_d : (..., n, m) array
        The desired generalized inverse.
    N : (..., n, r) array
        Orthonormal null-space basis of J.
    V : (..., n, r) array
        Gradients of the potentials, ``V = ∂hᵀ/∂q``.

    Returns
    -------
    (..., n, m) array
        The repeatable inverse G_r.

    Raises
    ------
    SingularityError
        If ``det(Nᵀ V) = 0``: an algorithmic singularity.
    """
    G_d, N, V = as_matrices(("G_d", G_d, "n m"), ("N", N, "n r"), ("V", V, "n r"))
    V_T = np.swapaxes(V, -1, -2)
    try:
        return G_d - N @ np.linalg.solve(V_T @ N, V_T @ G_d)  # (32)
    except np.linalg.LinAlgError:
        raise SingularityError(
            "algorithmic singularity: a combination of the potentials' gradients V lies in the row "
            "space of J (det Nᵀ V = 0)",
            remedy="choose another configuration, or other potentials",
        ) from None


def leaf_margin(N: ArrayLike, V: ArrayLike) -> Array:
    """Evaluate the leaf margin ``σ_min(Nᵀ V̂)``: from 1 (best) to 0, an algorithmic singularity.

    The margin measures how far a repeatable inverse is from failure. N spans the null space of J, V
    are the gradients of the potentials, and V̂ is an orthonormal basis of the columns of V. The
    margin is the sine of the smallest angle between span V and the row space of J. V and V T, with
    T invertible, have the same margin.

    Parameters
    ----------
    N : (..., n, r) array
        Orthonormal null-space basis.
    V : (..., n, r) array
        Gradients of the potentials.

    Returns
    -------
    (...) array
    """
    N, V = as_matrices(("N", N, "n k"), ("V", V, "n k"))
    if N.shape[-1] == V.shape[-1] == 1:
        length = np.maximum(np.linalg.norm(V[..., 0], axis=-1), 1e-300)
        return np.asarray(np.abs((N * V).sum(axis=(-2, -1))) / length, float)
    V_hat, _ = np.linalg.qr(V)
    return np.linalg.svd(np.swapaxes(N, -1, -2) @ V_hat, compute_uv=False)[..., -1]
