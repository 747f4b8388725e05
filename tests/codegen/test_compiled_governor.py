"""The governor in C called from Python: the joints and refusals of the one in Python."""

from __future__ import annotations

import warnings

import numpy as np
import pinocchio as pin
import pytest
from controls import NEEDS_C, control, own_cache  # noqa: F401

import repctl_pin as rp
from repctl_pin.codegen.compiled_governor import CompiledGovernor

Q0 = np.array([0.3, 0.8, 0.8])


def both(region: rp.Box | None = None) -> list[rp.Governor]:
    task = rp.Robot.load("planar3r").task("tool", "xy")
    potentials = control(task, Q0, rp.Polynomial(Q0, 2, 0.5)).potentials
    inverse = rp.RepeatableInverse(task, potentials, region=region)
    kinds = rp.Governor, CompiledGovernor
    return [kind(inverse, 0.005, acceleration=6.0, jerk=400.0, margin=0.01) for kind in kinds]


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
