"""Leaf lock: the same cycle for ever, whatever the steps, the start or a push do to it."""

from __future__ import annotations

import numpy as np
import pytest
from controls import some

import repctl_pin as rp

STEPS = 500
SPEED_LIMIT = 2.5
"""rad/s: what the slowest of the panda's joints may do is 2.175 to 2.61."""


@pytest.fixture(scope="module")
def path(panda_pose: rp.Task) -> rp.TaskPath:
    from arms import Q_PANDA

    return rp.circle(panda_pose, Q_PANDA, 0.1, normal="yz", start_angle=np.pi)


def run(
    inverse: rp.RepeatableInverse, path: rp.TaskPath, q: np.ndarray, cycles: int, corrections: int
) -> dict:
    """Cycle after cycle in the person's own loop: ends of the cycles, and the largest tracking
    error."""
    task, leaf = inverse.task, inverse.leaf(q)
    targets = [path.placement(s) for s in np.linspace(0, 1, STEPS + 1)[1:]]
    points = np.array([t.translation for t in targets])
    ends, worst = [q], 0.0
    cycle = np.empty((STEPS, task.n))
    for k in range(cycles):
        for i, target in enumerate(targets):
            for _ in range(corrections):
                q = inverse.step(q, target, 0.01, leaf=leaf)
            cycle[i] = q
        ends.append(q)
        if k % max(1, cycles // 100) == 0:
            worst = max(worst, float(np.linalg.norm(task.positions(cycle) - points, axis=1).max()))
    return {"ends": np.array(ends), "tracking": worst}


def check(
    cycles: int, corrections: int, design: rp.Design, path: rp.TaskPath, q0: np.ndarray
) -> None:
    found = run(design.inverse, path, q0, cycles, corrections)
    ends = found["ends"]
    away = np.linalg.norm(ends - q0, axis=1)
    changes = np.abs(np.diff(ends[1:], axis=0)).max(axis=1)
    if corrections == 1:
        assert changes.max() < 1e-11  # from the end of the first cycle on
        assert away.max() < 2e-5
        assert found["tracking"] < 1e-5
    else:
        assert away.max() < 1e-9
        assert found["tracking"] < 1e-9
    # No trend: the second half of the cycles lies no further off than the first, to rounding.
    half = len(ends) // 2
    assert np.abs(ends[half:].mean(0) - ends[1:half].mean(0)).max() < 1e-12


@pytest.mark.parametrize("corrections", [1, 2])
def test_forty_cycles(panda_design, path, q_panda, corrections: int) -> None:
    check(40, corrections, panda_design, path, q_panda)


@pytest.mark.slow
@pytest.mark.parametrize("corrections", [1, 2])
def test_ten_thousand_cycles(panda_design, path, q_panda, corrections: int) -> None:
    check(10_000, corrections, panda_design, path, q_panda)


@pytest.mark.parametrize("seed", range(3))
def test_a_pushed_arm_is_back_within_a_cycle(
    panda_design, panda_pose, path, q_panda, seed: int
) -> None:
    """0.3 rad along the null space, at a random moment: speed bounded, then the same cycle as
    before."""
    rng = np.random.default_rng(seed)
    inverse, leaf = panda_design.inverse, panda_design.inverse.leaf(q_panda)
    dt, at = 5.0 / STEPS, int(rng.integers(1, STEPS))
    targets = [path.placement(s) for s in np.linspace(0, 1, STEPS + 1)[1:]]
    q, undisturbed, peak = q_panda, [], 0.0
    for target in targets:
        q = inverse.step(q, target, dt, leaf=leaf)
        undisturbed.append(q)
    for i in range(2 * STEPS):
        if i == at:
            N = rp.redundancy.nullspace(panda_pose.jacobian(q))
            q = q + 0.3 * N @ (lambda v: v / np.linalg.norm(v))(rng.normal(size=N.shape[1]))
        following = inverse.step(q, targets[i % STEPS], dt, leaf=leaf, velocity_limit=SPEED_LIMIT)
        peak = max(peak, float(np.abs(following - q).max()) / dt)
        q = following
        if i >= at + STEPS:
            assert np.abs(q - undisturbed[i % STEPS]).max() < 1e-9
    assert peak <= SPEED_LIMIT * (1 + 1e-9)


def test_euler_at_a_kilohertz_with_a_gain(panda_design, panda_pose, path, q_panda) -> None:
    """Feed-forward and a soft gain, started off the path and off the leaf: the same cycle in the
    end."""
    inverse, leaf, dt, period = (
        panda_design.inverse,
        panda_design.inverse.leaf(q_panda),
        1e-3,
        4.0,
    )
    steps = int(period / dt)
    grid = np.arange(steps) / steps
    targets, twists = ([path.placement(s) for s in grid], [path.twist(s) / period for s in grid])
    q = q_panda + 0.05 * np.random.default_rng(1).normal(size=7)
    ends = []
    for _ in range(3):
        for target, twist in zip(targets, twists, strict=True):
            q = inverse.step(q, target, dt, twist, leaf=leaf, gain=20.0)
        ends.append(q)
    assert np.abs(ends[2] - ends[1]).max() < 1e-11
    # what a gain of 20 leaves of the start after one cycle
    assert np.abs(ends[1] - ends[0]).max() < 1e-6
    assert np.linalg.norm(ends[2] - q_panda) < 1e-4  # Euler's own error, always the same
    assert np.abs(inverse.leaf(q) - leaf).max() < 1e-4


def test_without_the_lock_euler_creeps(panda_design, path, q_panda) -> None:
    """The lock is what holds: task feedback alone lets Euler's steps leave the leaf."""
    free = rp.follow(
        panda_design.inverse, path, q_panda, cycles=10, steps=100, integrator="euler", feedback=20.0
    )
    locked = rp.follow(
        panda_design.inverse, path, q_panda, cycles=10, steps=100, integrator=rp.LeafLock()
    )
    assert free.drift[-1] > 5 * free.drift[0] > 1e-4
    assert np.ptp(locked.drift) < 1e-11 and locked.drift[-1] < 1e-3


@pytest.mark.parametrize("kind", some(["pose", "axis", "position", "xz"], "pose"))
def test_follow_locks_every_kind_of_task(panda, q_panda, kind: str) -> None:
    task = panda.task("panda_hand_tcp", kind)
    inverse = rp.ExtendedJacobian(task, q_panda)
    path = rp.circle(task, q_panda, 0.05, normal="xz")
    motion = rp.follow(inverse, path, q_panda, cycles=3, steps=60, integrator=rp.LeafLock(2))
    assert motion.drift.max() < 1e-8 and np.ptp(motion.drift) < 1e-11
    assert motion.tracking_error.max() < 1e-8 and motion.turning_error.max() < 1e-8
    leaf = inverse.leaf(q_panda)
    assert max(np.abs(inverse.leaf(q) - leaf).max() for q in motion.q) < 1e-8


def test_corners_are_met(panda_design, q_panda) -> None:
    square = rp.polygon(panda_design.task, q_panda, [[0, 0.1, 0], [0, 0.1, 0.1], [0, 0, 0.1]])
    motion = rp.follow(
        panda_design.inverse, square, q_panda, cycles=2, steps=200, integrator=rp.LeafLock(2)
    )
    assert motion.drift.max() < 1e-9 and motion.tracking_error.max() < 1e-8


def test_a_start_off_the_leaf_comes_to_it(panda_design, path, q_panda) -> None:
    off = q_panda + 0.05
    leaf = panda_design.inverse.leaf(q_panda)
    motion = rp.follow(
        panda_design.inverse,
        path,
        off,
        cycles=2,
        integrator=rp.LeafLock(leaf=leaf, velocity_limit=SPEED_LIMIT),
    )
    assert np.abs(motion.q[-1] - q_panda).max() < 2e-5
    assert np.abs(motion.qdot).max() <= SPEED_LIMIT * (1 + 1e-9)


def test_a_path_out_of_reach_is_damped_bounded_and_reported() -> None:
    task, q0 = rp.Robot.load("planar3r").task("tool", "xy"), np.array([0.3, 0.8, 0.8])
    inverse = rp.ExtendedJacobian(task, q0)
    out = rp.circle(task, q0, 1.2, start_angle=np.pi)
    assert np.linalg.norm(out.points(), axis=1).max() > 3.0  # further than the arm is long
    with pytest.raises(rp.SingularityError, match="in cycle 1"):
        rp.follow(inverse, out, q0, cycles=1, steps=200, integrator=rp.LeafLock())
    motion = rp.follow(
        inverse,
        out,
        q0,
        cycles=1,
        steps=200,
        integrator=rp.LeafLock(1, damping=0.1, velocity_limit=2.0),
    )
    assert 0 < motion.damping <= 0.1 and motion.tracking_error.max() > 0.1
    assert np.abs(motion.qdot).max() <= 2.0 * (1 + 1e-9)
    near = rp.follow(
        inverse,
        rp.circle(task, q0, 0.1),
        q0,
        cycles=1,
        steps=200,
        integrator=rp.LeafLock(1, damping=0.01),
    )
    assert near.damping == 0 and near.drift[0] < 1e-4


def test_retiming_keeps_the_joint_path_and_the_limits(panda_design, path, q_panda) -> None:
    motion = rp.follow(
        panda_design.inverse, path, q_panda, cycles=1, period=0.4, integrator=rp.LeafLock(2)
    )
    assert motion.speed_ratio > 1.5 and motion.worst_overspeed is not None
    time, joint, ratio = motion.worst_overspeed
    row = motion.qdot[round(time * motion.steps)]
    at = motion.task.joint_names.index(joint)
    assert abs(row[at]) / motion.task.velocity_limit[at] == ratio == motion.speed_ratio
    slow = motion.retimed()
    assert slow.worst_overspeed is None
    assert np.array_equal(slow.q, motion.q) and slow.speed_ratio <= 1 + 1e-12
    assert slow.t[-1] > motion.t[-1] and (np.diff(slow.t) >= np.diff(motion.t) * (1 - 1e-12)).all()
    steps = np.abs(np.diff(slow.q, axis=0)) / np.diff(slow.t)[:, None]
    assert (steps <= panda_design.task.velocity_limit * (1 + 1e-9)).all()
    # Where it was slow enough it keeps its time; asked for nothing, nothing changes.
    gentle = rp.follow(
        panda_design.inverse, path, q_panda, cycles=1, period=20.0, integrator=rp.LeafLock(2)
    )
    assert np.allclose(gentle.retimed().t, gentle.t, rtol=1e-14) and np.array_equal(
        gentle.retimed().qdot, gentle.qdot
    )
    assert np.abs(motion.retimed(0.5).qdot).max() <= 0.5 * (1 + 1e-12)
    for bad in (0.0, -1.0, np.ones(3), "fast"):
        with pytest.raises(rp.InputError, match="speed limit"):
            motion.retimed(bad)


def test_bad_input(panda_design, panda_pose, path, q_panda) -> None:
    plain = rp.Pseudoinverse(panda_pose)
    with pytest.raises(rp.InputError, match="requires a repeatable inverse"):
        rp.follow(plain, path, q_panda, integrator=rp.LeafLock())
    with pytest.raises(rp.InputError, match="corrections must be a whole number from 1 up"):
        rp.LeafLock(0)
    with pytest.raises(rp.InputError, match="damping must be 0 or more"):
        rp.LeafLock(damping=-1.0)
    with pytest.raises(rp.InputError, match="no integrator 'rk5'"):
        rp.follow(panda_design.inverse, path, q_panda, integrator="rk5")
    with pytest.raises(rp.InputError, match="mutually exclusive"):
        rp.follow(panda_design.inverse, path, q_panda, integrator=rp.LeafLock(), feedback=5.0)
    with pytest.raises(rp.InputError, match="level c"):
        rp.follow(panda_design.inverse, path, q_panda, integrator=rp.LeafLock(1, leaf=np.zeros(3)))
    with pytest.raises(rp.InputError, match="speed limit"):
        rp.follow(
            panda_design.inverse, path, q_panda, integrator=rp.LeafLock(1, velocity_limit="fast")
        )
    with pytest.raises(rp.InputError, match="task="):
        rp.follow(lambda q, xdot: q, path, q_panda)
    with pytest.raises(rp.InputError, match="7 finite numbers"):
        rp.follow(lambda q, xdot: np.zeros(3), path, q_panda, task=panda_pose)


def test_any_function_can_be_followed(panda_pose, path, q_panda) -> None:
    task = panda_pose
    own = rp.follow(
        lambda q, xdot: np.linalg.pinv(task.jacobian(q)) @ xdot,
        path,
        q_panda,
        cycles=1,
        steps=50,
        task=task,
    )
    ours = rp.follow(rp.Pseudoinverse(task), path, q_panda, cycles=1, steps=50)
    assert np.allclose(own.q, ours.q, atol=1e-12)
