"""The adapter has the interface of LeRobot's ``RobotKinematics``, and F's numbers in degrees."""

from __future__ import annotations

import inspect
from typing import Protocol, runtime_checkable

import numpy as np
import pytest
from cell_functions import function_of

import repctl_pin as rp
from repctl_pin.extensions.integrations.lerobot import FunctionKinematics


@runtime_checkable
class RobotKinematics(Protocol):
    """The public methods of lerobot.model.kinematics.RobotKinematics, as of LeRobot 0.4."""

    joint_names: list[str]

    def forward_kinematics(self, joint_pos_deg: np.ndarray) -> np.ndarray: ...

    def inverse_kinematics(
        self,
        current_joint_pos: np.ndarray,
        desired_ee_pose: np.ndarray,
        position_weight: float = 1.0,
        orientation_weight: float = 0.01,
    ) -> np.ndarray: ...


@pytest.fixture(scope="module")
def function() -> rp.InverseFunction:
    return function_of("poses")


def test_it_can_be_called_as_lerobots(function: rp.InverseFunction) -> None:
    ours = FunctionKinematics(function)
    assert isinstance(ours, RobotKinematics)
    for name in ("forward_kinematics", "inverse_kinematics"):
        theirs = inspect.signature(getattr(RobotKinematics, name)).parameters
        mine = inspect.signature(getattr(FunctionKinematics, name)).parameters
        assert [(p.name, p.default) for p in mine.values()] == [
            (p.name, p.default) for p in theirs.values()
        ]


def test_degrees_and_a_gripper(function: rp.InverseFunction) -> None:
    ours, cell = FunctionKinematics(function), function.cell
    now = np.array([*np.full(7, 12.0), 42.0])
    for u in 0.9 * cell.sample(8, seed=3):
        x = cell.at(u).homogeneous
        degrees = ours.inverse_kinematics(now, x)
        assert degrees[7] == 42.0
        assert np.allclose(np.deg2rad(degrees[:7]), function(x), rtol=0, atol=1e-12)
        assert np.abs(ours.forward_kinematics(degrees) - x).max() < 1e-9
    assert (now[:7] == 12.0).all()


def test_the_leaf_is_the_elbow(function: rp.InverseFunction) -> None:
    x = function.cell.placement.homogeneous
    moved = FunctionKinematics(function, leaf=[0.1]).inverse_kinematics(np.zeros(7), x)
    assert np.allclose(np.deg2rad(moved), function(x, leaf=[0.1]), rtol=0, atol=1e-12)


def test_prismatic_joints_stay_in_metres() -> None:
    task = rp.Robot.load("ppr").task(None, "xy")
    cell = rp.Cell(task, task.placement(task.reference), 0.1)
    found = rp.nearest_inverse_function(rp.Pseudoinverse(task), cell)
    ours, x = FunctionKinematics(found.function), cell.at([0.5, -0.5])
    joints = ours.inverse_kinematics(np.zeros(task.n), x.homogeneous)
    q = np.where(task.revolute, np.deg2rad(joints), joints)
    assert np.allclose(q, found.function(x), rtol=0, atol=1e-12)


def test_what_is_refused(function: rp.InverseFunction) -> None:
    ours = FunctionKinematics(function)
    with pytest.raises(rp.InputError, match="needs 7 joint positions"):
        ours.forward_kinematics(np.zeros(5))
    outside = function.cell.placement.homogeneous
    outside[0, 3] += 1.0
    with pytest.raises(rp.InputError, match="outside the cell"):
        ours.inverse_kinematics(np.zeros(7), outside)
    with pytest.raises(rp.InputError, match="a cell's function"):
        FunctionKinematics(function.cell)
