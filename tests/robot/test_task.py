"""Kinematics against finite differences, against Pinocchio's own derivatives, and at the edges."""

from __future__ import annotations

import pickle

import numpy as np
import pinocchio as pin
import pytest
from arms import KINDS

import repctl_pin as rp

ARMS = ["panda", "kinova", "tiago", "talos"]  # n = 7, 6 (continuous joints), 8 (a lift), 9


def some_q(task: rp.Task, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return task.reference + 0.2 * rng.normal(size=task.n)


@pytest.fixture(scope="module", params=ARMS)
def robot(request: pytest.FixtureRequest) -> rp.Robot:
    return rp.Robot.load(request.param)


@pytest.mark.parametrize("kind", KINDS)
def test_jacobian_and_hessian_agree_with_finite_differences(robot: rp.Robot, kind: str) -> None:
    task = robot.task(None, kind)
    q, e = some_q(task), 1e-6
    J, H = task.jacobian(q), task.hessian(q)
    assert J.shape == (task.m, task.n)
    for k, d in enumerate(np.eye(task.n)):
        # J is the differential of f: of the task error between neighbours
        moved = (task.error(q - e * d, task.placement(q + e * d))) / (2 * e)
        if kind != "axis":  # the axis rows are written in the frame's own axes, which move too
            assert np.allclose(moved, J[:, k], atol=2e-9)
        else:
            half = task.error(q, task.placement(q + e * d)) / e
            assert np.allclose(half, J[:, k], atol=1e-5)
        slope = (task.jacobian(q + e * d) - task.jacobian(q - e * d)) / (2 * e)
        assert np.allclose(H[:, :, k], slope, atol=2e-9)


def test_hessian_agrees_with_pinocchio(robot: rp.Robot) -> None:
    """Pinocchio's own kinematic Hessian, its memory order put right, through another algorithm."""
    task = robot.task(None, "pose")
    q = some_q(task, 1)
    model, data = task.model, task.model.createData()
    frame = model.getFrameId(task.frame, pin.FrameType.BODY)
    pin.computeJointJacobians(model, data, q)
    pin.computeForwardKinematicsDerivatives(model, data, q, np.zeros(task.n), np.zeros(task.n))
    for k, e_k in enumerate(np.eye(task.n)):
        pin.computeJointJacobiansTimeVariation(model, data, q, e_k)
        slope = pin.getFrameJacobianTimeVariation(
            model, data, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        )
        assert np.allclose(task.hessian(q)[:, :, k], slope, atol=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_batches_are_what_single_calls_say(robot: rp.Robot, kind: str) -> None:
    task = robot.task(None, kind)
    Q = np.array([some_q(task, seed) for seed in range(5)])
    assert np.array_equal(task.jacobians(Q), [task.jacobian(q) for q in Q])
    assert np.allclose(task.hessians(Q), [task.hessian(q) for q in Q], atol=1e-15)
    assert np.array_equal(task.positions(Q), [task.placement(q).translation for q in Q])


def test_only_the_joints_that_move_the_frame_are_kept() -> None:
    baxter = rp.Robot.load("baxter")
    left, right = baxter.task("left_gripper"), baxter.task("right_gripper")
    assert left.n == right.n == 7
    assert not set(left.joint_names) & set(right.joint_names)
    assert all("left" in name for name in left.joint_names)


def test_a_task_moves_its_frame_as_the_whole_robot_does(robot: rp.Robot) -> None:
    task = robot.task(None, "pose")
    q = some_q(task, 2)
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, robot.coupling.joints(task.to_robot(q)))
    whole = data.oMf[robot.model.getFrameId(task.frame, pin.FrameType.BODY)]
    assert np.allclose(whole.homogeneous, task.placement(q).homogeneous, atol=1e-14)


def test_joints_can_be_chosen_and_locked(panda: rp.Robot) -> None:
    names = panda.chain("panda_hand_tcp")
    chosen = panda.task("panda_hand_tcp", "position", joints=names[:5])
    assert chosen.joint_names == names[:5]
    locked = rp.Robot.load("panda", lock=[names[2]])
    task = locked.task("panda_hand_tcp", "pose")
    assert names[2] not in task.joint_names and task.n == 6
    full = panda.task("panda_hand_tcp", "pose")
    q = np.delete(full.reference, 2)
    assert np.allclose(task.placement(q).homogeneous, full.placement(full.reference).homogeneous)


def test_base_holds_a_link_still_and_measures_in_it() -> None:
    whole = rp.Robot.load("tiago").task("wrist_ft_tool_link", "pose")
    arm = rp.Robot.load("tiago", base="torso_lift_link").task("wrist_ft_tool_link", "pose")
    assert arm.n == whole.n - 1
    q = some_q(whole, 3)
    lift = rp.Robot.load("tiago").task("torso_lift_link", "pose")
    expected = lift.placement(q[:1]).inverse() * whole.placement(q)
    assert np.allclose(arm.placement(q[1:]).homogeneous, expected.homogeneous, atol=1e-12)
    R = lift.placement(q[:1]).rotation
    turned = np.kron(np.eye(2), R.T) @ whole.jacobian(q)[:, 1:]
    assert np.allclose(arm.jacobian(q[1:]), turned, atol=1e-12)


def test_continuous_joints_are_one_number_without_limits() -> None:
    kinova = rp.Robot.load("kinova")
    task = kinova.task(None, "position")
    free = ~np.isfinite(task.lower)
    assert task.n == 6 and free.sum() == 3
    q = np.array(task.reference)
    turned = q + 2 * np.pi * free
    assert np.allclose(
        task.placement(q).homogeneous, task.placement(turned).homogeneous, atol=1e-12
    )
    assert task.check(turned).tolist() == turned.tolist()


def test_references_lie_within_limits(robot: rp.Robot) -> None:
    assert (robot.reference >= robot.lower).all() and (robot.reference <= robot.upper).all()


def test_inertia_is_symmetric_positive_and_gives_the_kinetic_energy(panda_pose: rp.Task) -> None:
    q, v = some_q(panda_pose), np.random.default_rng(0).normal(size=7)
    M = panda_pose.inertias(q[None])[0]
    assert np.array_equal(M, M.T) and np.linalg.eigvalsh(M)[0] > 0
    data = panda_pose.model.createData()
    assert np.isclose(
        0.5 * v @ M @ v, pin.computeKineticEnergy(panda_pose.model, data, q, v), rtol=1e-12
    )


def test_axis_error_turns_the_tool_axis_the_short_way(panda: rp.Robot) -> None:
    task = panda.task("panda_hand_tcp", "axis")
    q = np.array(task.reference)
    here = task.placement(q)
    spun = pin.SE3(here.rotation @ pin.exp3(np.array([0, 0, 1.0])), here.translation)
    assert np.abs(task.error(q, spun)).max() < 1e-12  # turning about the tool axis costs nothing
    tilted = pin.SE3(here.rotation @ pin.exp3(np.array([0.3, 0, 0])), here.translation)
    assert np.allclose(task.error(q, tilted), [0, 0, 0, 0.3, 0], atol=1e-12)
    flipped = pin.SE3(here.rotation @ pin.exp3(np.array([np.pi, 0, 0])), here.translation)
    assert np.isclose(np.linalg.norm(task.error(q, flipped)[3:]), np.pi)


def test_the_axis_error_of_tiny_angles_is_not_cut_off(panda: rp.Robot) -> None:
    """58: below 1e-12 rad it was 0, or about the wrong axis."""
    task, angles = panda.task("panda_hand_tcp", "axis"), 10.0 ** np.arange(-300, 0)
    q = np.array(task.reference)
    here, way = task.placement(q), np.array([0.6, 0.8, 0.0])
    goals = [here * pin.SE3(pin.exp3(angle * way), np.zeros(3)) for angle in [0.0, *angles]]
    due = np.array([0.0, *angles])[:, None] * way[:2]
    one = np.array([task.error(q, goal) for goal in goals])
    many = task.errors(np.tile(q, (len(goals), 1)), goals)
    for error in (one, many):
        assert np.abs(error[:, 3:] - due).max() < 1e-15


def test_a_task_pickles_to_the_same_numbers(panda_pose: rp.Task) -> None:
    again = pickle.loads(pickle.dumps(panda_pose))
    q = some_q(panda_pose)
    assert np.array_equal(again.jacobian(q), panda_pose.jacobian(q))


def test_bad_names_get_one_helpful_line(panda: rp.Robot) -> None:
    with pytest.raises(
        rp.InputError, match="no frame 'panda_hand_tpc'; did you mean 'panda_hand_tcp'"
    ):
        panda.task("panda_hand_tpc")
    with pytest.raises(rp.InputError, match="no task kind 'poses'; choose from pose, axis"):
        panda.task("panda_hand_tcp", "poses")
    with pytest.raises(rp.InputError, match="no joint 'panda_joint9'; did you mean"):
        panda.task("panda_hand_tcp", joints=["panda_joint9"])
    with pytest.raises(rp.InputError, match="does not move"):
        panda.task("panda_link3", "position", joints=["panda_joint7"])
    with pytest.raises(rp.InputError, match="no movable joint"):
        panda.task("panda_link0", "position")
    with pytest.raises(rp.InputError, match="did you mean"):
        rp.Robot.load("pandda")
    with pytest.raises(rp.InputError, match="no frame 'left_grippr'; did you mean 'left_gripper'"):
        rp.Robot.load("baxter", base="left_grippr")


def test_bad_configurations_get_one_helpful_line(panda_pose: rp.Task) -> None:
    q = np.array(panda_pose.reference)
    with pytest.raises(rp.InputError, match="3 numbers, but 'panda_hand_tcp' is moved by 7"):
        panda_pose.check(q[:3])
    with pytest.raises(rp.InputError, match="panda_joint2.* not a finite"):
        panda_pose.check(np.where(np.arange(7) == 1, np.nan, q))
    with pytest.raises(rp.InputError, match="panda_joint4 = 1 rad is outside its limits"):
        panda_pose.check(np.where(np.arange(7) == 3, 1.0, q))
    with pytest.raises(rp.InputError, match="shape"):
        panda_pose.jacobian(q[:6])
    with pytest.raises(rp.InputError, match="shape"):
        panda_pose.jacobians(q)


def test_the_unit_of_a_norm_over_the_joints() -> None:
    units = {
        name: rp.Robot.load(name).task(kind=kind).unit
        for name, kind in (("panda", "pose"), ("ppr", "xy"))
    }
    assert units == {"panda": "rad", "ppr": "rad and m"}
    assert rp.Robot.load("ppr").task(kind="xy", joints=["d1", "d2"]).unit == "m"
