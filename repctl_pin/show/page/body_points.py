"""Displacement of the drawn bodies between cycles, and the corners at which it is largest.

A drawn body is a visible shape of the robot, such as a mesh of its URDF. The most displaced point
of a body is always a corner of its convex hull. The page measures displacement at a few of these
corners only.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np
from numpy.typing import NDArray

from ...base.arguments import Array
from ...motion.body_displacement import displacements


def body_drift(
    bodies: Sequence[Array],
    placements: Array,
    per_cycle: int,
    *,
    directions: Sequence[int] | None = None,
) -> tuple[tuple[Array, ...], Array]:
    """Compute the displacement of each body from its placement at the same moment of cycle 1.

    Parameters
    ----------
    bodies : sequence of S (P, 3) arrays
        Corners of the convex hull of each body in its own frame, m; P differs between bodies.
    placements : (T, S, 4, 4) array
        Placements of S bodies at T samples, cycle by cycle.
    per_cycle
        Number of samples of one cycle, including both ends.
    directions : sequence of S int, optional
        For each body, the number of directions in which its outermost corners are kept; by default
        8. On a path that the page's user draws, displacements are measured at the kept corners.
        With 128 directions, they then have an error of at most 0.7 %, and of 0.05 % on average.

    Returns
    -------
    points : tuple of S (K, 3) arrays
        For each body, in its own frame, m, the corners that are displaced most at any sample, and
        the outermost corners; K differs between bodies.
    off : (T, S) array
        Largest displacement of a corner of each body, m; 0 in a repeatable motion. The end of a
        cycle is compared with the start of cycle 1.
    """
    first = np.arange(len(placements)) % per_cycle
    first[per_cycle - 1 :: per_cycle] = 0
    off, which = displacements(placements[first], placements, bodies)
    kept = [
        body[np.union1d(np.unique(which[:, s]), _outermost(body, count))]
        for s, (body, count) in enumerate(zip(bodies, directions or [8] * len(bodies), strict=True))
    ]
    return tuple(kept), off


def _outermost(body: Array, directions: int) -> NDArray[np.intp]:
    """Find the corners of a body (P, 3) that lie farthest in some directions: indices, increasing.

    The directions are the eight space diagonals and, if ``directions`` exceeds 8, also
    ``directions`` points of a spiral on the sphere.
    """
    ways = np.array(list(product((-1.0, 1.0), repeat=3)))
    if directions > 8:
        k = np.arange(directions) + 0.5
        z, turn = 1 - 2 * k / directions, np.pi * (1 + 5**0.5) * k
        ring = np.sqrt(1 - z**2)
        ways = np.vstack([ways, np.c_[ring * np.cos(turn), ring * np.sin(turn), z]])
    return np.unique(np.argmax(body @ ways.T, axis=0))
