"""Default start configurations of a task, the best known first."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..arguments import Array
from ..model.task import Task
from ..motion.fitting_circle import dexterity_at
from ..regions.region import sobol
from .task_choice import inner_limits

POSES = {
    "reference": "the reference pose",
    "ready": "the ready pose",
    "middle": "mid-range of the joints",
}
"""Named poses of a robot, in the order in which they are tried."""

SEARCHED = ("a dexterous pose near mid-range", "another dexterous pose")
"""Descriptions of the starts that are searched for, after the named poses."""

_LEAST_DEXTERITY = {6: 0.05, 5: 0.05, 2: 0.1}
_LEAST_DEXTERITY_OF_POSITION = 0.2
_LEAST_MARGIN = 0.15
_MOST_STARTS, _APART = 8, 0.5


def default_starts(task: Task) -> Iterator[tuple[Array, str]]:
    """Generate starts: the reference pose, the ready pose, mid-range, and poses around mid-range.

    Poses that are nearly singular or at a limit are left out.

    Yields
    ------
    q0 : (n,) array
    name : str
        Description of the start.
    """
    least = _LEAST_DEXTERITY.get(task.m, _LEAST_DEXTERITY_OF_POSITION)
    for pose, name in POSES.items():
        if pose not in task.robot.poses:
            continue
        q = task.from_robot(task.robot.poses[pose])
        margin = task.limit_margin(q).min()
        if dexterity_at(task, q) >= least and margin >= _LEAST_MARGIN:
            yield q, name
    for k, q in enumerate(_dexterous(task)):
        yield np.round(q, 3), SEARCHED[min(k, 1)]


def _dexterous(task: Task) -> Iterator[Array]:
    """Generate dexterous configurations, the nearest to mid-range first.

    Any two of them differ by more than 0.5 rad or m in some joint.
    """
    middle = task.from_robot(task.robot.poses["middle"])
    low, high = inner_limits(task)
    low, high = np.maximum(middle - 2.0, low), np.minimum(middle + 2.0, high)
    points = low + (high - low) * sobol(task.n, 512, 0)
    scores = np.array([dexterity_at(task, q) for q in points])
    good = points[scores >= 0.5 * scores.max()]
    good = good[np.argsort(np.linalg.norm(good - middle, axis=1))]
    for _ in range(_MOST_STARTS):
        yield good[0]
        good = good[np.abs(good - good[0]).max(axis=1) > _APART]
        if not len(good):
            return
