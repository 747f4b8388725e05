"""A task of several frames: kinematics against Pinocchio and finite differences, and its door."""

from importlib import import_module
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import repctl_pin as rp

HANDS = ["gripper_left_base_link", "gripper_right_base_link"]
TASKS = {
    "both hands of talos": ("talos", HANDS),
    "kinds that differ": ("talos", [(HANDS[0], "axis"), (HANDS[1], "position")]),
    "a lift and two arms": ("pr2", ["l_gripper_tool_frame", "r_gripper_tool_frame"]),
    "a tray": ("talos", [(HANDS[0], "position"), (HANDS[1], "pose", "gripper_left_base_link")]),
    "arms that share nothing": ("baxter", ["left_gripper", "right_gripper"]),
}


@pytest.fixture(params=TASKS, scope="module")
def task(request):
    robot, frames = TASKS[request.param]
    return rp.Robot.load(robot).task(frames)


def configurations(task, count=4):
    spread = np.random.default_rng(3).normal(size=(count, task.n))
    return task.reference + 0.3 * spread


def test_the_hessian_is_the_derivative_of_the_jacobian(task):
    for q in configurations(task, 2):
        steps = 1e-6 * np.eye(task.n)
        slopes = [(task.jacobian(q + d) - task.jacobian(q - d)) / 2e-6 for d in steps]
        np.testing.assert_allclose(task.hessian(q), np.stack(slopes, -1), atol=1e-7)


def test_the_jacobian_is_minus_the_derivative_of_the_error(task):
    for q in configurations(task, 2):
        target, steps = task.placements(q), 1e-6 * np.eye(task.n)
        slopes = [(task.error(q - d, target) - task.error(q + d, target)) / 2e-6 for d in steps]
        np.testing.assert_allclose(task.jacobian(q), np.stack(slopes, -1), atol=1e-7)


def test_twists_are_the_derivatives_of_placements(task):
    Q, Qdot = configurations(task, 2), configurations(task, 4)[2:]
    for q, qdot, found in zip(Q, Qdot, task.twists(Q, Qdot), strict=True):
        ends = [task.placements(q + sign * 1e-6 * qdot) for sign in (1, -1)]
        for ahead, behind, twist in zip(*ends, found.reshape(-1, 6), strict=True):
            v = (ahead.translation - behind.translation) / 2e-6
            omega = pin.log3(ahead.rotation @ behind.rotation.T) / 2e-6
            np.testing.assert_allclose(twist, [*v, *omega], atol=1e-7)


def test_batches_equal_single_evaluations(task):
    Q = configurations(task)
    targets = [task.placements(q) for q in Q[::-1]]
    for many, one in (
        (task.jacobians(Q), [task.jacobian(q) for q in Q]),
        (task.hessians(Q), [task.hessian(q) for q in Q]),
        (task.errors(Q, targets), [task.error(q, x) for q, x in zip(Q, targets, strict=True)]),
        (
            task.positions(Q),
            [np.concatenate([x.translation for x in task.placements(q)]) for q in Q],
        ),
    ):
        np.testing.assert_allclose(many, np.array(one), rtol=0, atol=1e-13)


def test_the_jacobian_is_that_of_pinocchio():
    robot = rp.Robot.load("talos")
    task = robot.task(HANDS)
    whole, q = robot.model, configurations(task, 1)[0]
    data, q_whole = whole.createData(), robot.coupling.joints(task.to_robot(q))
    rows = []
    for name in HANDS:
        frame = whole.getFrameId(name)
        world = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        rows.append(pin.computeFrameJacobian(whole, data, q_whole, frame, world))
    columns = [whole.getJointId(name) - 1 for name in task.joint_names]
    np.testing.assert_allclose(task.jacobian(q), np.vstack(rows)[:, columns], atol=1e-13)


