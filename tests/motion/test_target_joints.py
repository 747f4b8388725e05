"""Joints of a governor's target: those of the straight line from the start, and the way to them
along a leaf."""

from __future__ import annotations

from functools import cache

import numpy as np
import pinocchio as pin
from controls import control

import repctl_pin as rp
from repctl_pin.motion.leaf_direction import leaf_direction

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


def rest(
    target: pin.SE3, *, margin: float = 0.0, twists: object = (), dt: float = 0.01
) -> tuple[np.ndarray, rp.Status, bool]:
    """Where a governor comes to rest with a target, from Q0, after 1.5 s of each twist; and whether
    the straight line was blocked."""
    limits = rp.Limits(acceleration=6.0, jerk=400.0)
    governor = rp.Governor(inverse(), dt, limits, margin=margin)
    governor.start(Q0)
    for twist in twists:  # type: ignore[attr-defined]
        for _ in range(150):
            governor.step(twist=twist)
    said = []
    while len(said) < 300 and rp.Status.OK not in said:
        q, status = governor.step(target)
        said.append(status)
    blocked = said.count(rp.Status.SINGULAR) + said.count(rp.Status.LIMIT) > 15
    return q, status, blocked


def test_they_are_those_of_small_steps_along_the_line() -> None:
    assert np.abs(line(*GOAL)[-1] - Q0).max() > 0.5
    for twists in ((), [(-0.3, 0.2, 0, 0, 0, 0)]):  # whatever the arm did before
        q, status, blocked = rest(moved(*GOAL), twists=twists)
        assert status is rp.Status.OK and not blocked
        np.testing.assert_allclose(q, line(*GOAL)[-1], atol=1e-6)


def test_a_target_whose_line_is_beyond_a_limit_is_not_reached() -> None:
    task = inverse().task
    margins = task.limit_margin(line(*BENT)).min(axis=1)
    least = float(margins.min())
    assert least < min(margins[0], margins[-1]) - 0.15
    q, status, _ = rest(moved(*BENT), margin=least - 0.01)
    assert status is rp.Status.OK
    np.testing.assert_allclose(q, line(*BENT)[-1], atol=1e-6)
    q, status, blocked = rest(moved(*BENT), margin=least + 0.08)
    assert status is rp.Status.LIMIT and blocked
    assert task.limit_margin(q).min() >= least + 0.08 - 1e-9


def test_where_the_line_is_blocked_the_joints_are_found_along_the_leaf() -> None:
    rng = np.random.default_rng(204)  # to where home is behind a singularity
    twists = [np.concatenate([rng.normal(size=2), np.zeros(4)]) for _ in range(2)]
    q, status, blocked = rest(moved(0.0, 0.0), twists=twists, margin=0.01)
    assert blocked and status is rp.Status.OK and np.abs(q - Q0).max() < 1e-6


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
        leaf_direction(control, q, goal), tangent(q, goal - q), atol=1e-12
    )
    far = np.array([5.0, 5.0])
    while regular(q) > 0.025:  # towards the edge of the reach
        q = q + 0.002 * control(q) @ (far / np.linalg.norm(far))
    beyond = q + 0.3 * control(q) @ far
    d = leaf_direction(control, q, beyond)
    np.testing.assert_allclose(tangent(q, d), d, rtol=0, atol=1e-9 * np.linalg.norm(d))
    e = 1e-5 * d / np.linalg.norm(d)
    assert regular(q + e) > regular(q) > regular(q + 1e-5 * tangent(q, beyond - q))
