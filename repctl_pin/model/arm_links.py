"""Links of the arm that a task moves, and the joints that move them.

Letters: n joints of the task, T configurations.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..base.arguments import Array
from .model import frame_id, frame_placements, link_frames, path_between
from .task import Task


def arm_links(task: Task) -> frozenset[str]:
    """Collect the names of the arm's links: from the base to the frame, and beyond the frame.

    Links beyond the frame, such as fingers, are carried by the last joint before the frame. Links
    of other branches, such as a second arm on the same waist, are left out.
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


def moves(task: Task, link: str) -> bool:
    """Test whether a task's joints move a link of the robot relative to the root.

    The link need not lie between the base and the frame.
    """
    robot = task.robot
    columns = [robot.joint_names.index(name) for name in task.joint_names]
    driven = np.flatnonzero((robot.coupling.S[:, columns] != 0).any(axis=1)) + 1
    return bool(set(driven.tolist()) & set(robot.model.supports[_joint(task, link)].tolist()))


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
