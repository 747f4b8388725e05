"""Displacement of bodies between two placements, and prediction of when a drifting joint leaves its
range."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array
from .joint_motion import JointMotion

MOST_CYCLES = 100
"""Maximum number of further cycles for which it is predicted that a joint leaves its range."""


def displacements(
    before: Array, after: Array, bodies: Sequence[Array]
) -> tuple[Array, NDArray[np.intp]]:
    """Compute how far each body moves between two placements: the maximum over its points.

    A point p of a body moves by ``D p̃`` with ``D = T′ − T`` and ``p̃ = (p, 1)``. Its length
    ‖D p̃‖ is a convex function of p, so that its maximum over a polytope is at a corner.

    Parameters
    ----------
    before, after : (T, S, 4, 4) arrays
        Rigid placements of S bodies at T moments, m.
    bodies : sequence of S arrays (P, 3)
        Corners of each body in its own frame, m; at least one.

    Returns
    -------
    way : (T, S) array
        Displacement of each body, m.
    which : (T, S) array of int
        Index of the corner that moves farthest.
    """
    D = (after - before)[..., :3, :]  # (T, S, 3, 4)
    way = np.empty(D.shape[:2])
    which = np.empty(D.shape[:2], np.intp)
    upper = np.triu_indices(4)
    twice = np.where(upper[0] == upper[1], 1.0, 2.0)
    for s, points in enumerate(bodies):
        p = np.c_[points, np.ones(len(points))]
        squares = p[:, upper[0]] * p[:, upper[1]] * twice  # (P, 10)
        G = np.swapaxes(D[:, s], 1, 2) @ D[:, s]  # (T, 4, 4): ‖D p̃‖² = p̃ᵀ G p̃
        which[:, s] = np.argmax(G[:, upper[0], upper[1]] @ squares.T, axis=1)
        way[:, s] = np.linalg.norm((D[:, s] @ p[which[:, s], :, None])[..., 0], axis=1)
    return way, which


def leaves_range(motion: JointMotion) -> tuple[int, str] | None:
    """Predict the cycle in which a drifting joint leaves its range.

    Every further cycle is assumed to add the joint displacement of the last one.

    Parameters
    ----------
    motion
        The motion so far.

    Returns
    -------
    (int, str) or None
        The cycle, counted from 1, and the joint's name; None if the motion closes, a joint is
        outside its range already, or none leaves its range within another 100 cycles.
    """
    if motion.first_violation is not None or motion.closes:
        return None
    task = motion.task
    lower, upper, _ = task.joint_limits
    last = task.joints(motion.q[-motion.steps - 1 :])
    step = last[-1] - last[0]  # (n,), per cycle
    margin = np.where(step > 0, upper - last.max(axis=0), last.min(axis=0) - lower)
    with np.errstate(divide="ignore", invalid="ignore"):
        left = np.where(step != 0, margin / np.abs(step), np.inf)
    joint = int(np.argmin(left))
    if not left[joint] < MOST_CYCLES:
        return None
    return motion.cycles + int(left[joint]) + 1, task.robot_joints[joint]
