"""The least closed motion: laws at the minimum, closed forms, and an independent minimiser."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import told
from scipy.optimize import minimize

import repctl_pin as rp

nullspace = rp.redundancy.nullspace


def planar(robot: str = "planar3r", radius: float = 0.3) -> tuple[rp.Task, rp.TaskPath, np.ndarray]:
    task = rp.Robot.load(robot).task("tool", "xy")
    q0 = np.array([0.3, 0.8, 0.8, 0.5])[: task.n]
    return task, rp.circle(task, q0, radius), q0


def energy(Q: np.ndarray) -> float:
    """Σ ‖q_{k+1} − q_k‖² round the cycle, Q (K, n)."""
    return float(((np.roll(Q, -1, axis=0) - Q) ** 2).sum())


def there_and_back(task: rp.Task, q0: np.ndarray, length: float) -> rp.TaskPath:
    """A straight line along y, to its end and back, smooth in s."""
    here, y = task.placement(q0), np.array([0.0, length / 2, 0.0])
    return rp.TaskPath(
        "there and back",
        lambda s: here.translation + (1 - np.cos(2 * np.pi * s)) * y,
        lambda s: 2 * np.pi * np.sin(2 * np.pi * s) * y,
        here.rotation,
    )


@pytest.mark.parametrize("robot", ["planar3r", "planar4r"])
@pytest.mark.parametrize("free", [False, True])
def test_stationary_on_the_path_and_closed(robot: str, free: bool) -> None:
    """``N_kᵀ (2 q_k − q_{k−1} − q_{k+1}) = 0``, at the start only if it is free."""
    task, path, q0 = planar(robot)
    least = rp.least_closed_motion(task, path, q0, steps=40, free_start=free)
    Q = least.q[:-1]
    assert np.array_equal(least.q[0], least.q[-1]) and least.closes
    assert least.tracking_error.max() < 1e-12
    bend = 2 * Q - np.roll(Q, 1, axis=0) - np.roll(Q, -1, axis=0)
    slope = np.einsum("kir,ki->kr", nullspace(task.jacobians(Q)), bend)
    assert np.abs(slope[0 if free else 1 :]).max() < 1e-8
    if not free:
        assert np.array_equal(least.q[0], q0) and np.abs(slope[0]).max() > 1e-3
    assert least.rms_speed == pytest.approx(np.sqrt(energy(Q) * 40) / 5)


def test_no_feasible_motion_nearby_is_less() -> None:
    task, path, q0 = planar()
    least = rp.least_closed_motion(task, path, q0, steps=24)
    targets = [path.placement(k / 24) for k in range(24)]
    rng = np.random.default_rng(0)
    for size in (1e-3, 1e-2, 0.1, 0.3):
        for _ in range(3):
            Q = least.q[:-1] + size * rng.normal(size=(24, 3))
            Q[0] = q0
            near = [rp.solve_ik(task, q, x, limits=False) for q, x in zip(Q, targets, strict=True)]
            assert energy(np.array(near)) > energy(least.q[:-1])


@pytest.mark.parametrize("free", [False, True])
def test_an_independent_minimiser_finds_the_same(free: bool) -> None:
    """SLSQP over all joints at 10 points, with f(q_k) = x_k as constraints."""
    task, path, q0 = planar(radius=0.2)
    K = 10
    least = rp.least_closed_motion(task, path, q0, steps=K, free_start=free)
    points = np.array([path.point(k / K)[:2] for k in range(K)])

    def misses(x: np.ndarray) -> np.ndarray:
        Q = x.reshape(K, 3)
        off = (task.positions(Q)[:, :2] - points)[0 if free else 1 :].ravel()
        return off if free else np.concatenate([off, Q[0] - q0])

    begin = least.q[:-1] + 0.05 * np.random.default_rng(1).normal(size=(K, 3))
    found = minimize(
        lambda x: energy(x.reshape(K, 3)),
        begin.ravel(),
        constraints={"type": "eq", "fun": misses},
        options={"maxiter": 500, "ftol": 1e-12},
    )
    assert found.success
    assert energy(least.q[:-1]) == pytest.approx(found.fun, rel=1e-6)


def test_there_and_back_is_the_same_line() -> None:
    """On a line there and back the least motion goes back as it went: q(s) = q(1 − s)."""
    task, _, q0 = planar()
    least = rp.least_closed_motion(task, there_and_back(task, q0, 0.4), q0, steps=50)
    assert np.allclose(least.q, least.q[::-1], atol=1e-7)
    plain = rp.follow(rp.Pseudoinverse(task), least.path, q0, cycles=1, steps=50)
    assert 0.95 * plain.rms_speed < least.rms_speed < plain.rms_speed


def test_ppr_against_its_closed_form() -> None:
    """A slide along x, one along y and a hinge: q = (p − l (cos θ, sin θ), θ), with θ free."""
    problem = rp.Problem("ppr")
    task, path, q0, K = problem.task, problem.cycle, problem.start, 32
    offset = task.positions(np.array([[0, 0, q0[2]]]))[0, :2]
    arm, phase = np.linalg.norm(offset), np.arctan2(offset[1], offset[0]) - q0[2]
    points = np.array([path.point(k / K)[:2] for k in range(K)])

    def cost(theta: np.ndarray) -> float:
        theta = np.concatenate([q0[2:], theta])
        slides = points - arm * np.stack([np.cos(theta + phase), np.sin(theta + phase)], axis=1)
        return energy(np.column_stack([slides, theta]))

    found = minimize(cost, np.full(K - 1, q0[2]), method="BFGS", options={"gtol": 1e-9})
    least = rp.least_closed_motion(task, path, q0, steps=K)
    assert energy(least.q[:-1]) == pytest.approx(found.fun, rel=1e-8)
    assert np.allclose(least.q[1:-1, 2], found.x, atol=1e-5)


def test_limits_are_kept_and_cost() -> None:
    """A joint that the least motion moves past a bound is held at it; more margin costs more."""
    task, path, q0 = planar()
    free = rp.least_closed_motion(task, path, q0, steps=40)
    ahead = free.limit_margin.min()
    speeds = [free.rms_speed]
    for margin in (ahead + 0.01, ahead + 0.02):
        held = rp.least_closed_motion(task, path, q0, steps=40, limit_margin=margin)
        assert held.limit_margin[1:-1].min() == pytest.approx(margin, abs=2e-6)
        assert held.limit_margin[1:-1].min() > margin
        active = (held.limit_margin < margin + 1e-5).any(axis=1)
        assert 0 < active.sum() < 20
        bend = 2 * held.q[1:-1] - held.q[:-2] - held.q[2:]
        slope = np.einsum("kir,ki->kr", nullspace(task.jacobians(held.q[1:-1])), bend)
        assert np.abs(slope[~active[1:-1]]).max() < 1e-8 < np.abs(slope[active[1:-1]]).max()
        speeds.append(held.rms_speed)
    assert speeds[0] < speeds[1] < speeds[2]


def test_it_is_a_bound_for_a_design_and_its_guess_does_not_matter(panda_design, q_panda) -> None:
    task, path = panda_design.task, rp.circle(panda_design.task, q_panda, 0.1)
    lock = rp.LeafLock(4)
    own = rp.follow(panda_design.inverse, path, q_panda, cycles=1, steps=40, integrator=lock)
    first = rp.least_closed_motion(task, path, q_panda, steps=40)
    second = rp.least_closed_motion(task, path, q_panda, steps=40, guess=own)
    assert np.allclose(first.q, second.q, atol=1e-6)
    assert first.rms_speed < own.rms_speed < 1.01 * first.rms_speed


def test_a_polygons_corners_are_points_of_it() -> None:
    task, _, q0 = planar()
    path = rp.polygon(task, q0, [[0.2, 0, 0], [0.2, 0.3, 0]])
    one = rp.least_closed_motion(task, path, q0, steps=30)
    s = one.t / one.t[-1]
    assert all(np.isclose(s, corner).any() for corner in path.breaks)


@pytest.mark.slow
def test_a_start_with_less_joint_speed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """On planar3r's default circle another start needs 31 % less; it keeps half of the margin that
    any start has."""
    problem = rp.Problem("planar3r")
    task, path, q0 = problem.task, problem.cycle, problem.start
    quick = ("--cycles", "1", "--steps", "50", "--degree", "1", "--quiet")
    where = ("--best-leaf", "speed", "--out", str(tmp_path / "out"))
    found = np.array(told(capsys, "study", "planar3r", *quick, *where)["start"])
    place = path.placement(0.0)
    assert np.abs(task.error(found, place)).max() < 1e-9
    best, given = (rp.least_closed_motion(task, path, q, steps=24) for q in (found, q0))
    assert best.rms_speed < 0.70 * given.rms_speed
    margins, rng = [given.limit_margin.min()], np.random.default_rng(0)
    for q in q0 + rng.uniform(-2, 2, (40, 3)):
        try:
            q = rp.solve_ik(task, q, place)
            least = rp.least_closed_motion(task, path, q, steps=24)
        except rp.RepctlError:
            continue
        margins.append(least.limit_margin.min())
        assert best.rms_speed < 1.001 * least.rms_speed
    assert len(margins) > 20
    assert best.limit_margin.min() >= max(margins) / 2


def test_bad_input() -> None:
    task, path, q0 = planar()
    far = rp.circle(task, q0, 5.0)
    with pytest.raises(rp.InputError, match="cannot reach"):
        rp.least_closed_motion(task, far, q0)
    with pytest.raises(rp.InputError, match="within the joint limits was found"):
        rp.least_closed_motion(task, path, q0, steps=16, limit_margin=6.2)
    four, _, start = planar("planar4r")
    other = rp.follow(rp.Pseudoinverse(four), rp.circle(four, start, 0.1), start, cycles=1, steps=8)
    with pytest.raises(rp.InputError, match="guess has 4 joints, but the task has 3"):
        rp.least_closed_motion(task, path, q0, guess=other)


TABLE = {
    "panda": (0.33, 0.33),
    "xarm7": (1.75, None),
    "baxter": (0.0, None),
    "centauro": (0.14, -1.9),
    "planar3r": (-0.39, -31.2),
    "tiago": (-0.07, -24.3),
    "planar4r": (-1.4, -20.7),
    "so101": (-0.72, -15.7),
    "talos": (-0.99, -11.3),
    "kinova": (-0.12, None),
    "ur5": (0.01, None),
}
"""Joint speed relative to J⁺'s first cycle, %: from the same start, and where one descent with a
free start finds it, from any; another program's results."""

