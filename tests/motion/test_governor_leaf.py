"""Pose and level are one target: the elbow moves at every tick, within all limits."""

from __future__ import annotations

import pickle
from functools import cache

import numpy as np
import pytest
from arms import Q_PANDA
from cell_functions import function_of
from controls import NEEDS_C, control

import repctl_pin as rp

DT, V, A, J = 0.001, 2.0, 6.0, 400.0
LIMITS = rp.Limits(velocity=V, acceleration=A, jerk=J)
ARMS = {
    "planar3r": ("planar3r", "tool", "xy", np.array([0.3, 0.8, 0.8])),  # r = 1
    "panda": ("panda", "panda_hand_tcp", "pose", Q_PANDA),  # r = 1
    "axis": ("panda", "panda_hand_tcp", "axis", Q_PANDA),  # r = 2
    "position": ("panda", "panda_hand_tcp", "position", Q_PANDA),  # r = 4
}
EVERY = pytest.mark.parametrize("name", ARMS)
pytestmark = NEEDS_C


@cache
def arm(name: str) -> tuple[rp.RepeatableInverse, np.ndarray]:
    robot, frame, kind, q0 = ARMS[name]
    task = rp.Robot.load(robot).task(frame, kind)
    return control(task, q0, rp.Polynomial(q0, 2, 0.5)), q0


def governed(name: str) -> tuple[rp.Governor, rp.RepeatableInverse, np.ndarray]:
    inverse, q0 = arm(name)
    governor = rp.Governor(inverse, DT, LIMITS)
    governor.start(q0)
    return governor, inverse, q0


def to(governor: rp.Governor, target: object = None, leaf: object = None) -> np.ndarray:
    """Ticks until target and level are reached: the joints of each."""
    Q = []
    for _ in range(8000):
        q, status = governor.step(target, leaf=leaf)  # type: ignore[arg-type]
        Q.append(q)
        if status is rp.Status.OK:
            return np.array(Q)
    raise AssertionError(f"not reached: {status!r}")


def used(Q: np.ndarray) -> float:
    """Largest share of a limit, by the differences of the samples alone."""
    most = enumerate((V, A, J), 1)
    return float(max((np.abs(np.diff(Q, k, axis=0)) / DT**k / m).max() for k, m in most))


@EVERY
def test_the_elbow_moves_while_the_hand_rests(name: str) -> None:
    governor, inverse, q0 = governed(name)
    place = governor._task.placement(q0)
    wanted = inverse.leaf(q0) + 0.1
    Q = to(governor, leaf=wanted)
    assert np.abs(inverse.leaf(Q[-1]) - wanted).max() < 1e-9
    errors = [governor._task.error(q, place) for q in Q]
    assert np.abs(errors).max() < 1e-9 and np.abs(Q[-1] - q0).max() > 0.05
    shares = (np.array([inverse.leaf(q) for q in Q]) - inverse.leaf(q0)) / 0.1
    assert np.ptp(shares, axis=1).max() < 1e-7  # on a straight line
    assert 0.3 < used(np.vstack([[q0] * 3, Q])) <= 1 + 1e-9
    np.testing.assert_allclose(governor.leaf, wanted, atol=1e-9)
    assert len(to(governor, place)) < 10  # without a level, the last one is kept
    np.testing.assert_allclose(governor.leaf, wanted, atol=1e-9)


@EVERY
def test_the_joints_come_back_whenever_pose_and_level_do(name: str) -> None:
    governor, inverse, q0 = governed(name)
    task, rng = inverse.task, np.random.default_rng(0)
    for _ in range(5):
        for q in (*(q0 + rng.normal(size=(2, task.n)) * 0.12), q0):
            end = to(governor, task.placement(q), inverse.leaf(q))[-1]
        assert np.abs(end - q0).max() < 1e-9


