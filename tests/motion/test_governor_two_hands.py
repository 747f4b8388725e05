"""The governor of several frames: one motion of both hands, within the limits of all joints."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from controls import control
from two_armed import Q0, two_armed

import repctl_pin as rp

DT, A, J = 0.002, 6.0, 400.0
LIMITS = rp.Limits(acceleration=A, jerk=J)  # speeds: 2 rad/s, by the URDF


def moved(place: pin.SE3, *by: float) -> pin.SE3:
    return pin.SE3(place.rotation, place.translation + np.array([*by, 0.0]))


def governed(inverse: rp.RepeatableInverse, **more: object) -> rp.Governor:
    governor = rp.Governor(inverse, DT, LIMITS, **more)  # type: ignore[arg-type]
    governor.start(Q0)
    return governor


def until(governor: rp.Governor, target: object, most: int = 4000) -> np.ndarray:
    """Ticks to a target, of which the last one reaches it."""
    Q = [governor.q]
    for _ in range(most):
        q, status = governor.step(target)  # type: ignore[arg-type]
        Q.append(q)
        if status is rp.Status.OK:
            return np.array(Q)
    raise AssertionError(f"not reached: {status}")


def test_limits_are_kept_and_the_joints_come_back_whatever_came_in(tmp_path: Path) -> None:
    """Jumps, targets out of reach, garbage of one hand alone; home in between."""
    inverse = two_armed(tmp_path)
    task, governor = inverse.task, governed(inverse, margin=0.1)
    rng, home, Q, seen = np.random.default_rng(4), task.placements(Q0), [Q0] * 4, set()
    for k in range(24):
        target = [moved(x, *rng.normal(size=2) * [0.1, 1.0][k % 2]) for x in home]
        if k % 6 == 4:
            target[k // 6 % 2] = moved(home[0], np.nan, 0.0)
        twist = rng.normal(size=(2, 6)) * [0.1, 50.0][k % 2] if k % 3 == 0 else None
        for _ in range(120):
            q, status = governor.step(None if k % 3 == 0 else target, twist)
            seen.add(status)
            Q.append(q)
        if k % 8 == 7:
            back = until(governor, home)
            assert np.abs(back[-1] - Q0).max() < 1e-9
            Q += list(back[1:])
    assert {rp.Status.SLOWED, rp.Status.OK, rp.Status.BAD_NUMBER} < seen
    for k, most in enumerate((2.0, A, J), 1):
        used = np.abs(np.diff(Q, k, axis=0)) / DT**k
        assert 0.5 * most < used.max() <= most * (1 + 1e-9)
    assert task.limit_margin(np.array(Q)).min() >= 0.1 - 1e-9
    leaves = [inverse.leaf(q) for q in Q[::10]]
    assert np.abs(leaves - governor.leaf).max() < 1e-9


def test_hands_that_move_alike_stay_apart_as_they_are(tmp_path: Path) -> None:
    """All frames have done the same share of their lines at any time."""
    inverse = two_armed(tmp_path)
    task, governor = inverse.task, governed(inverse)
    for way in ([0.1, -0.2], [-0.15, 0.1]):
        start = np.array(task.placements(governor.q)[0].translation)
        goal = [moved(x, *way) for x in task.placements(governor.q)]
        Q = until(governor, goal)
        assert len(Q) > 100 and np.abs(task.error(Q[-1], goal)).max() < 1e-9
        left, right = np.swapaxes([[x.translation for x in task.placements(q)] for q in Q], 0, 1)
        assert np.abs(right - left - (right - left)[0]).max() < 1e-9
        shares = (left - start)[:, :2] @ way / np.dot(way, way)
        assert np.abs((left - start)[:, :2] - shares[:, None] * way).max() < 1e-9
        assert np.diff(shares).min() > -1e-9


def test_a_hand_that_is_placed_relative_to_the_other_one_rides_with_it() -> None:
    """A tray: a twist of the left hand alone, and none between the hands."""
    robot = rp.Robot.load("baxter")
    task = robot.task([("left_gripper", "axis"), ("right_gripper", "pose", "left_gripper")])
    arm = np.array([0.3, -0.6, 0.0, 1.2, 0.0, 0.9, 0.0])
    q0 = np.concatenate([arm, arm * [-1, 1, 1, 1, 1, 1, 1]])
    inverse = control(task, q0, rp.Polynomial(q0, 2, 0.5))
    governor = rp.Governor(inverse, DT, LIMITS)
    governor.start(q0)
    twist = np.array([[0.05, 0.0, -0.02, 0.1, -0.05, 0.0], np.zeros(6)])
    Q = [q0]
    for _ in range(300):
        q, status = governor.step(twist=twist)
        Q.append(q)
    assert status is rp.Status.OK
    held = [task.placements(q)[1].homogeneous for q in Q[::20]]
    assert np.abs(np.array(held) - held[0]).max() < 1e-9
    before, after = (task.placements(q)[0] for q in Q[-2:])
    v = (after.translation - before.translation) / DT
    np.testing.assert_allclose(v, twist[0, :3], atol=1e-6)


def test_two_hands_that_meet_are_stopped_before(tmp_path: Path) -> None:
    inverse, kept = two_armed(tmp_path), 0.03
    bodies = rp.Bodies(inverse.task)
    governor = governed(inverse, bodies=bodies, body_distance=kept)
    together = [[0, -0.4, 0, 0, 0, 0], [0, 0.4, 0, 0, 0, 0]]
    for _ in range(900):
        q, status = governor.step(twist=together)
    assert status is rp.Status.BODIES
    assert kept <= bodies.nearest(q).distance < kept + 0.004
    assert governor.nearest_bodies == ("left_3", "right_3")
    assert np.abs(until(governor, inverse.task.placements(Q0))[-1] - Q0).max() < 1e-9


@pytest.mark.parametrize("hand", [0, 1])
def test_an_input_of_one_hand_alone_is_heeded(hand: int, tmp_path: Path) -> None:
    """In a tick without a plan, too: one in two."""
    inverse = two_armed(tmp_path)
    home, twist = inverse.task.placements(Q0), np.zeros((2, 6))
    twist[hand, 0] = 0.01
    for x, said in ((0.02, rp.Status.SLOWED), (1e7, rp.Status.BAD_NUMBER)):
        target = [moved(each, x * (k == hand), 0.0) for k, each in enumerate(home)]
        governor = governed(inverse)
        assert governor.step(home)[1] is rp.Status.OK
        assert governor.step(target)[1] is said
    governor = governed(inverse)
    assert governor.step()[1] is rp.Status.OK
    assert governor.step(twist=twist)[1] is rp.Status.SLOWED


def test_wrong_inputs_are_refused_in_one_line(tmp_path: Path) -> None:
    inverse = two_armed(tmp_path)
    governor, home = governed(inverse), inverse.task.placements(Q0)
    assert "left + right" in repr(governor)
    pose = np.zeros((1, 3)), np.eye(3)[None]
    closes = rp.ClosingRadius(0.1, None, "start", "xy", Q0, *pose, 1, True, "")
    for call, words in (
        (lambda: governor.step(home[0]), r"must be 2 placements, one per frame \(left, right\)"),
        (lambda: governor.step([home[0]] * 3), "must be 2 placements"),
        (lambda: governor.step([home[0], np.eye(3)]), "target of right must be a placement"),
        (lambda: governor.step(twist=np.zeros(6)), r"6 numbers \(v, ω\) for each of left, right"),
        (lambda: governor.step(twist=np.zeros((6, 2))), "twist must be 6 numbers"),
        (lambda: governed(inverse, closes=closes), "a closing radius takes a task of one frame"),
    ):
        with pytest.raises(rp.InputError, match=words) as refused:
            call()
        assert "\n" not in str(refused.value)
    twists = np.arange(12.0) / 100
    stacked = governed(inverse).step(twist=twists)[0]
    np.testing.assert_array_equal(governed(inverse).step(twist=twists.reshape(2, 6))[0], stacked)
