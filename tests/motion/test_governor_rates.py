"""The governor at slow rates: a motion does not depend on how often it is asked for commands."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from cell_functions import function_of
from controls import control

import repctl_pin as rp

sys.path.insert(0, str(Path(__file__).parents[1] / "attack"))

from governor_ticks import ARMS

STEPS = (0.001, 0.004, 0.01, 0.02, 0.05, 0.1)
MOVED = 0.3
"""Time after which the target changes, s: a whole number of each time step."""

STANDS = 1.5
"""Time of standing after which the arm is at rest for good, s."""


def outcome(
    governor: rp.Governor, dt: float, q0: np.ndarray, goals: list[pin.SE3]
) -> tuple[float, rp.Status]:
    """Go towards each goal for 0.3 s and to the last one for good; the time and the status."""
    governor.start(q0)
    for goal in goals[:-1]:
        for _ in range(round(MOVED / dt)):
            governor.step(goal)
    last, still, ticks = governor.q, 0, 0
    while ticks * dt < 30.0:
        q, status = governor.step(goals[-1])
        ticks += 1
        still = still + 1 if (q == last).all() else 0
        last = q
        if status is rp.Status.OK:
            return ticks * dt, status
        if still * dt >= STANDS:
            return np.inf, status
    raise AssertionError("it neither arrives nor rests")


def compare(name: str, count: int, folder: Path) -> tuple[int, int, float]:
    """Hold all time steps against 1 ms; the motions, those that arrived, the longest ratio."""
    task, q0, acceleration, jerk = ARMS[name](folder)
    inverse = control(task, q0, rp.Polynomial(q0, 2, 0.5))
    limits = rp.Limits(acceleration=acceleration, jerk=jerk)
    governors = {dt: rp.Governor(inverse, dt, limits) for dt in STEPS}
    rng = np.random.default_rng(26)
    Q = np.clip(q0 + rng.uniform(-0.6, 0.6, (count, task.n)), task.lower, task.upper)
    goals = [task.placement(q) for q in Q]
    motions, arrived, worst = 0, 0, 0.0
    for k, goal in enumerate(goals):
        for way in ([goal], [goals[k - 1], goal]):
            found = {dt: outcome(one, dt, q0, way) for dt, one in governors.items()}
            least, first = found[0.001]
            for dt, (time, status) in found.items():
                assert status is not rp.Status.SLOWED, (name, k, len(way), dt)
                assert (status is rp.Status.OK) == (first is rp.Status.OK), (name, k, len(way), dt)
                motions += 1
                arrived += status is rp.Status.OK
                if status is rp.Status.OK:
                    assert time <= 1.2 * least + dt + 1e-9, (name, k, len(way), dt)
                    worst = max(worst, (time - dt) / least)
    return motions, arrived, worst


@pytest.mark.slow
@pytest.mark.parametrize("name", ["panda", "iiwa14", "xarm7", "baxter", "rail", "planar3r"])
def test_targets_are_reached_at_every_rate(name: str, tmp_path: Path) -> None:
    """Item 26.1: 200 targets, from rest and from a motion, at 1 to 100 ms."""
    motions, arrived, _ = compare(name, 200, tmp_path)
    assert motions == 2400 and arrived > 0.9 * motions


def test_targets_are_reached_at_the_slowest_rate(tmp_path: Path) -> None:
    """The same with few targets."""
    motions, arrived, _ = compare("rail", 2, tmp_path)
    assert motions == 24 and arrived > 0


@pytest.mark.slow
def test_targets_in_a_cell_are_reached_at_20_per_second() -> None:
    """Item 26.1: 29 of 43 targets inside a cell were never reached at 50 ms."""
    function = function_of("poses")
    cell, limits = function.cell, rp.Limits(acceleration="panda", jerk="panda")
    governor = rp.Governor(function.inverse, 0.05, limits)
    rng = np.random.default_rng(43)
    for u in rng.uniform(-1, 1, (43, cell.k)):
        governor.start(function(cell.placement))
        target = cell.at(u)
        for _ in range(200):
            q, status = governor.step(target)
            if status is rp.Status.OK:
                break
        assert status is rp.Status.OK and np.abs(q - function(target)).max() < 1e-9


def test_an_arm_that_cannot_leave_its_rest_says_so(tmp_path: Path) -> None:
    """Item 26.1: with a jerk limit too small to plan with, SLOWED ends after 1 s of standing."""
    task, q0, _, _ = ARMS["xarm7"](tmp_path)
    inverse = control(task, q0, rp.Polynomial(q0, 2, 0.5))
    governor = rp.Governor(inverse, 0.02, rp.Limits(velocity=1.0, acceleration=1.0, jerk=1e-4))
    governor.start(q0)
    said = [governor.step(task.placement(q0 + 0.1))[1] for _ in range(60)]
    assert said[:50] == [rp.Status.SLOWED] * 50 and said[-1] is rp.Status.SINGULAR
    assert (governor.q == q0).all()
