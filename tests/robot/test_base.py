"""Placements measured from any link: against the two absolute placements, finite differences, and
Pinocchio's M."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from arms import KINDS

import repctl_pin as rp

FROM, TO = "left_gripper", "right_gripper"


@pytest.fixture(scope="module")
def baxter() -> rp.Robot:
    return rp.Robot.load("baxter", base=FROM)


@pytest.mark.parametrize("kind", KINDS)
def test_one_hand_seen_from_the_other(baxter: rp.Robot, kind: str) -> None:
    task, still = baxter.task(TO, kind), rp.Robot.load("baxter")
    left, right = still.task(FROM), still.task(TO)
    assert task.n == 14 and task.joint_names == (*left.joint_names[::-1], *right.joint_names)
    q = task.reference + 0.3 * np.random.default_rng(1).normal(size=14)
    expected = left.placement(q[:7][::-1]).inverse() * right.placement(q[7:])
    assert np.allclose(task.placement(q).homogeneous, expected.homogeneous, atol=1e-13)
    e, J, H = 1e-6, task.jacobian(q), task.hessian(q)
    for k, d in enumerate(e * np.eye(14)):
        moved = task.error(q - d, task.placement(q + d)) / (2 * e)
        assert np.allclose(moved, J[:, k], atol=2e-9 if kind != "axis" else 1e-5)
        assert np.allclose(
            H[:, :, k], (task.jacobian(q + d) - task.jacobian(q - d)) / (2 * e), atol=2e-9
        )


def test_the_inertia_is_that_of_the_whole_robot_with_its_root_still(baxter: rp.Robot) -> None:
    task, still = baxter.task(TO), rp.Robot.load("baxter")
    q = task.reference + 0.3 * np.random.default_rng(2).normal(size=14)
    M, left, right = task.inertias([q])[0], still.task(FROM), still.task(TO)
    assert np.allclose(M[:7, :7], left.inertias([q[6::-1]])[0][::-1, ::-1], atol=1e-12)
    assert np.allclose(M[7:, 7:], right.inertias([q[7:]])[0], atol=1e-12)
    assert np.abs(M[:7, 7:]).max() == 0


def test_joint_origins_lie_on_the_joints(baxter: rp.Robot) -> None:
    task, still = baxter.task(TO), rp.Robot.load("baxter")
    q = np.array(task.reference)
    left = still.task(FROM)
    to_base = left.placement(q[6::-1]).inverse()
    expected = [to_base * p for p in left.joint_origins(q[6::-1])][::-1]
    assert np.allclose(task.joint_origins(q)[:7], expected, atol=1e-12)
    axes = task.axes(q)
    assert np.allclose(axes[:7], -(left.axes(q[6::-1]) @ to_base.rotation.T)[::-1], atol=1e-12)


def test_a_frame_above_its_base_and_the_default_frame(baxter: rp.Robot) -> None:
    base = baxter.task("base", "position")
    assert base.n == 7
    q = np.array(base.reference)
    left = rp.Robot.load("baxter").task(FROM)
    assert np.allclose(
        base.placement(q).homogeneous, left.placement(q[::-1]).inverse().homogeneous, atol=1e-13
    )


def test_the_drawing_stands_at_the_root_although_the_base_moves(baxter: rp.Robot) -> None:
    """It is the drawing without a base; relative to the base it is where the task is."""
    from page_file import Visuals

    task, visuals, own = baxter.task(TO), Visuals.of(baxter), Visuals.of(rp.Robot.load("baxter"))
    Q = task.reference + 0.2 * np.random.default_rng(3).normal(size=(3, 14))
    placed = visuals.placements(task.to_robot(Q))
    assert np.array_equal(placed, own.placements(task.to_robot(Q)))
    links = [shape.link for shape in visuals.shapes]
    still = rp.Robot.load("baxter")
    left = still.task(FROM).placement(Q[0, 6::-1])
    other = baxter.task("right_upper_shoulder", "pose")
    shape = links.index("right_upper_shoulder")
    on_link = still.task("right_upper_shoulder").placement(Q[0, 7:8]).inverse().homogeneous
    on_link = on_link @ placed[0, shape]
    moved = left.homogeneous @ other.placement(Q[0, :8]).homogeneous @ on_link
    assert np.allclose(placed[0, shape], moved, atol=1e-12)


def test_a_relative_cycle_closes(baxter: rp.Robot) -> None:
    task = baxter.task(TO, "pose")
    q0 = task.reference + np.tile([0.3, -0.6, 0.4, 1.0, -0.5, 0.8, 0.2], 2)
    design = rp.nearest_repeatable(
        rp.Pseudoinverse(task),
        rp.Polynomial(q0, 1, 0.1),
        rp.Box(q0, 0.1),
        options=rp.FitOptions(samples=256, held_out=512),
    )
    motion = rp.follow(design.inverse, rp.circle(task, q0, radius=0.03), q0, cycles=2, steps=100)
    assert motion.drift[-1] < 1e-7 and motion.tracking_error.max() < 1e-7


PLANAR = """<robot name="rover"><link name="world"/><link name="cart"/><link name="tool"/>
<joint name="drive" type="{kind}"><parent link="world"/><child link="cart"/>
<origin xyz="0 0 0.2" rpy="0.1 0.2 0.3"/>
<axis xyz="{axis}"/></joint>
<joint name="arm" type="revolute"><parent link="cart"/><child link="tool"/>
<origin xyz="0.3 0.1 0.5"/>
<axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""


