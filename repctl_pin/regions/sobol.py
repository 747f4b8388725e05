"""Scrambled Sobol points, bit for bit those of :class:`scipy.stats.qmc.Sobol`.

That class needs all of ``scipy.stats``, which takes longer to import than a small design takes. A
coordinate of a point is the exclusive or of some of the 30 direction numbers of its dimension, and
of a digital shift, a random number.
"""

from __future__ import annotations

from functools import cache, lru_cache

import numpy as np
from numpy.typing import NDArray

from ..base.arguments import Array

_BITS = 30
"""Number of binary digits of a coordinate."""

_JOE_KUO = """
3 1; 7 1 3; 11 1 3 1; 13 1 1 1; 19 1 1 3 3; 25 1 3 5 13; 37 1 1 5 5 17; 41 1 1 5 5 5;
47 1 1 7 11 19; 55 1 1 5 1 1; 59 1 1 1 3 11; 61 1 3 5 5 31; 67 1 3 3 9 7 49;
91 1 1 1 15 21 21; 97 1 3 1 13 27 49; 103 1 1 1 15 7 5; 109 1 3 1 15 13 25;
115 1 1 5 5 19 61; 131 1 3 7 11 23 15 103; 137 1 3 7 13 13 15 69; 143 1 1 3 13 7 35 63;
145 1 3 5 9 1 25 53; 157 1 3 1 13 9 35 107; 167 1 3 1 5 27 61 31;
171 1 1 5 11 19 41 61; 185 1 3 5 3 3 13 69; 191 1 1 7 13 1 19 1; 193 1 3 7 5 13 19 59;
203 1 1 3 9 25 29 41; 211 1 3 5 13 23 1 55; 213 1 3 7 3 13 59 17
"""
"""Table of Joe and Kuo, one entry per dimension from the second (SIAM J. Sci. Comput. 30, 2008).

An entry is a primitive polynomial over GF(2), its coefficients the binary digits of a number, and
the initial direction numbers m_1, m_2, …"""

_MOST_DIMENSIONS = 2 + _JOE_KUO.count(";")
"""Largest dimension that the table covers."""


def scrambled_points(n: int, power: int, seed: int | np.random.Generator) -> Array:
    """Draw 2^power Sobol points in the unit cube, scrambled by a random matrix and a digital shift.

    The points fill the cube more evenly than random points; each seed gives an independent set.

    Parameters
    ----------
    n
        Dimension of the cube; above :data:`_MOST_DIMENSIONS`, scipy draws the points.
    power
        Base-2 logarithm of the number of points, at most 30.
    seed
        Seed of the scrambling, or the generator from which it is drawn.

    Returns
    -------
    (2^power, n) array
        One point per row, with coordinates from 0 to 1.
    """
    if n > _MOST_DIMENSIONS:
        from scipy.stats import qmc

        return qmc.Sobol(n, scramble=True, rng=seed).random_base2(power)
    if isinstance(seed, np.random.Generator):
        shift, directions = _scrambling(n, seed)
    else:
        shift, directions = _scrambling_of_seed(n, seed)
    points = shift[None]
    for direction in directions[:power]:  # Gray code: reflected, with one more digit
        points = np.concatenate([points, points[::-1] ^ direction])
    return np.multiply(points, 2.0**-_BITS, dtype=np.float64)


@lru_cache(maxsize=256)
def _scrambling_of_seed(n: int, seed: int) -> tuple[NDArray[np.uint32], NDArray[np.uint32]]:
    """Draw the digital shift (n,) and the scrambled direction numbers (30, n) of a seed.

    They are cached, because a design draws the same points many times, as nodes of its cost.
    """
    return _scrambling(n, np.random.default_rng(seed).spawn(1)[0])  # as scipy does with rng=


def _scrambling(
    n: int, random: np.random.Generator
) -> tuple[NDArray[np.uint32], NDArray[np.uint32]]:
    """Draw a digital shift (n,), and direction numbers (30, n) scrambled by a random matrix."""
    shift_bits = random.integers(2, size=(n, _BITS), dtype=np.uint32)
    matrix = np.tril(random.integers(2, size=(n, _BITS, _BITS), dtype=np.uint32))
    matrix |= np.eye(_BITS, dtype=np.uint32)
    places = 2 ** np.arange(_BITS, dtype=np.uint32)
    digits = matrix @ _direction_digits()[:n] % 2  # (n, BITS, BITS)
    return shift_bits @ places, np.einsum("i,nij->jn", places[::-1], digits)


@cache
def _direction_digits() -> NDArray[np.uint32]:
    """Tabulate the binary digits of the direction numbers: an array of 0 and 1, cached.

    The axes are [dimension, digit (most significant first), direction number], of lengths D, 30 and
    30, with D = :data:`_MOST_DIMENSIONS`. Before scrambling, the k-th digit of a point's coordinate
    is the exclusive or of the k-th digits of some direction numbers of that dimension.
    """
    numbers = [[1] * _BITS]
    for row in _JOE_KUO.split(";"):
        polynomial, *initial = map(int, row.split())
        numbers.append(_extended(polynomial, initial))
    places = np.arange(_BITS)
    shifted = np.array(numbers) << places[::-1]  # m_j 2^(BITS - j)
    digits = shifted[:, None, :] >> places[::-1, None] & 1
    return digits.astype(np.uint32)


def _extended(polynomial: int, initial: list[int]) -> list[int]:
    """Extend the direction numbers m_1, m_2, … of one dimension, ``initial``, to 30 numbers.

    They follow from a recurrence with the primitive polynomial over GF(2) whose coefficients are
    the binary digits of ``polynomial``, as in the table of Joe and Kuo.
    """
    degree = len(initial)
    m = list(initial)
    for j in range(degree, _BITS):
        following = m[j - degree]
        for k in range(1, degree + 1):
            if polynomial >> (degree - k) & 1:
                following ^= m[j - k] << k
        m.append(following)
    return m
