"""Two hands and one waist: a design closes where J⁺ drifts; a tray; frames on one chain."""

import numpy as np
import pytest

import repctl_pin as rp


def circle(task, q0):
    return rp.circle(task, q0, 0.08)


def regular_start(task, count=200):
    """Draw configurations within the limits and take that of the largest σ_min(J)."""
    lower, upper = task.lower, task.upper
    lower, upper = np.maximum(lower, -9), np.minimum(upper, 9)
    space = np.minimum(0.3, 0.2 * (upper - lower))
    spread = np.random.default_rng(0).normal(size=(count, task.n))
    Q = np.clip(task.reference + 0.5 * spread, lower + space, upper - space)
    smallest = np.linalg.svd(task.jacobians(Q), compute_uv=False)[:, -1]
    return Q[smallest.argmax()]


def closed_and_plain(task, paths, cycles=10, steps=300):
    """Design over a tube around the first cycle of J⁺ and follow the paths with both."""
    q0 = regular_start(task)
    path, plain = rp.several_paths(task, q0, paths), rp.Pseudoinverse(task)
    drifted = rp.follow(plain, path, q0, cycles=cycles, steps=300)
    tube = rp.Tube(drifted.q[:301:10], 0.02)
    options = rp.FitOptions(samples=1024, held_out=1024)
    design = rp.nearest_repeatable(plain, None, tube, degree=1, options=options)
    closed = rp.follow(design.inverse, path, q0, cycles=cycles, steps=steps)
    return drifted, closed


@pytest.mark.slow
@pytest.mark.parametrize("both", [False, True])
def test_talos_comes_back_with_both_hands_and_its_waist(both):
    hands = ["gripper_left_base_link", "gripper_right_base_link"]
    task = rp.Robot.load("talos").task(hands)
    drifted, closed = closed_and_plain(task, [circle, circle if both else None])
    assert drifted.drift[-1] > 0.1
    assert closed.drift[-1] < 1e-9
    assert closed.tracking_error.max() < 1e-6


@pytest.mark.slow
def test_a_tray_keeps_its_pose_between_the_hands_while_they_move():
    robot = rp.Robot.load("baxter")
    task = robot.task(["left_gripper", ("right_gripper", "pose", "left_gripper")])
    drifted, closed = closed_and_plain(task, [circle, None], cycles=3)
    assert drifted.drift[-1] > 1e-3
    assert closed.drift[-1] < 1e-9
    held = task.placements(closed.q[0])[1]
    relative = [held.actInv(task.placements(q)[1]).homogeneous for q in closed.q[::50]]
    np.testing.assert_allclose(relative, np.tile(np.eye(4), (len(relative), 1, 1)), atol=1e-9)


def test_elbow_and_hand_on_one_chain_come_back():
    task = rp.Robot.load("panda").task([("panda_link4", "xy"), ("panda_link8", "position")])
    assert (task.m, task.r) == (5, 2)
    drifted, closed = closed_and_plain(task, [None, circle], cycles=3, steps=600)
    assert drifted.drift[-1] > 1e-3
    assert closed.drift[-1] < 1e-9
