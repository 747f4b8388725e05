"""GetPositionIK from the function of a cell. The messages are stand-ins with MoveIt's attributes:
moveit_msgs is not on PyPI."""

from __future__ import annotations

from types import SimpleNamespace as Message
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import repctl_pin as rp
from repctl_pin.extensions.integrations.position_ik import (
    NO_SOLUTION,
    SUCCESS,
    WRONG_FRAME,
    WRONG_LINK,
    answer,
)

NAMES = {"arm_1": "theta1", "arm_2": "theta2", "arm_3": "theta3"}


@pytest.fixture(scope="module")
def F() -> rp.InverseFunction:
    task = rp.Robot.load("planar3r").task("tool", "xy")
    q0 = np.array([0.3, 0.8, 0.8])
    options = rp.FitOptions(samples=64, held_out=64)
    cell = rp.Cell(task, task.placement(q0), 0.1)
    return rp.nearest_inverse_function(
        rp.Pseudoinverse(task), cell, degree=2, options=options
    ).function


def asked(F: rp.InverseFunction, x: pin.SE3, leaf: Any = None, **changes: Any) -> Any:
    p, r = x.translation, pin.Quaternion(x.rotation)
    pose = Message(
        position=Message(x=p[0], y=p[1], z=p[2]), orientation=Message(x=r.x, y=r.y, z=r.z, w=r.w)
    )
    frame = changes.pop("frame_id", "base")
    stamped = Message(header=Message(frame_id=frame), pose=pose)
    request = Message(
        pose_stamped=stamped, **{"ik_link_name": "", "avoid_collisions": False} | changes
    )
    response = Message(
        solution=Message(joint_state=Message(name=[], position=[])), error_code=Message(val=0)
    )
    return answer(F, request, response, names=NAMES, base="base", leaf=leaf)


def test_a_pose_of_the_cell_is_answered(F: rp.InverseFunction) -> None:
    x = F.cell.at([0.3, -0.4])
    for leaf in (None, np.array([0.1])):
        response = asked(F, x, leaf, avoid_collisions=True)
        assert response.error_code.val == SUCCESS
        assert response.solution.joint_state.name == list(NAMES)
        assert response.solution.joint_state.position == F(x, leaf=leaf).tolist()


def test_what_cannot_be_answered_has_an_error_code(F: rp.InverseFunction) -> None:
    x, far = F.cell.at([0.3, -0.4]), F.cell.at([1.0, 1.0])
    far.translation[:] += 0.01
    assert asked(F, far).error_code.val == NO_SOLUTION
    assert asked(F, pin.SE3(np.eye(3), np.full(3, np.nan))).error_code.val == NO_SOLUTION
    assert asked(F, x, np.array([50.0])).error_code.val == NO_SOLUTION
    assert asked(F, x, ik_link_name="elbow").error_code.val == WRONG_LINK
    response = asked(F, x, frame_id="table")
    assert response.error_code.val == WRONG_FRAME and not response.solution.joint_state.name
