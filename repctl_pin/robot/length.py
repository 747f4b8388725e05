"""How long an arm is: the unit in which joint slides and radians, metres and turns, can be compared."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .task import Task


def arm_length(task: Task, q: NDArray[np.float64]) -> float:
    """Sum the distances from one turning joint to the next, and to the frame, m; 0 if no joint turns.

    Parameters
    ----------
    task
        Whose chain is measured; in changed coordinates, too.
    q : (n,) array
        Configuration.
    """
    turning = np.append(np.linalg.norm(task.axes(q), axis=1) > 0.5, True)
    stations = np.vstack([task.joint_origins(q), task.placement(q).translation])[turning]
    return float(np.linalg.norm(np.diff(stations, axis=0), axis=1).sum())


def joint_scale(task: Task, q: NDArray[np.float64]) -> NDArray[np.float64]:
    """Choose a unit for every joint: 1 rad, and for a prismatic joint the length of the arm, m: (n,).

    In these units joint motions of both kinds can be compared. An arm that has no length, of
    prismatic joints alone, is measured in m.
    """
    if task.revolute.all():
        return np.ones(task.n)
    return np.where(task.revolute, 1.0, arm_length(task, q) or 1.0)
