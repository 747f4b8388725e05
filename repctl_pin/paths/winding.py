"""Number of turns of a path around the first joint of an arm.

Repeatability holds for paths that can be shrunk to a point. A path around the base cannot, so
studies count its turns and warn.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from ..model.task import Task
from .several_paths import paths_of
from .task_path import TaskPath

_POINTS = 2000
"""Number of points, in addition to corners, at which the angle around the axis is evaluated."""


def winding(task: Task, path: TaskPath) -> tuple[int, str]:
    """Count the turns of a path around the axis of the chain's first joint; 0 if it is prismatic.

    Return the number of turns, and the name of the joint. Turns in the negative direction of the
    joint count as negative. The joints of an arm that follows such a path can end a full turn from
    their start, so that not even a repeatable controller closes the motion. Repeatability is a
    property of loops that can be shrunk to a point inside Ω, the region of joint space of the
    design.

    Parameters
    ----------
    task
        Task of the arm.
    path
        Path of the frame. For several frames, the path with the most turns counts, around the first
        joint of its own frame's chain.
    """
    if len(task.frames) > 1:
        own = zip(task.single_tasks, paths_of(path), strict=True)
        return max((winding(single, each) for single, each in own), key=lambda one: abs(one[0]))
    joint = task.joint_names[0]
    if not task.revolute[0]:
        return 0, joint
    # a path that the user defines by functions can change between two calls
    count = _turns if path.spec else _turns.__wrapped__
    return count(task, path), joint


@lru_cache(maxsize=4)
def _turns(task: Task, path: TaskPath) -> int:
    """Count the turns of a path around the axis of the chain's first joint, which is revolute.

    The last results are cached, because all motions of a study follow the same path.
    """
    axis = task.axes(task.reference)[0]
    origin = task.joint_origins(task.reference)[0]
    s = np.union1d(np.linspace(0, 1, _POINTS), path.breaks)
    around = np.cross(axis, np.array([path.point(float(k)) for k in s]) - origin)
    one = around[np.argmax(np.linalg.norm(around, axis=1))]
    x = around @ one
    y = around @ np.cross(axis, one)
    return int(np.rint((np.unwrap(np.arctan2(y, x))[-1] - np.arctan2(y[0], x[0])) / (2 * np.pi)))


def winding_words(turns: int, joint: str) -> str:
    """Make the warning that a path winds around a joint's axis, and need not close.

    ``turns`` is the number of turns, not 0, and ``joint`` the joint's name.
    """
    times = {1: "once", 2: "twice"}.get(abs(turns), f"{abs(turns)} times")
    winds = f"the path winds {times} around the axis of {joint}"
    return f"{winds}, so it need not close under any control"
