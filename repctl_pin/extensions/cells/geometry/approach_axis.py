"""Approach axis of a tool: the axis of the tool's frame that points at the work.

In most frames this axis is z, in others x. It is found from the last joint and the fingers. A task
whose approach axis is not z gets a turned frame, whose z axis is the approach axis.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from ....base.arguments import Array, require_choice
from ....model.model import frame_id
from ....model.task import Task
from ....model.tool import turned_frame
from .symmetry import last_axis

AXES = ("x", "y", "z", "-x", "-y", "-z")
"""Names of the axes of a frame."""

_STRAIGHT, _ROUGHLY = np.cos(np.radians(5)), np.cos(np.radians(25))
"""Cosines of the largest angles from an axis of the frame at which :func:`tool_axis` accepts the
axis of the last joint, and the line from this joint to the tip."""

_ACROSS = 0.5
"""Cosine of the largest angle between the axis of the last joint and the line to the tip."""

_SHORT = 0.01
"""Distance from the last joint to the tip, m, up to which the direction of the tip is not used."""


class Approach(NamedTuple):
    """Axis of a tool's frame that points at the work.

    Attributes
    ----------
    axis : str
        The axis: ``x``, ``y``, ``z``, ``-x``, ``-y`` or ``-z`` of the frame.
    why : str
        Text that says how the axis was found, such as from the axis of the last joint.
    """

    axis: str
    why: str

    def __str__(self) -> str:
        return f"{self.axis}, {self.why}"

    @property
    def rotation(self) -> Array:
        """Rotation (3, 3) whose z axis is the approach axis, in axes of the frame."""
        i, sign = "xyz".index(self.axis[-1]), -1.0 if self.axis.startswith("-") else 1.0
        x, y = np.roll(np.eye(3), -1 - i, axis=0)[:2]
        return np.column_stack([x, sign * y, sign * np.eye(3)[i]])


def approach_axis(task: Task, given: Any = None) -> Approach:
    """Find the approach axis of a task's frame, or check a given name such as ``"-z"``.

    The result has the name of the axis, and a text on how it was found. The axis is the one that
    :func:`tool_axis` finds, or z if it finds none. If a name is ``given``, the result has this
    name; an InputError is raised if it names no axis.
    """
    if given is not None:
        require_choice(given, AXES, "approach axis")
        return Approach(given, "as given")
    found = tool_axis(task)
    if found is None:
        name, _ = last_axis(task)
        return Approach("z", f"because the axis of {name} is along no axis of the frame")
    return found


def tool_axis(task: Task) -> Approach | None:
    """Find the axis of a task's frame along which the tool points; None if there is none.

    The tip is the mean position of the fingers or, without fingers, the origin of the frame. Two
    directions are tried, in this order; the result is the axis of the frame nearest to the first
    one that is accepted.

    The first is the axis of the last joint, with the sign that points from the joint to the tip. It
    is accepted if it is within 5° of an axis of the frame, and within 60° of the line from the
    joint to the tip. If the tip is within 1 cm of the joint, the 60° are not tested, and the sign
    is that of :func:`_outward`: away from the joint before the last.

    The second is the line from the last joint to the tip. It is accepted if it is longer than 1 cm,
    and within 25° of an axis of the frame.
    """
    name, (origin, axis) = last_axis(task)
    fingers = _fingers(task)
    away = -origin if fingers is None else fingers - origin
    far = float(np.linalg.norm(away))
    along = float(axis @ away) / far if far > _SHORT else _outward(task, origin, axis)
    if abs(along) > _ACROSS and np.abs(axis).max() > _STRAIGHT:
        return Approach(named_axis(axis if along > 0 else -axis), f"the axis of {name}")
    if far > _SHORT and np.abs(away).max() > _ROUGHLY * far:
        end = task.frame if fingers is None else "the fingers"
        return Approach(named_axis(away), f"the direction from {name} to {end}")
    return None


def with_approach(task: Task, approach: Approach) -> Task:
    """Return the task with its frame turned such that z is the approach axis.

    The frame of a task whose approach axis is z is not turned.
    """
    return task if approach.axis == "z" else turned_frame(task, approach.rotation)


def _outward(task: Task, origin: Array, axis: Array) -> float:
    """Tell whether the axis (3,) of the last joint points away from the joint before it: 1 or −1.

    ``origin`` (3,), m, is the origin of the last joint; it and the axis are in frame axes. The
    vector from this origin to that of the joint before is projected onto the axis. The result is −1
    if the projection, m, is above 0.01, else 1. It does not depend on the configuration.
    """
    q = np.array(task.reference)
    x = task.placement(q)
    before = x.actInv(task.joint_origins(q)[-2:][0]) - origin
    return -1.0 if float(axis @ before) > _SHORT else 1.0


def named_axis(direction: Array) -> str:
    """Return the name, such as ``-z``, of the frame axis nearest to a direction (3,)."""
    i = int(np.argmax(np.abs(direction)))
    return f"{'-' if direction[i] < 0 else ''}{'xyz'[i]}"


def _fingers(task: Task) -> Array | None:
    """Compute the mean position (3,) of the fingers' joints, m, from the frame's origin.

    The position is in frame axes. The joints that follow the body of the frame in the kinematic
    tree count as joints of fingers. Return None if there are no such joints.
    """
    model: pin.Model = task.robot.model
    frame = model.frames[frame_id(model, task.frame)]
    after = [j for j in range(1, model.njoints) if model.parents[j] == frame.parentJoint]
    if not after:
        return None
    origins = [model.jointPlacements[j].translation for j in after]
    return np.asarray(frame.placement.actInv(np.mean(origins, axis=0)))
