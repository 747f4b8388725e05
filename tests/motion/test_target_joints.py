"""Joints of a governor's target: those of the straight line from the start, and the way to them
along a leaf."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
from controls import control

import repctl_pin as rp
from repctl_pin.extensions.runtime import leaf_direction, target_joints

Q0 = np.array([0.3, 0.8, 0.8])


@cache
def inverse() -> rp.RepeatableInverse:
    task = rp.Robot.load("planar3r").task("tool", "xy")
    return rp.compiled(control(task, Q0, rp.Polynomial(Q0, 2, 0.5)))


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


def test_they_are_found_from_the_start_alone() -> None:
    """What a governor looks for where it is blocked: the end of the line, if all of it is within
    reach and limits."""

    def found(target: tuple[float, float], upper: float) -> np.ndarray | None:
        limits = SimpleNamespace(lower=np.full(3, -9.0), upper=np.full(3, upper))
        joints = target_joints.TargetJoints(inverse(), limits)
        joints.start(Q0, inverse().leaf(Q0))
        for _ in range(100):
            joints.look_for(moved(*target))
        assert joints.known
        return joints.found

    highest = line(*GOAL).max()
    np.testing.assert_allclose(found(GOAL, highest + 0.1), line(*GOAL)[-1], atol=1e-9)
    assert found(GOAL, highest - 0.1) is None and found((5.0, 5.0), 9.0) is None


def test_the_direction_is_along_the_leaf_and_around_a_singularity() -> None:
    control = inverse()

    def regular(q: np.ndarray) -> float:
        """The smallest sine between a row of J and the other rows of J_V."""
        J, G = control.task.jacobian(q), control(q)
        return 1 / (np.linalg.norm(J, axis=1) * np.linalg.norm(G, axis=0)).max()

    def tangent(q: np.ndarray, x: np.ndarray) -> np.ndarray:
        V = control.potentials.gradients(q[None])[0]
        return x - V @ np.linalg.lstsq(V, x, rcond=None)[0]

    q, goal = Q0, line(*GOAL)[-1]
    assert regular(q) > 0.1
    np.testing.assert_allclose(
        leaf_direction.leaf_direction(control, q, goal),
        tangent(q, goal - q),
        atol=1e-12,
    )
    far = np.array([5.0, 5.0])
    while regular(q) > 0.025:  # towards the edge of the reach
        q = q + 0.002 * control(q) @ (far / np.linalg.norm(far))
    beyond = q + 0.3 * control(q) @ far
    d = leaf_direction.leaf_direction(control, q, beyond)
    np.testing.assert_allclose(tangent(q, d), d, rtol=0, atol=1e-9 * np.linalg.norm(d))
    e = 1e-5 * d / np.linalg.norm(d)
    assert regular(q + e) > regular(q) > regular(q + 1e-5 * tangent(q, beyond - q))
