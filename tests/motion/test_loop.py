"""The loop that runs controls in real time: it is the motion that follow integrates, and the target
can be moved."""

from __future__ import annotations

import numpy as np
import pytest

import repctl_pin as rp
from repctl_pin.extensions.runtime import governed_loop
from repctl_pin.motion.loop import Loop

PERIOD = 1.0


@pytest.fixture(scope="module")
def controls() -> tuple[rp.Pseudoinverse, rp.RepeatableInverse]:
    task, q0 = rp.Robot.load("planar3r").task(kind="xy"), np.array([0.3, 0.8, 0.8])
    plain = rp.Pseudoinverse(task)
    found = rp.nearest_repeatable(
        plain,
        rp.Polynomial(q0, 1, 0.3),
        rp.Box(q0, 0.3),
        options=rp.FitOptions(samples=256, held_out=64),
    )
    return plain, found.inverse


@pytest.fixture
def loop(controls) -> Loop:
    q0 = np.array([0.3, 0.8, 0.8])
    return Loop(controls, rp.circle(controls[0].task, q0, 0.15), q0, period=PERIOD)


def test_undisturbed_it_is_what_follow_integrates(loop: Loop, controls) -> None:
    q0 = loop.cycle[0, 0]
    path = rp.circle(controls[0].task, q0, 0.15)
    plain, closed = (rp.follow(c, path, q0, cycles=3, steps=250) for c in controls)
    for seconds in (
        1.3,
        0.0101,
        1.6899 + 1e-6,
    ):  # odd pieces make up the same three cycles
        loop.run(seconds * PERIOD)
    assert (
        np.linalg.norm(loop.q[0] - q0) == pytest.approx(plain.drift[-1], rel=0.01)
        and plain.drift[-1] > 0.003
    )
    assert np.abs(loop.q[1] - q0).max() < 1e-9 > closed.drift[-1]
    loop.run(0.2 * PERIOD + 1e-6)
    np.testing.assert_allclose(loop.q[1], loop.before[1], atol=1e-9)
    np.testing.assert_allclose(
        loop.before[0], plain.cycle(0)[loop.steps // 5], atol=2e-3
    )
    for q in loop.q:
        assert np.linalg.norm(loop.task.error(q, path.placement(0.2))) < 1e-4


def test_a_target_moved_and_brought_back_brings_back_who_repeats(loop: Loop) -> None:
    moved = np.array([-0.2, 0.1, 0.0])
    still = loop.cycle[0]
    loop.run(0.5, moved)
    assert np.linalg.norm(loop.offset) == pytest.approx(0.5 * 0.15, rel=0.02)  # no jump
    loop.run(3.5, moved)
    np.testing.assert_allclose(loop.offset, moved)
    loop.run(4.0)
    assert not loop.offset.any()
    plain, ours = (
        np.linalg.norm(q - then) for q, then in zip(loop.q, loop.before, strict=True)
    )
    undisturbed = Loop(
        loop.strategies, rp.circle(loop.task, still[0], 0.15), still[0], period=PERIOD
    )
    undisturbed.run(8.0)
    assert (
        ours < 1e-9
        and np.linalg.norm(loop.q[0] - undisturbed.q[0]) > 1e-4
        and plain > 0.003
    )


def test_a_target_out_of_reach_comes_back_as_far_as_needed(loop: Loop) -> None:
    before = [q.copy() for q in loop.q]
    for _ in range(500):
        loop.run(0.02, [9.0, 9.0, 0.0])
        assert all(
            np.isfinite(q).all() and np.abs(q - old).max() < 1.0
            for q, old in zip(loop.q, before, strict=True)
        )
        before = [q.copy() for q in loop.q]
    assert np.linalg.norm(loop.offset) < 3  # the arm is three long
    where = loop.task.placement(loop.q[0]).translation
    np.testing.assert_allclose(
        loop.task.placement(loop.q[1]).translation, where, atol=1e-2
    )  # both are kept waiting


def test_out_of_reach_it_holds_says_so_and_comes_back(
    panda_pose: rp.Task, q_panda: np.ndarray
) -> None:
    """A pose task near the end of the arm's reach: no step on is possible there, in any
    direction."""
    plain = rp.Pseudoinverse(panda_pose)
    potentials, box = rp.Polynomial(q_panda, 1, 0.3), rp.Box(q_panda, 0.3)
    found = rp.nearest_repeatable(
        plain, potentials, box, options=rp.FitOptions(samples=256, held_out=64)
    )
    path = rp.circle(panda_pose, q_panda, 0.1)
    loop = Loop([plain, found.inverse], path, q_panda, period=2.0)
    loop.run(1.0)
    assert not loop.out_of_reach
    held = []
    for k in range(100):
        loop.run(0.1, [0.01 * min(k, 60), 0.0, 0.0])
        held.append(loop.out_of_reach)
        place = loop._targets[loop._at]
        hands = [
            panda_pose.placement(q).translation - place.translation for q in loop.q
        ]
        np.testing.assert_allclose(
            hands, [loop.offset] * 2, atol=0.01
        )  # the hand is where the target is
    assert not held[0] and all(held[60:]) and 0.05 < loop.offset[0] < 0.5
    loop.run(10.0)
    assert not loop.offset.any() and not loop.out_of_reach
    np.testing.assert_allclose(loop.q[1], loop.before[1], atol=1e-6)


def test_through_a_governor_it_repeats_within_the_limits(controls) -> None:
    q0 = np.array([0.3, 0.8, 0.8])
    task = controls[0].task
    loop = governed_loop.GovernedLoop(
        controls, rp.circle(task, q0, 0.05), q0, period=0.6
    )
    Q = [loop.q[1]]
    for k in range(150):
        loop.run(loop.dt, [0.0, 0.05, 0.0] if k < 20 else [0.0, 0.0, 0.0])
        Q.append(loop.q[1])
    dt, speed, acceleration = loop.dt, loop._speeds, loop._accelerations
    assert (np.abs(np.diff(Q, axis=0)) / dt <= speed * (1 + 1e-9)).all()
    assert (np.abs(np.diff(Q, 2, axis=0)) / dt**2 <= acceleration * (1 + 1e-9)).all()
    assert np.abs(controls[1].leaf(Q[-1]) - controls[1].leaf(q0)).max() < 1e-9
    away = [np.linalg.norm(task.error(q, task.placement(loop.q[1]))) for q in loop.q]
    assert max(away) < 1e-3  # the others are where the governor is
    loop.run(1.2)
    assert np.abs(loop.q[1] - loop.before[1]).max() < 0.01