@pytest.mark.parametrize("kind", ["planar", "floating"])
def test_joints_of_several_numbers_are_joints_of_one(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "rover.urdf"
    path.write_text(PLANAR.format(kind=kind, axis="0 0 1"))
    robot = rp.Robot.load(path)
    suffixes = ["x", "y", "yaw"] if kind == "planar" else ["x", "y", "z", "yaw", "pitch", "roll"]
    assert robot.joint_names == (*(f"drive_{s}" for s in suffixes), "arm")
    assert f"joint 'drive' is {kind}: read as drive_x, drive_y" in robot.description.notes[0]
    q = np.linspace(0.3, -0.8, len(robot.joint_names))
    model = pin.buildModelFromUrdf(str(path))
    if kind == "planar":
        theirs = [q[0], q[1], np.cos(q[2]), np.sin(q[2]), q[3]]
    else:
        turn = pin.Quaternion(pin.rpy.rpyToMatrix(q[5], q[4], q[3])).coeffs()
        theirs = [*q[:3], *turn, q[6]]
    data = model.createData()
    pin.framesForwardKinematics(model, data, np.array(theirs))
    expected = data.oMf[model.getFrameId("tool", pin.FrameType.BODY)]
    assert np.allclose(
        robot.task("tool").placement(q).homogeneous, expected.homogeneous, atol=1e-14
    )
    assert rp.Robot.load(path, base="cart").chain("tool") == ("arm",)
    assert rp.Robot.load(path, lock=["drive_x"]).chain("tool") == tuple(
        n for n in robot.joint_names if n != "drive_x"
    )


def test_a_planar_joint_moves_across_its_axis_and_turns_about_it(tmp_path: Path) -> None:
    a = np.array([0.48, -0.6, 0.64])
    path = tmp_path / "rover.urdf"
    path.write_text(
        PLANAR.format(kind="planar", axis="0.48 -0.6 0.64").replace('rpy="0.1 0.2 0.3"', "")
    )
    task = rp.Robot.load(path).task("cart", "pose")
    J = task.jacobian(np.array([0.2, -0.3, 0.9]))
    assert np.allclose(J[:3, :2].T @ J[:3, :2], np.eye(2), atol=1e-12) and np.allclose(
        a @ J[:3, :2], 0, atol=1e-12
    )
    assert np.allclose(J[3:, 2], a, atol=1e-12)
    path.write_text(PLANAR.format(kind="planar", axis="0 0 1").replace('<axis xyz="0 0 1"/>', ""))
    with pytest.raises(rp.InputError, match="planar joint requires an <axis>"):
        rp.Robot.load(path)