PROBLEMS: dict[str, dict[str, Any]] = {
    "tiago": {
        "start": [0.175, 1.374447, -0.239983, -0.981748, 0.981748, 0.0, 0.0, 0.0],
        "plane": "yz",
    },
    "so101": {"start": [0.008, 0.485, 0.337, 0.501, 0.05]},
    "kinova": {"start": "reference"},
}
"""Starts and circles of those results where they are not the default."""


@pytest.mark.parametrize(
    "robot", [*TABLE][4:5] + [pytest.param(r, marks=pytest.mark.slow) for r in TABLE]
)
def test_other_results(robot: str) -> None:
    same, anywhere = TABLE[robot]
    problem = rp.Problem(robot, **PROBLEMS.get(robot, {}))
    task, path, q0 = problem.task, problem.cycle, problem.start
    plain = rp.follow(rp.Pseudoinverse(task), path, q0, cycles=1, steps=200)
    least = rp.least_closed_motion(task, path, q0, steps=200)
    assert 100 * (least.rms_speed / plain.rms_speed - 1) == pytest.approx(same, abs=0.05)
    if anywhere is not None:
        free = rp.least_closed_motion(task, path, q0, steps=200, free_start=True, guess=least)
        assert 100 * (free.rms_speed / plain.rms_speed - 1) == pytest.approx(anywhere, abs=0.1)