def test_one_frame_in_a_list_is_the_task_of_this_frame():
    robot = rp.Robot.load("talos")
    alone, listed = robot.task(HANDS[0], "axis"), robot.task([(HANDS[0], "axis")])
    q = configurations(alone, 1)[0]
    assert repr(alone) == repr(listed)
    assert np.array_equal(alone.jacobian(q), listed.jacobian(q))
    assert alone.frames == (HANDS[0],) and alone.single_tasks == (alone,)


def test_frames_that_share_no_joint_are_told():
    robot = rp.Robot.load("baxter")
    assert "independent tasks" in str(robot.task(["left_gripper", "right_gripper"]))
    assert "independent tasks" not in str(rp.Robot.load("talos").task(HANDS))


def test_the_relative_placement_is_that_of_the_hands():
    robot = rp.Robot.load("talos")
    tray = robot.task([(HANDS[0], "position"), (HANDS[1], "pose", HANDS[0])])
    both, q = robot.task(HANDS), configurations(tray, 1)[0]
    left, right = both.placements(both.from_robot(tray.to_robot(q)))
    np.testing.assert_allclose(
        tray.placements(q)[1].homogeneous, left.actInv(right).homogeneous, atol=1e-12
    )


@pytest.mark.parametrize(
    ("frames", "message"),
    [
        (["nowhere", HANDS[0]], "no frame 'nowhere'"),
        ([HANDS[0], HANDS[0]], "given twice"),
        ([HANDS[0], 3], "3 is not a frame"),
        ([(HANDS[0], "attitude")], "no task kind 'attitude'"),
        ([(HANDS[0], "pose", "nowhere"), HANDS[1]], "no frame 'nowhere'"),
        ([], "empty"),
        ([*HANDS, ("torso_2_link", "pose")], "not redundant"),
    ],
)
def test_frames_that_cannot_be_used_are_named_in_one_line(frames, message):
    with pytest.raises(rp.InputError, match=message) as refused:
        rp.Robot.load("talos").task(frames)
    assert "\n" not in str(refused.value)


def test_a_target_of_several_frames_has_one_placement_per_frame():
    task = rp.Robot.load("talos").task(HANDS)
    q = configurations(task, 1)[0]
    left, right = task.placements(q)
    assert np.abs(task.error(q, [left, right.homogeneous])).max() < 1e-12
    for wrong in (left, [left], [left, right, left], left.homogeneous):
        with pytest.raises(rp.InputError, match="2 placements, one per frame"):
            task.error(q, wrong)
    with pytest.raises(rp.InputError, match="use placements"):
        task.placement(q)
    with pytest.raises(rp.InputError, match="target"):
        rp.Robot.load("talos").task(HANDS[0]).error(q[:9], (left, right))


@pytest.mark.parametrize("native", ["yes", "no"])
@pytest.mark.parametrize(
    ("name", "frames"),
    [
        ("panda", None),
        ("tiago", [("wrist_ft_tool_link", "axis")]),
        ("panda", [("panda_link4", "xy"), ("panda_link8", "position")]),
        ("baxter", [("left_gripper", "axis"), ("right_gripper", "pose")]),
    ],
)
def test_jacobians_of_many_configurations_in_c_are_pinocchios(
    name: str, frames: Any, native: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """C holds each frame's position and rotation beside the Jacobian, whether asked for or not."""
    monkeypatch.setenv("REPCTL_NATIVE", native)
    room = import_module(f"{rp.Task.__module__.rpartition('.')[0]}.native_kinematics")
    task = rp.Robot.load(name).task(frames)
    Q = task.reference + np.random.default_rng(4).uniform(-1, 1, (300, task.n))
    J = room.jacobians(task, Q)
    np.testing.assert_allclose(J, task.jacobians(Q), rtol=0, atol=3e-15)
    assert np.array_equal(J, task.jacobians(Q)) == (native == "no")
    assert room.jacobians(task, Q[:0]).shape == (0, task.m, task.n)
