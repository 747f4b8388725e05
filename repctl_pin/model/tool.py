r"""Task of a tool: the task of a second frame, fixed in the same link as a task's frame.

With T the placement of the tool in the task's frame, the tool has the pose ``x' = x T``. A pose
task of the tool then has

.. math:: J' = A\,J, \qquad A = \begin{bmatrix} I & -[R\,t]_\times \\ 0 & I \end{bmatrix},

in base axes, with R the frame's rotation and t the position in T. A is invertible, so J' has the
null space of J: regular configurations and repeatable motions do not depend on the tool. A
self-motion moves the joints while the frame rests.

``ToolTask`` is the task of a tool that is fixed in a link of the robot.
"""

from __future__ import annotations

from copy import copy

import numpy as np
import pinocchio as pin

from ..base.arguments import Array
from ..base.errors import InputError
from .chain_formulas import Placement, as_placement, require_rotation
from .model import frame_id
from .several_frames import one_frame
from .task import Task

_EXACT = 1e-14
"""Entry of RᵀR − I up to which a rotation is accepted without correction."""

_FARTHEST = 1000.0
"""Maximum distance of a tool from its frame, m; rounding errors of poses grow with it."""

_SAME = 1e-9
"""Largest difference, m or rad, of two placements that count as equal."""


class ToolTask(Task):
    """Task of a tool, or of a turned frame, that is fixed in a link of the robot.

    A design is converted to such a task when the gripper changes.

    Attributes
    ----------
    link : str
        Link that carries the tool.
    tool : pinocchio.SE3
        Placement of the tool in the frame of ``link``.
    """

    link: str
    tool: pin.SE3


def with_tool(task: Task, placement: Placement) -> ToolTask:
    """Create the pose task of a tool, placed at ``placement`` in the frame of a pose task.

    Raises
    ------
    InputError
        If the task is not a pose task of one frame, or the placement is not a rigid transform.
    """
    return carried(require_pose(task), rigid(placement))


def turned_frame(task: Task, rotation: Array) -> ToolTask:
    """Create the task of the same kind whose frame is turned by a rotation (3, 3) in its own axes.

    An axis task then commands another axis of the frame, and has another self-motion.
    """
    return carried(one_frame(task, "a turned frame"), pin.SE3(rotation, np.zeros(3)))


def carried(task: Task, tool: pin.SE3) -> ToolTask:
    """Create the task of the same kind for a new frame, placed at ``tool`` in the task's frame."""
    if isinstance(task, ToolTask):
        link, tool = task.link, task.tool * tool
    else:
        link = task.frame
    robot = copy(task.robot)
    robot.model = task.robot.model.copy()
    name = _new_name(link, robot.model)
    flange = robot.model.frames[frame_id(robot.model, link)]
    robot.model.addFrame(
        pin.Frame(
            name,
            flange.parentJoint,
            frame_id(robot.model, link),
            flange.placement * tool,
            pin.FrameType.BODY,
        ),
        False,
    )
    made = ToolTask(robot, name, task.kind, task.joint_names)
    made.link, made.tool = link, tool
    return made


def require_pose(task: Task) -> Task:
    """Return a pose task of one frame; raise InputError for another task, with the reason."""
    one_frame(task, "another tool")
    if task.m != 6:
        raise InputError(
            f"another tool requires a pose task, not {task.kind}: the self-motion of other kinds "
            "changes with the point that they control",
            remedy="design again with the new tool's frame",
        )
    return task


def rigid(placement: Placement) -> pin.SE3:
    """Check the placement of a tool, and return it with an exact rotation.

    A rotation matrix that is written with few digits is replaced by the nearest rotation.
    InputError is raised if it is not a rotation to 1e-6, or if the position is not finite or is
    more than 1,000 m from the frame.
    """
    tool = as_placement(placement, "placement")
    if not np.isfinite(tool.translation).all():
        raise InputError("the position of the tool has a number that is not finite; give it in m")
    if (away := float(np.linalg.norm(tool.translation))) > _FARTHEST:
        raise InputError(
            f"the tool is {away:.3g} m from the frame: at most {_FARTHEST:,.0f} m is accepted",
            remedy="give its position in m",
        )
    require_rotation(tool.rotation, "the tool")
    if np.abs(tool.rotation.T @ tool.rotation - np.eye(3)).max() < _EXACT:
        return tool
    U, _, V = np.linalg.svd(tool.rotation)
    return pin.SE3(U @ V, tool.translation)


def placement_between(task: Task, other: Task) -> pin.SE3:
    """Compute the constant placement of the frame of ``other`` in the frame of ``task``.

    Raises
    ------
    InputError
        If joints move one frame relative to the other, or the tasks differ in their joints or their
        number of coordinates.
    """
    if other.joint_names != task.joint_names or other.m != task.m:
        raise InputError(
            f"{other.frame!r} is not on the body of {task.frame!r}: different joints move the two",
            remedy=f"give a link that is fixed to {task.frame!r}",
        )
    rng = np.random.default_rng(0)
    Q: Array = task.reference + rng.uniform(-1, 1, (4, task.n))
    places = [task.placement(q).actInv(other.placement(q)) for q in Q]
    away = max(np.abs(one.homogeneous - places[0].homogeneous).max() for one in places)
    if away > _SAME:
        raise InputError(
            f"{other.frame!r} is not on the body of {task.frame!r}: "
            "the two move relative to each other",
            remedy=f"give a link that is fixed to {task.frame!r}",
        )
    return places[0]


def _new_name(link: str, model: pin.Model) -> str:
    """Return a name for the tool of a link, such as ``flange tool``, that no frame has yet."""
    taken = {frame.name for frame in model.frames}
    name = f"{link} tool"
    while name in taken:
        name += "'"
    return name
