"""Motion of the base: the link relative to which the frames of a task are placed.

The base moves if it is, for example, a workpiece on a turntable. The root is the URDF's root link,
which never moves. ``Mechanism`` is the movable joints of a robot and their limits.
"""

from __future__ import annotations

import numpy as np

from ..base.arguments import Array
from .arm_links import moves
from .mechanism import Mechanism
from .model import frame_placements
from .task import Task


def base_placements(robot: Mechanism, Q: Array) -> Array:
    """Compute the base's placements in the root frame: rigid transforms (T, 4, 4), m.

    The columns of Q (T, n) are the n movable joints of the whole robot, not of one task. Pictures
    are drawn in the root frame, to which :func:`on_base` transforms points of the base frame.
    """
    if robot.base is None:
        return np.tile(np.eye(4), (len(Q), 1, 1))
    return frame_placements(robot.model, [robot.base_id], robot.coupling.joints(Q))[:, 0]


def base_moves(task: Task) -> bool:
    """Test whether a task's joints move the base, relative to which its frames are placed."""
    base = task.robot.base
    return base is not None and moves(task, base)


def on_base(placements: Array, points: Array) -> Array:
    """Transform points (T, ..., 3), m, from the base frame to the root frame.

    ``placements`` (T, 4, 4) are those of the base in the root frame.
    """
    R, p = placements[:, :3, :3], placements[:, :3, 3]
    flat = points.reshape(len(points), -1, 3)
    moved = np.einsum("tij,tkj->tki", R, flat) + p[:, None]
    return np.asarray(moved.reshape(points.shape))
