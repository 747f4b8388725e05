"""Null space of J: orthonormal basis N, smooth null vector for r = 1, alignment of bases."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..base.arguments import Array, as_matrices
from ..base.errors import InputError
from .inverses import row_factor


def nullspace(J: ArrayLike) -> Array:
    """Evaluate an orthonormal basis N of the null space of J: ``J N = 0``, ``Nᵀ N = I``.

    The columns of N are joint velocities that do not move the frame. N is the last r columns of Q
    in the complete factorisation ``Jᵀ = Q R``, and is not continuous in q: signs and rotations jump
    from point to point. Before you differentiate or compare bases, use :func:`align`, or use
    :func:`null_vector`.

    Parameters
    ----------
    J : (..., m, n) array
        Jacobians of full row rank.

    Returns
    -------
    (..., n, r) array, r = n − m

    Raises
    ------
    SingularityError
        If J loses rank.
    """
    Q, R = row_factor(J, mode="complete")
    return Q[..., :, R.shape[-1] :]


def null_vector(J: ArrayLike) -> Array:
    """Evaluate the null vector that is smooth in q, for r = 1: the generalized cross product.

    ``n_i = (−1)^i det(J without column i)``, i counted from 0. The vector n equals (12) and (18),
    and √2 times (41). It is not normalised: ``‖n‖² = det(J Jᵀ)``, so n vanishes where J loses rank.
    Bases from a factorisation change sign from point to point; this vector does not.

    Parameters
    ----------
    J : (..., m, m + 1) array

    Returns
    -------
    (..., m + 1) array
        The null vector n.
    """
    (J,) = as_matrices(("J", J, "m n"))
    m, n = J.shape[-2:]
    if n != m + 1:
        raise InputError(f"the null vector needs one column more than rows; J is {m} × {n}")
    minors = [np.linalg.det(np.delete(J, i, axis=-1)) for i in range(n)]
    return np.stack([(-1) ** i * minor for i, minor in enumerate(minors)], axis=-1)


def align(N: ArrayLike, reference: ArrayLike) -> Array:
    """Rotate a basis within its span to be closest to a reference basis (orthogonal Procrustes).

    Bases at neighbouring configurations are then comparable. N becomes ``N U Vᵀ`` with the singular
    value decomposition ``Nᵀ N_ref = U S Vᵀ``. The result is smooth in q wherever ``Nᵀ N_ref`` keeps
    full rank.

    Parameters
    ----------
    N : (..., n, r) array
        Basis with orthonormal columns.
    reference : (..., n, r) array
        Reference basis N_ref.

    Returns
    -------
    (..., n, r) array
        The rotated basis.
    """
    N, reference = as_matrices(("N", N, "n r"), ("reference", reference, "n r"))
    along = np.swapaxes(N, -1, -2) @ reference
    if N.shape[-1] == 1:
        return np.asarray(np.where(along < 0, -N, N), float)
    U, _, Vt = np.linalg.svd(along)
    return N @ U @ Vt
