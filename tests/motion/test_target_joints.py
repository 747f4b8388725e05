"""Joints of a governor's target: those of the straight line from the start."""

from __future__ import annotations

from functools import cache

import numpy as np
import pinocchio as pin
from controls import control

import repctl_pin as rp

Q0 = np.array([0.3, 0.8, 0.8])


@cache
def inverse() -> rp.RepeatableInverse:
    task = rp.Robot.load("planar3r").task("tool", "xy")
    return control(task, Q0, rp.Polynomial(Q0, 2, 0.5))


def moved(x: float, y: float) -> pin.SE3:
    place = inverse().task.placement(Q0)
    return pin.SE3(place.rotation, place.translation + [x, y, 0.0])


@cache
def line(x: float, y: float) -> np.ndarray:
    """Joints (501, n) of small steps along the line from the start by (x, y) m."""
    Q, leaf = [Q0], inverse().leaf(Q0)
    for share in [*np.linspace(0, 1, 501)[1:], 1, 1]:
        target = moved(x * share, y * share)
        Q.append(inverse().step(Q[-1], target, 1.0, leaf=leaf))
    return np.array(Q)


GOAL, BENT = (-0.6, -0.9), (1.51, -1.59)
"""m; on the way to the second, joints are nearer to their limits than at either end."""


def rest(*targets: tuple[float, float], margin: float = 0.0, ticks: int = 400):
    """Where a governor comes to rest that is given targets one after the other, from Q0; and what
    it said of the last one."""
    limits = rp.Limits(velocity=8.0, acceleration=60.0, jerk=6000.0)
    governor = rp.Governor(inverse(), 0.01, limits, margin=margin)
    governor.start(Q0)
    for target in targets:
        said = []
        while len(said) < ticks and rp.Status.OK not in said:
            q, status = governor.step(moved(*target))
            said.append(status)
    return q, said


def test_they_are_those_of_small_steps_along_the_line() -> None:
    assert np.abs(line(*GOAL)[-1] - Q0).max() > 0.5
    for before in ((), [(0.3, -0.3)]):  # wherever the arm was before
        q, said = rest(*before, GOAL)
        assert said[-1] is rp.Status.OK
        np.testing.assert_allclose(q, line(*GOAL)[-1], atol=1e-6)


def test_a_target_whose_line_is_beyond_a_limit_is_not_reached() -> None:
    task = inverse().task
    margins = task.limit_margin(line(*BENT)).min(axis=1)
    least = float(margins.min())
    assert least < min(margins[0], margins[-1]) - 0.15
    q, said = rest(BENT, margin=least - 0.01)
    assert said[-1] is rp.Status.OK
    np.testing.assert_allclose(q, line(*BENT)[-1], atol=1e-6)
    q, said = rest(BENT, margin=least + 0.08, ticks=120)
    assert said[-1] is rp.Status.LIMIT
    assert task.limit_margin(q).min() >= least + 0.08 - 1e-9
