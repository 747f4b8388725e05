"""Symmetric block-tridiagonal systems, open or cyclic, by a banded Cholesky factorisation.

Newton's method for a motion of many points has such a matrix, because each point is coupled to its
neighbours only; a closed motion is cyclic. The effort is proportional to the number of points, not
to its cube.
"""

from __future__ import annotations

import numpy as np

from ..base.arguments import Array


def solve_block_tridiagonal(diagonal: Array, upper: Array, rhs: Array, *, cyclic: bool) -> Array:
    """Solve a positive definite system ``D_k a_k + U_k a_{k+1} + U_{k−1}ᵀ a_{k−1} = b_k``.

    There are K equations of r rows each, k = 0, …, K − 1. In a cyclic system, block K − 1 is
    coupled to block 0. The blocks are then reordered as 0, 1, K − 1, 2, K − 2, …, so that coupled
    blocks are at most two apart and the matrix is banded.

    Parameters
    ----------
    diagonal : (K, r, r) array
        Symmetric blocks D_k.
    upper : (K, r, r) array
        Blocks U_k, which couple block k to block k + 1. The last one couples block K − 1 to
        block 0, and is used only if ``cyclic``.
    rhs : (K, r) array
        Right-hand sides b_k.
    cyclic
        True if block K − 1 is coupled to block 0. K must then be at least 3.

    Returns
    -------
    (K, r) array
        The solution a_k.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the matrix is not positive definite.
    """
    from scipy.linalg import solveh_banded  # slow to import

    K, r = rhs.shape
    k = place = np.arange(K)  # position of each block
    if cyclic:
        # 0, 1, 3, 5, …, 4, 2: odd on the first half of the cycle, even on the second
        place = np.where(k == 0, 0, np.where(k <= K // 2, 2 * k - 1, 2 * (K - k)))
    band = np.zeros(((3 if cyclic else 2) * r, K * r))
    at = place[:, None] * r + np.arange(r)  # (K, r): row of each unknown
    pairs = [(at, at, diagonal), (at[:-1], at[1:], upper[:-1])]
    if cyclic:
        pairs.append((at[-1:], at[:1], upper[-1:]))
    for rows, columns, blocks in pairs:
        i, j = rows[:, :, None], columns[:, None, :]
        band[np.abs(i - j), np.minimum(i, j)] = blocks
    solved = solveh_banded(band, rhs[np.argsort(place)].ravel(), lower=True, check_finite=False)
    return solved.reshape(K, r)[place]
