"""The governor in C called from Python: the joints and refusals of the one in Python."""

from __future__ import annotations

import sys
import warnings
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from controls import NEEDS_C, control, own_cache  # noqa: F401

import repctl_pin as rp
from repctl_pin.codegen.compiled_governor import CompiledGovernor

sys.path.insert(0, str(Path(__file__).parents[1] / "attack"))

from governor_ticks import ARMS

Q0 = np.array([0.3, 0.8, 0.8])


def both(region: rp.Box | None = None) -> list[rp.Governor]:
    task = rp.Robot.load("planar3r").task("tool", "xy")
    potentials = control(task, Q0, rp.Polynomial(Q0, 2, 0.5)).potentials
    inverse = rp.RepeatableInverse(task, potentials, region=region)
    kinds = rp.Governor, CompiledGovernor
    return [
        kind(inverse, 0.005, rp.Limits(acceleration=6.0, jerk=400.0), margin=0.01)
        for kind in kinds
    ]


@NEEDS_C
def test_it_commands_the_same_joints() -> None:
    box = rp.Box(Q0, 0.15)
    pair, rng, said, worst = both(box), np.random.default_rng(0), set(), 0.0
    for governor in pair:
        governor.start(Q0)
    home = pair[0]._task.placement(Q0)
    for k in range(180):
        if k % 30 == 0:
            p = home.translation + rng.normal(size=3) * 0.2 * [1, 1, 0]
            target, twist = pin.SE3(home.rotation, p), None
            if k % 90 == 60:
                target, twist = None, rng.normal(size=6)
            if k == 90:
                target = pin.SE3(home.rotation, p * np.nan)
        (q, status), (q_c, status_c) = (g.step(target, twist) for g in pair)
        assert status == status_c and isinstance(status_c, rp.Status)
        worst, said = max(worst, np.abs(q - q_c).max()), said | {status}
        assert (pair[1].q == q_c).all()
    assert worst < 1e-9 and np.abs(q - Q0).max() > 1e-3
    assert {rp.Status.OUTSIDE, rp.Status.SLOWED, rp.Status.BAD_NUMBER} <= said
    assert pair[1].leaf == pytest.approx(pair[0].leaf, abs=1e-12)


@NEEDS_C
def test_it_refuses_the_same_starts() -> None:
    for governor in both(rp.Box(Q0, 0.1)):
        with pytest.raises(rp.InputError, match="outside Ω"):
            governor.start(Q0 + 0.2)
        with pytest.raises(rp.InputError, match="has not started"):
            governor.step()


def test_without_a_compiler_python_serves(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", "no-such-compiler")
    with pytest.warns(UserWarning, match="Python serves"):
        governor = both()[1]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        governor.start(Q0)
        q, status = governor.step()
    assert (q == Q0).all() and status is rp.Status.OK


@NEEDS_C
def test_where_the_straight_line_is_blocked_it_takes_the_way_of_the_joints() -> None:
    governor, task = both()[1], rp.Robot.load("planar3r").task("tool", "xy")
    governor.start(Q0)
    rng, said = np.random.default_rng(127), []
    for _ in range(2):
        twist = np.concatenate([rng.normal(size=2), np.zeros(4)])
        for _ in range(300):
            governor.step(twist=twist)
    assert np.abs(governor.q - Q0).max() > 1
    for _ in range(2500):
        q, status = governor.step(task.placement(Q0))
        said.append(status)
        if status is rp.Status.OK:
            break
    assert said.count(rp.Status.SINGULAR) + said.count(rp.Status.LIMIT) > 30
    assert said[-1] is rp.Status.OK and np.abs(q - Q0).max() < 1e-6


def history(
    rng: np.random.Generator, home: pin.SE3
) -> tuple[pin.SE3 | None, np.ndarray | None]:
    """A random target or twist, also beyond the reach and more than half a turn away."""
    if rng.integers(2):
        return None, rng.normal(size=6) * rng.choice([0.05, 0.5, 5.0])
    p = home.translation + rng.normal(size=3) * rng.choice([0.02, 0.3, 1.0])
    turn = pin.exp3(rng.choice([0.3, 1.0, 2.0]) * rng.normal(size=3))
    return pin.SE3(turn @ home.rotation, p), None


@pytest.mark.slow
@NEEDS_C
@pytest.mark.parametrize("name", ["panda", "iiwa14", "xarm7", "baxter", "rail"])
def test_after_any_history_the_same_pose_has_the_same_joints(
    name: str, tmp_path: Path
) -> None:
    task, q0, acceleration, jerk = ARMS[name](tmp_path)
    inverse = control(task, q0, rp.Polynomial(q0, 2, 0.5))
    governor = CompiledGovernor(
        inverse, 1e-3, rp.Limits(acceleration=acceleration, jerk=jerk), margin=0.02
    )
    home, missed = task.placement(q0), []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        governor.start(q0)
        for _ in range(rng.integers(1, 12)):
            target, twist = history(rng, home)
            for _ in range(int(rng.choice([100, 400, 1500]))):
                governor.step(target, twist)
        for _ in range(30_000):
            q, status = governor.step(home)
            if status is rp.Status.OK:
                break
        if status is not rp.Status.OK or np.abs(q - q0).max() > 1e-6:
            missed.append((seed, status))
    print(f"{name}: missed {missed}")
    assert not missed
