"""The clutch of teleoperation: no jump at engage and release, and no drift of the arm."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from arms import Q_PANDA
from controls import control, some

import repctl_pin as rp

Q0 = np.array([0.3, 0.8, 0.8])
RNG = np.random.default_rng(0)


def pose(turn: float = 3.0, size: float = 1.0) -> pin.SE3:
    """Random placement."""
    axis = RNG.normal(size=3)
    angle = turn * RNG.random() * axis / np.linalg.norm(axis)
    return pin.SE3(pin.exp3(angle), size * RNG.normal(size=3))


def same(a: pin.SE3, b: pin.SE3) -> bool:
    return bool((a.homogeneous == b.homogeneous).all())


def test_the_first_target_is_the_arm_and_no_target_jumps() -> None:
    axes = pin.exp3(np.array([0.4, -1.0, 0.3]))
    clutch = rp.Clutch(scale=0.5, rotation_scale=0.7, axes=axes)
    assert not clutch.engaged and clutch.target(pose()) is None
    for _ in range(50):
        hand, at = pose(), pose()
        clutch.engage(hand, at)
        first = clutch.target(hand)
        assert first is not None and same(first, at)
        w, v = RNG.normal(size=3), RNG.normal(size=3)
        moved = clutch.target(pin.SE3(pin.exp3(w) @ hand.rotation, hand.translation + v))
        assert moved is not None
        way = moved.translation - at.translation
        np.testing.assert_allclose(way, 0.5 * axes @ v, atol=1e-12)
        if np.linalg.norm(w) < np.pi / 2:
            turn = pin.log3(moved.rotation @ at.rotation.T)
            np.testing.assert_allclose(turn, 0.7 * axes @ w, atol=1e-9)
        clutch.release()
        assert not clutch.engaged and clutch.target(hand) is None


def test_turns_beyond_half_a_turn_go_on() -> None:
    """A hand that turns by 3 turns turns the arm by 0.4 times as much, without a jump."""
    clutch = rp.Clutch(rotation_scale=0.4)
    hand, at, axis = pose(), pose(), np.array([0.6, 0.0, 0.8])
    clutch.engage(hand, at)
    before = at.rotation
    for angle in np.arange(0.0, 6 * np.pi, 0.1):
        turned = pin.SE3(pin.exp3(angle * axis) @ hand.rotation, hand.translation)
        target = clutch.target(turned)
        assert target is not None
        wanted = pin.exp3(0.4 * angle * axis) @ at.rotation
        np.testing.assert_allclose(target.rotation, wanted, atol=1e-9)
        assert np.linalg.norm(pin.log3(target.rotation @ before.T)) < 0.05
        before = target.rotation


@pytest.mark.parametrize("rounds", some([2, 4], 2))
def test_the_elbow_is_engaged_without_a_jump_and_scaled_as_the_hand(rounds: int) -> None:
    """Item 30.2: the level for the first point is that of the arm, wherever the elbow is."""
    axes, dt = pin.exp3(np.array([0.4, -1.0, 0.3])), 0.004
    task = rp.Robot.load("panda").task("panda_hand_tcp", "pose")
    inverse = control(task, Q_PANDA, rp.Polynomial(Q_PANDA, 2, 0.5))
    governor = rp.Governor(inverse, dt, rp.Limits(acceleration=6.0, jerk=400.0))
    governor.start(Q_PANDA)
    clutch, Q = rp.Clutch(scale=0.5, axes=axes), [Q_PANDA] * 4

    def tick(hand: pin.SE3, elbow: np.ndarray) -> rp.Status:
        place, point = clutch.target(hand), clutch.elbow(elbow)
        leaf = None
        if point is not None and place is not None:
            begin = inverse.solve(place, Q_PANDA)
            leaf = inverse.leaf_toward(begin, elbow=point).leaf
        q, status = governor.step(place, leaf=leaf)
        Q.append(q)
        return status

    for _ in range(rounds):
        hand, elbow = pose(), RNG.normal(size=3)
        before = governor.q
        own = inverse.elbow(before)
        clutch.engage(hand, task.placement(before), elbow=elbow, elbow_at=own)
        np.testing.assert_array_equal(clutch.elbow(elbow), own)
        assert tick(hand, elbow) is rp.Status.OK and np.abs(Q[-1] - before).max() < 1e-9
        way = axes.T @ np.array([0.0, 0.1, 0.05])
        np.testing.assert_allclose(clutch.elbow(elbow + way), own + [0, 0.05, 0.025], atol=1e-12)
        for share in np.linspace(0, 1, 8):
            moved = pin.SE3(hand.rotation, hand.translation + share * 0.2 * way)
            for _ in range(8):
                tick(moved, elbow + share * way)
        assert np.abs(Q[-1] - before).max() > 1e-3
        clutch.release()
        assert clutch.elbow(elbow) is None
        Q += [governor.step()[0] for _ in range(100)]
    for k, most in enumerate((6.0, 400.0), 2):
        assert np.abs(np.diff(Q, k, axis=0)).max() / dt**k <= most * (1 + 1e-9)


def test_a_lost_elbow_is_released_and_the_hand_goes_on() -> None:
    clutch, hand = rp.Clutch(), pose()
    assert clutch.elbow(np.zeros(3)) is None
    clutch.engage(hand, pose())
    assert clutch.elbow(np.zeros(3)) is None and clutch.target(hand) is not None
    for bad in (np.full(3, np.nan), [0.0, np.inf, 0.0]):
        clutch.engage(hand, pose(), elbow=np.zeros(3), elbow_at=np.ones(3))
        assert clutch.elbow(bad) is None and clutch.target(hand) is not None
        assert clutch.elbow(np.zeros(3)) is None  # found again: it must be engaged again
        clutch.engage(hand, pose(), elbow=bad, elbow_at=np.ones(3))
        assert clutch.elbow(np.zeros(3)) is None and clutch.target(hand) is not None
    clutch.engage(hand, pose(), elbow=np.zeros(3), elbow_at=np.ones(3))
    clutch.engage(hand, pose())
    assert clutch.elbow(np.zeros(3)) is None  # the second one has no elbow
    clutch.engage(hand, pose(), elbow=np.zeros(3), elbow_at=np.ones(3))
    clutch.target(pin.SE3(hand.rotation, hand.translation * np.nan))
    assert clutch.elbow(np.zeros(3)) is None  # the hand is lost


@pytest.mark.parametrize("bad", ["nan", "skewed"])
def test_a_lost_hand_releases_it(bad: str) -> None:
    clutch, hand = rp.Clutch(), pose()
    broken = hand.homogeneous
    broken[0, 3 if bad == "nan" else 0] = np.nan if bad == "nan" else 2.0
    clutch.engage(hand, pose())
    assert clutch.target(broken) is None and not clutch.engaged
    assert clutch.target(hand) is None  # found again: it must be engaged again
    clutch.engage(broken, pose())
    assert not clutch.engaged


def test_an_arm_comes_back_to_the_same_joints_however_often_it_is_released() -> None:
    """Tracked by a drifting hand, engaged and released 12 times, on one leaf, within the limits."""
    task, dt = rp.Robot.load("planar3r").task("tool", "xy"), 0.004
    inverse = control(task, Q0, rp.Polynomial(Q0, 2, 0.5))
    governor = rp.Governor(inverse, dt, rp.Limits(velocity=2.0, acceleration=6.0, jerk=400.0))
    governor.start(Q0)
    clutch, Q = rp.Clutch(scale=0.3), [Q0] * 4
    home = task.placement(Q0)

    def ticks(target: pin.SE3 | None, most: int) -> rp.Status:
        for _ in range(most):
            q, status = governor.step(target)
            Q.append(q)
            if status is rp.Status.OK:
                break
        return status

    for _ in range(12):
        hand = pose()
        clutch.engage(hand, task.placement(governor.q))
        way = 0.3 * RNG.normal(size=3)
        for share in np.linspace(0, 1, 60):
            hand_now = pin.SE3(hand.rotation, hand.translation + share * way)
            ticks(clutch.target(hand_now), 1)
        clutch.release()
        assert clutch.target(hand) is None
        Q += [governor.step()[0] for _ in range(150)]
        assert (Q[-1] == Q[-2]).all()  # at rest
        assert np.abs(inverse.leaf(Q[-1]) - inverse.leaf(Q0)).max() < 1e-9
    assert np.abs(Q[-1] - Q0).max() > 0.01
    hand, here = pose(), task.placement(governor.q)
    clutch.engage(hand, here)
    back = (home.translation - here.translation) / 0.3
    target = clutch.target(pin.SE3(hand.rotation, hand.translation + back))
    assert ticks(target, 2000) is rp.Status.OK
    assert np.abs(Q[-1] - Q0).max() < 1e-9
    for k, most in enumerate((2.0, 6.0, 400.0), 1):
        assert np.abs(np.diff(Q, k, axis=0)).max() / dt**k <= most * (1 + 1e-9)


def test_what_it_refuses() -> None:
    for arguments, words in (
        ({"scale": -1.0}, "scale must be 0 or more"),
        ({"rotation_scale": np.nan}, "rotation_scale must be"),
        ({"axes": np.eye(4)}, "axes must be a 3 × 3 rotation matrix"),
        ({"axes": np.diag([1, 1, -1.0])}, "rotation of axes is not a rotation matrix"),
    ):
        with pytest.raises(rp.InputError, match=words):
            rp.Clutch(**arguments)
    with pytest.raises(rp.InputError, match="hand must be a placement"):
        rp.Clutch().target(3)  # type: ignore[arg-type]
    with pytest.raises(rp.InputError, match="^elbow must be 3 numbers, m; got"):
        rp.Clutch().elbow([1.0, 2.0])
    for given, words in (
        ({"elbow": np.zeros(3)}, "elbow and elbow_at require each other"),
        ({"elbow_at": np.zeros(3)}, "elbow and elbow_at require each other"),
        ({"elbow": np.zeros(3), "elbow_at": "left"}, "elbow_at must be 3 numbers"),
    ):
        with pytest.raises(rp.InputError, match=words):
            rp.Clutch().engage(pose(), pose(), **given)  # type: ignore[arg-type]


@pytest.mark.parametrize("scale", some([0.5, 0.3, 1.7], 0.3))
@pytest.mark.parametrize("wobble", some([0.0, 0.01, 0.1], 0.01))
def test_many_turns_of_the_hand_move_the_target_without_a_jump(scale: float, wobble: float) -> None:
    """Item 26.3: beyond a full turn, the target jumped by 82 degrees."""
    for sign in (1, -1):
        clutch, at = rp.Clutch(rotation_scale=scale), pin.SE3.Identity()
        clutch.engage(at, at)
        last, step = at.rotation, 0.02
        for k in range(1, round(10 * 2 * np.pi / step)):
            tilt = pin.exp3(wobble * np.array([np.sin(0.013 * k), np.sin(0.017 * k), 0.0]))
            hand = pin.SE3(tilt @ pin.exp3(sign * step * k * np.array([0, 0, 1.0])), np.zeros(3))
            target = clutch.target(hand)
            if target is None:
                assert wobble and not clutch.engaged
                break
            assert np.linalg.norm(pin.log3(target.rotation @ last.T)) < 6 * scale * step
            last = target.rotation
        else:
            assert k > 3000
        assert k > 200  # no release within the first half turn
