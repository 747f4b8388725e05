"""Answers to MoveIt's service GetPositionIK by a cell's function; imports no ROS package.

Letters: n joints of the task, r numbers of the level c.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pinocchio as pin

from ...base.arguments import Array
from ...base.errors import InputError
from ...model.bodies import bodies_of
from ..cells.function import InverseFunction
from .servo_inputs import target_of

SUCCESS, NO_SOLUTION, IN_COLLISION, WRONG_LINK, WRONG_FRAME = 1, -31, -12, -18, -21
"""Values of ``moveit_msgs/MoveItErrorCodes``."""


def answer(
    F: InverseFunction,
    request: Any,
    response: Any,
    *,
    names: Mapping[str, str],
    base: str,
    leaf: Array | None = None,
    tool: pin.SE3 | None = None,
) -> Any:
    """Fill in and return MoveIt's response to a request: the joints F(pose), or an error code.

    F is the function of a cell, a box of poses: it gives one configuration per pose. The seed, the
    group and the constraints of the request are ignored: the pose alone determines the joints. If
    the request has ``avoid_collisions``, and the robot collides with itself at F(pose), the answer
    is the error code of a collision. Links without a shape are not checked.

    Parameters
    ----------
    F
        Function of a cell.
    request, response
        ``moveit_msgs/PositionIKRequest`` and ``GetPositionIK.Response``.
    names
        Dict from the joint names in messages to those of the task, in the task's order.
    base
        Name of the only frame in which poses are accepted.
    leaf : (r,) array, optional
        Level c, by default 0: it selects one of the configurations that reach a pose, and so
        the position of the elbow along the self-motion.
    tool : pinocchio.SE3, optional
        Placement of a tool in the frame; the requested poses are then the tool's.
    """
    q, response.error_code.val = _solved(F, request, base, leaf, tool)
    if q is not None:
        response.solution.joint_state.name = list(names)
        response.solution.joint_state.position = q.tolist()
    return response


def _solved(
    F: InverseFunction, request: Any, base: str, leaf: Array | None, tool: pin.SE3 | None
) -> tuple[Array | None, int]:
    """Evaluate F at a request's pose: return (joints (n,), SUCCESS) or (None, MoveIt's error code).

    ``base`` is the only frame in which poses are accepted. ``leaf`` (r,) is the level c of F(x; c),
    the position along the self-motion; None is 0. ``tool`` is the placement of a tool in the frame;
    the requested pose is then the tool's.
    """
    if request.ik_link_name not in ("", F.task.frame):
        return None, WRONG_LINK
    if request.pose_stamped.header.frame_id not in ("", base):
        return None, WRONG_FRAME
    p, x = request.pose_stamped.pose.position, request.pose_stamped.pose.orientation
    try:
        target = target_of((p.x, p.y, p.z), (x.x, x.y, x.z, x.w), F.task, F.cell, tool)
        q = InverseFunction(F.chart)(target, leaf=leaf)  # which refuses joints beyond a limit
    except InputError:
        return None, NO_SOLUTION
    if request.avoid_collisions and bodies_of(F.task).nearest(q).distance < 0:
        return None, IN_COLLISION
    return q, SUCCESS