@EVERY
def test_limits_hold_whatever_comes_in(name: str) -> None:
    """Jumps, levels out of reach, NaN, twists and levels, levels alone, nothing."""
    governor, inverse, q0 = governed(name)
    task, rng, Q, seen = inverse.task, np.random.default_rng(1), [q0] * 3, set()
    for k in range(60):
        q = q0 + rng.normal(size=task.n) * 0.2
        target, leaf = task.placement(q), inverse.leaf(q)
        leaf = (leaf, leaf, leaf + 1e3, leaf * np.nan, leaf + 1e9)[int(rng.integers(5))]
        twist = rng.normal(size=6) * 0.2
        for _ in range(int(rng.choice([1, 20, 150]))):
            said = governor.step(
                target if k % 4 < 2 else None, twist if k % 4 == 2 else None, leaf=leaf
            )
            Q.append(said[0])
            seen.add(said[1])
    for _ in range(1500):
        q, status = governor.step()
        Q.append(q)
    assert used(np.array(Q)) <= 1 + 1e-9 and task.limit_margin(np.array(Q)).min() >= 0
    assert status is rp.Status.OK and (Q[-1] == Q[-20]).all()
    assert rp.Status.BAD_NUMBER in seen
    end = to(governor, task.placement(q0), inverse.leaf(q0))[-1]
    assert np.abs(end - q0).max() < 1e-9


def test_a_twist_moves_the_hand_while_the_elbow_goes_to_its_level() -> None:
    governor, inverse, q0 = governed("panda")
    wanted = inverse.leaf(q0) + 0.1
    for _ in range(1200):
        q, status = governor.step(twist=[0.03, 0, 0, 0, 0, 0], leaf=wanted)
    assert status is rp.Status.OK and np.abs(inverse.leaf(q) - wanted).max() < 1e-9
    way = inverse.task.placement(q).translation - inverse.task.placement(q0).translation
    assert 0.02 < way[0] < 0.036 and np.abs(way[1:]).max() < 1e-9
    for _ in range(400):
        q, _ = governor.step(twist=[0, 0.03, 0, 0, 0, 0])
    np.testing.assert_allclose(inverse.leaf(q), wanted, atol=1e-9)


def test_without_an_input_the_elbow_stops_and_stays() -> None:
    governor, inverse, q0 = governed("panda")
    for _ in range(50):
        governor.step(leaf=inverse.leaf(q0) + 0.1)
    for _ in range(500):
        q, _ = governor.step()
    level = inverse.leaf(q)
    assert 1e-3 < (level - inverse.leaf(q0))[0] < 0.09
    end = to(governor, inverse.task.placement(q0 + 0.05))[-1]
    np.testing.assert_allclose(inverse.leaf(end), level, atol=1e-9)


def test_a_level_out_of_reach_stops_the_arm_before_it() -> None:
    governor, inverse, q0 = governed("planar3r")
    for _ in range(4000):
        q, status = governor.step(leaf=inverse.leaf(q0) + 50.0)
    assert status in (rp.Status.LIMIT, rp.Status.SINGULAR) and np.isfinite(q).all()


def test_a_copy_goes_on_the_same_way() -> None:
    governor, inverse, q0 = governed("panda")
    wanted = inverse.leaf(q0) + 0.1
    for _ in range(80):
        governor.step(leaf=wanted)
    other = pickle.loads(pickle.dumps(governor))
    for _ in range(300):
        assert (governor.step(leaf=wanted)[0] == other.step(leaf=wanted)[0]).all()


def test_in_a_cell_the_level_is_an_argument_of_the_function() -> None:
    function = function_of("positions")
    q0 = function(function.cell.placement)
    leaf = np.full(function.task.r, 0.05)
    governor = rp.Governor(function.inverse, DT, LIMITS)
    governor.start(q0)
    place = function.task.placement(q0)
    q = to(governor, place, leaf)[-1]
    np.testing.assert_allclose(q, function(place, leaf=leaf), atol=1e-9)
    assert np.abs(to(governor, place, 0 * leaf)[-1] - q0).max() < 1e-9


@pytest.mark.parametrize("leaf", [[0.1, 0.2], [], "high", [[0.1]], {}, [None], 1j])
def test_a_level_of_another_size_is_refused_in_one_line(leaf: object) -> None:
    governor, _, q0 = governed("panda")
    with pytest.raises(rp.InputError, match=r"^leaf must be 1 number, the level; got") as error:
        governor.step(leaf=leaf)  # type: ignore[arg-type]
    assert "\n" not in str(error.value) and (governor.q == q0).all()
