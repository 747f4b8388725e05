"""A region of joint space as boxes that cover it."""

from __future__ import annotations

import numpy as np

from ..arguments import Array
from ..errors import InputError
from ..regions import Box, Region, Tube, WorkspaceBox
from ..robot.task import Task
from .potentials import U


def cover(region: Region) -> tuple[Array, Array]:
    """Cover a region by boxes: their lower and upper corners, (K, n) each.

    A tube is covered by one box for every two samples that follow each other, so all that lies
    between them is inside. A workspace box is covered by the box of joints that it selects from.

    Raises
    ------
    InputError
        If it is a region of the user's own, whose shape is not known.
    """
    if isinstance(region, Box):
        return region.lower[None].copy(), region.upper[None].copy()
    if isinstance(region, Tube):
        first, last = region.samples[:-1], region.samples[1:]
        if not len(first):
            first = last = region.samples
        wide = region.radius + 4 * U * np.abs(region.samples).max(axis=0)
        return np.minimum(first, last) - wide, np.maximum(first, last) + wide
    if isinstance(region, WorkspaceBox):
        return cover(region.within)
    raise InputError(
        f"nothing can be proved over a {type(region).__name__}: its shape is not known; prove the "
        "design over a box or a tube that contains it: dataclasses.replace(design, region=...)"
    )


def enclosing(low: Array, high: Array) -> Box:
    """Make a box that holds all boxes with corners low and high, (K, n) each."""
    least, most = low.min(axis=0), high.max(axis=0)
    slack = 1e-9 * (np.abs(least) + np.abs(most) + most - least)
    return Box.between(least - slack, most + slack)


def limit_margin(task: Task, low: Array, high: Array) -> tuple[float, int]:
    """Bound the distance to the nearest joint limit from below over boxes; and which box is the
    worst."""
    T = task.coordinate_matrix
    middle, reach = (low + high) / 2 @ T.T, (high - low) / 2 @ np.abs(T).T
    lower, upper, _ = task.joint_limits
    size = np.abs(low).max() + np.abs(high).max()
    margins = np.minimum(middle - reach - lower, upper - middle - reach).min(axis=1)
    at = int(np.argmin(margins))
    return float(margins[at]) - 16 * task.n * U * float(size) * float(
        np.abs(T).sum(axis=1).max()
    ), at
