"""Null space of J: orthonormal basis N, smooth null vector for r = 1, alignment of bases.

J (m, n) is the Jacobian, r = n − m, and q the configuration. Arrays may have further leading axes,
written as "...": each of their entries is one matrix. Numbers in parentheses are equations of
the paper.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..base.arguments import Array, as_matrices
from ..base.errors import InputError
from .inverses import row_factor


def nullspace(J: ArrayLike) -> Array:
    """Evaluate an orthonormal basis N of the null space of J: ``J N = 0``, ``Nᵀ N = I``.

    The columns of N are joint velocities that do not move the frame. N is the last r columns of Q
    in the complete factorisation ``Jᵀ = Q R``. It is not continuous in q: at nearby configurations,
    N can differ by a rotation or a sign. Before differentiating or comparing bases, apply
    :func:`align`; for r = 1, :func:`null_vector` is smooth.

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

    ``n_i = (−1)^i det(J without column i)``, i counted from 0. This vector is not normalised:
    ``‖n‖² = det(J Jᵀ)``, so n is 0 where J loses rank. In the paper's examples, n is equal to the
    vectors in (12) and (18), and to √2 times the unit vector n̂_J in (41).

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
        raise InputError(
            f"J is {m} × {n}, but a null vector requires one column more than rows; "
            "use nullspace(J)"
        )
    minors = [np.linalg.det(np.delete(J, i, axis=-1)) for i in range(n)]
    return np.stack([(-1) ** i * minor for i, minor in enumerate(minors)], axis=-1)


def align(N: ArrayLike, reference: ArrayLike) -> Array:
    """Rotate a basis within its span to be closest to a reference basis (orthogonal Procrustes).

    N becomes ``N U Vᵀ`` with the singular value decomposition ``Nᵀ N_ref = U S Vᵀ``. If N spans the
    null space of J(q) and N_ref is fixed, the result is smooth in q wherever ``Nᵀ N_ref`` has full
    rank.

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
