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
