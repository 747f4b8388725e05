"""Links of the arm that a task moves, and the other end effectors that move with it.

On a robot with two arms on one waist, the task of one arm also moves the other arm; a study reports
that displacement. Letters: n joints of the task, N of the robot's model, T configurations.

``Mechanism`` is the movable joints of a robot and their limits.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..base.arguments import Array
from .end_effectors import arm_ends, is_sensor, task_links
from .mechanism import Mechanism
from .model import frame_id, frame_placements, link_frames, path_between
from .task import Task


def arm_links(task: Task) -> frozenset[str]:
    """Collect the names of the arm's links: from the base to the task's frame, and beyond it.

    Links of other branches, such as a second arm on the same waist, are left out.
    """
    if len(task.frames) > 1:
        return frozenset().union(*map(arm_links, task.single_tasks))
    robot = task.robot
    model = task.robot.model
    frame = _joint(task, task.frame)
    up, down = path_between(model, robot.base_id, frame_id(model, task.frame))
    on_the_way = {*up, *down, *(int(model.parents[j]) for j in up[-1:])}
    joints = {
        j for j in range(model.njoints) if j in on_the_way or frame in model.supports[j].tolist()
    }
    frames = link_frames(model)
    return frozenset(link for link in robot.description.links if frames[link].parentJoint in joints)


def other_ends(task: Task) -> tuple[str, ...]:
    """List the end effectors of other branches that the task's joints move: one link per end.

    Sensors are left out.
    """
    model = task.robot.model
    own = arm_links(task)
    driven = set((np.flatnonzero(_driven(task)) + 1).tolist())
    ends = [task_links(body)[0] for body in arm_ends(task.robot.description)]
    return tuple(
        end
        for end in ends
        if end not in own
        and not is_sensor(end)
        and driven & set(model.supports[_joint(task, end)].tolist())
    )


def _driven(task: Task) -> Array:
    """Return a mask (N,) of the joints of the robot's model: True if the task drives the joint."""
    columns = [task.robot.joint_names.index(name) for name in task.joint_names]
    return (task.robot.coupling.S[:, columns] != 0).any(axis=1)


def _joint(task: Task, link: str) -> int:
    """Return the id, in the robot's model, of the joint that carries a link; 0 for the root."""
    model = task.robot.model
    return int(model.frames[frame_id(model, link)].parentJoint)


def link_origins(task: Task, links: Sequence[str], Q: Array) -> Array:
    """Compute the origins of L links at Q (T, n): (T, L, 3), m, in the root frame."""
    robot = task.robot
    ids = [frame_id(robot.model, link) for link in links]
    Q = robot.coupling.joints(task.to_robot(Q))
    return frame_placements(robot.model, ids, Q)[:, :, :3, 3]


def base_placements(robot: Mechanism, Q: Array) -> Array:
    """Compute the base's placements in the root frame: rigid transforms (T, 4, 4), m.

    The n columns of Q (T, n) are here the joints of the whole robot. The base moves if it is, for
    example, a workpiece on a turntable. Pictures show the root at rest, so points on the base are
    drawn with these placements.
    """
    if robot.base is None:
        return np.tile(np.eye(4), (len(Q), 1, 1))
    return frame_placements(robot.model, [robot.base_id], robot.coupling.joints(Q))[:, 0]


def base_moves(task: Task) -> bool:
    """Test whether a task's joints move the base, relative to which its frames are placed."""
    base = task.robot.base
    if base is None:
        return False
    driven = np.flatnonzero(_driven(task)) + 1
    return bool(set(driven.tolist()) & set(task.robot.model.supports[_joint(task, base)].tolist()))


def on_base(placements: Array, points: Array) -> Array:
    """Transform points (T, ..., 3), m, from the base frame to the root frame.

    ``placements`` (T, 4, 4) are those of the base in the root frame.
    """
    R, p = placements[:, :3, :3], placements[:, :3, 3]
    flat = points.reshape(len(points), -1, 3)
    moved = np.einsum("tij,tkj->tki", R, flat) + p[:, None]
    return np.asarray(moved.reshape(points.shape))
