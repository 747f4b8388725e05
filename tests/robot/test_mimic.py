"""Joints that mimic others: against Pinocchio's own mimic model, finite differences, and the same
arm written out."""

from __future__ import annotations

import pickle
import shutil
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from commands import main
from controls import in_numpy, some
from mimic_arm import MIMICS, arm

import repctl_pin as rp


@pytest.fixture
def robot(tmp_path: Path) -> rp.Robot:
    return rp.Robot.load(arm(tmp_path, MIMICS))


def pinocchios(robot: rp.Robot, q: np.ndarray) -> tuple[pin.Model, pin.Data, np.ndarray]:
    """Pinocchio's own mimic model, evaluated at the robot's q."""
    model = pin.buildModelFromUrdf(str(robot.description.path), True)
    full = pin.neutral(model)
    for name, value in zip(robot.joint_names, q, strict=True):
        full[model.joints[model.getJointId(name)].idx_q] = value
    data = model.createData()
    pin.computeJointJacobians(model, data, full)
    pin.framesForwardKinematics(model, data, full)
    return model, data, full


@pytest.mark.parametrize("kind", ["pose", "axis", "position", "xz"])
def test_task_is_that_of_pinocchios_mimic_model(robot: rp.Robot, kind: str) -> None:
    task = robot.task("l7", kind)
    assert task.joint_names == robot.chain("l7") == ("j1", "j2", "j5", "j7")
    q = np.array([0.4, -0.7, 0.9, 0.3])
    model, data, full = pinocchios(robot, q)
    frame = model.getFrameId("l7", pin.FrameType.BODY)
    assert np.allclose(task.placement(q).homogeneous, data.oMf[frame].homogeneous, atol=1e-14)
    J = pin.getFrameJacobian(model, data, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
    columns = [model.joints[model.getJointId(name)].idx_v for name in task.joint_names]
    if kind != "axis":
        assert np.allclose(task.jacobian(q), J[task.rows][:, columns], atol=1e-14)
    assert np.allclose(
        task.jacobians([q, 0.5 * q]), [task.jacobian(q), task.jacobian(0.5 * q)], atol=1e-15
    )
    assert np.allclose(
        task.inertias([q])[0], pin.crba(model, data, full)[np.ix_(columns, columns)], atol=1e-12
    )
    for k, d in enumerate(1e-6 * np.eye(4)):
        slope = (task.jacobian(q + d) - task.jacobian(q - d)) / 2e-6
        assert np.allclose(task.hessian(q)[:, :, k], slope, atol=1e-9)


def test_in_a_control_step(robot: rp.Robot) -> None:
    task = robot.task("l7", "position")
    q, xdot = np.array([0.4, -0.7, 0.9, 0.3]), np.array([0.3, -0.2, 0.5])
    for one in (task, pickle.loads(pickle.dumps(task))):
        V = rp.redundancy.nullspace(one.jacobian(q))
        h = rp.Polynomial(q, 1).weighted(V / np.sqrt(3))
        qdot = np.linalg.pinv(one.jacobian(q)) @ xdot
        for control in (rp.Pseudoinverse(one), rp.RepeatableInverse(one, h)):
            found = control.velocity(q, xdot)
            assert np.allclose(found, qdot, rtol=1e-12, atol=1e-13)


def test_limits_keep_followers_inside_theirs(tmp_path: Path) -> None:
    joints = {"j3": {"lower": -0.5, "upper": 0.8, "speed": 0.2}, "j6": {"lower": 3, "upper": 4}}
    robot = rp.Robot.load(arm(tmp_path, MIMICS, **joints))
    lower, upper, speed = (
        dict(zip(robot.joint_names, v, strict=True))
        for v in (robot.lower, robot.upper, robot.velocity_limit)
    )
    # j3 = 0.3 − j2/2
    assert (lower["j2"], upper["j2"], speed["j2"]) == pytest.approx((-1.0, 1.6, 0.4))
    assert (lower["j5"], upper["j5"]) == (-2, 2)
    assert ["of joint 'j6' ignored: no position of 'j5'" in note for note in robot.warnings] == [
        True
    ]
    assert (robot.reference >= robot.lower).all() and (robot.reference <= robot.upper).all()


def test_a_follower_of_a_follower_whose_leader_comes_last(tmp_path: Path) -> None:
    chained = {
        1: 'joint="j3" multiplier="2" offset="0.1"',
        3: 'joint="j7" multiplier="-0.5" offset="0.2"',
    }
    direct = {
        1: 'joint="j7" multiplier="-1" offset="0.5"',
        3: 'joint="j7" multiplier="-0.5" offset="0.2"',
    }
    placements = []
    for mimics in (chained, direct):
        task = rp.Robot.load(arm(tmp_path, mimics)).task("l7", "pose")
        assert task.joint_names == ("j7", "j2", "j4", "j5", "j6")
        placements.append(task.placement(np.linspace(-0.5, 0.9, 5)).homogeneous)
    assert np.allclose(*placements, atol=1e-14)


def test_joints_in_a_circle_are_refused(tmp_path: Path) -> None:
    mimics = {1: 'joint="j3"', 3: 'joint="j7"', 7: 'joint="j1"'}
    with pytest.raises(
        rp.InputError, match=r"<mimic> of joint 'j1': joints mimic each other in a loop"
    ):
        rp.Robot.load(arm(tmp_path, mimics))


def test_a_held_leader_holds_its_followers(tmp_path: Path) -> None:
    path = arm(tmp_path, MIMICS)
    free, held = rp.Robot.load(path), rp.Robot.load(path, lock=["j2"])
    assert held.locked == ("j2", "j3") and "j2" not in held.joint_names
    q = free.task("l7").reference.copy()
    assert np.allclose(
        held.task("l7").placement(np.delete(q, 1)).homogeneous,
        free.task("l7").placement(q).homogeneous,
    )
    chosen = free.task("l7", "position", joints=["j1", "j5", "j7"])
    assert np.allclose(
        chosen.placement(np.delete(q, 1)).homogeneous, free.task("l7").placement(q).homogeneous
    )


def test_a_leader_beside_the_path_moves_the_frame() -> None:
    """The right finger of a panda follows the left one, and carries a task too."""
    task = rp.Robot.load("panda").task("panda_rightfinger", "position")
    assert task.joint_names[-1] == "panda_finger_joint1" and task.n == 8
    q, d = np.array(task.reference), 1e-3 * np.eye(8)[7]
    moved = task.placement(q + d).translation - task.placement(q).translation
    assert np.linalg.norm(moved) == pytest.approx(1e-3)
    assert np.allclose(task.jacobian(q) @ d, moved, atol=1e-12)
    assert np.abs(task.hessian(q)[:, 7, 7]).max() == 0


def test_a_cycle_closes_and_an_active_joint_drives_both(robot: rp.Robot) -> None:
    task = robot.task("l7", "xy")
    q0 = np.array([0.4, -0.7, 0.9, 0.3])
    design = rp.nearest_repeatable(
        rp.Pseudoinverse(task), rp.Polynomial(q0, 2, 0.3), rp.Box(q0, 0.3)
    )
    motion = rp.follow(design.inverse, rp.circle(task, q0, radius=0.05), q0, cycles=2, steps=200)
    assert motion.drift[-1] < 1e-8 and motion.tracking_error.max() < 1e-8
    tip = pinocchios(robot, motion.q[100])[1].oMf[-1].translation
    assert np.allclose(tip, task.positions(motion.q[100:101])[0], atol=1e-12)


def test_inspect_says_who_drives_whom(robot: rp.Robot, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["inspect", str(robot.description.path)]) == 0
    text = capsys.readouterr().out
    assert "mimic joints: j3 (follows j2), j4 (follows j1), j6 (follows j5)" in text


@pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")
@pytest.mark.parametrize("base", some([None, "l2"], "l2"))
def test_c_computes_the_same(robot: rp.Robot, base: str | None) -> None:
    task = rp.Robot.load(robot.description.path, base=base).task("l7", "xy")
    q0 = 0.3 + 0.2 * np.arange(task.n)
    design = rp.nearest_repeatable(
        rp.Pseudoinverse(task), rp.Polynomial(q0, 1, 0.1), rp.Box(q0, 0.1)
    )
    plain = in_numpy(design.inverse)
    xdot = np.array([0.1, -0.2])
    assert np.allclose(
        plain.velocity(q0 + 0.05, xdot), design.inverse.velocity(q0 + 0.05, xdot), atol=1e-12
    )
