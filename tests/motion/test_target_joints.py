"""Joints of a target by the straight line from the start, and the way to them along a leaf."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from controls import control

import repctl_pin as rp
from repctl_pin.motion import governor_law, leaf_direction, target_joints

Q0 = np.array([0.3, 0.8, 0.8])
FREE = np.full(3, np.inf)


@pytest.fixture(scope="module")
def inverse() -> rp.RepeatableInverse:
    task = rp.Robot.load("planar3r").task("tool", "xy")
    return rp.compiled(control(task, Q0, rp.Polynomial(Q0, 2, 0.5)))


def joints_of(
    inverse: rp.RepeatableInverse, target: pin.SE3, upper: np.ndarray = FREE
) -> np.ndarray | None:
    joints = target_joints.TargetJoints(
        inverse,
        governor_law.CommandLimits(FREE, FREE, FREE, -FREE, upper, 0.001, 0.004),
    )
    joints.start(Q0, inverse.leaf(Q0))
    for _ in range(100):
        joints.look_for(target)
    assert joints.known
    return joints.found


def moved(inverse: rp.RepeatableInverse, x: float, y: float) -> pin.SE3:
    place = inverse.task.placement(Q0)
    return pin.SE3(place.rotation, place.translation + [x, y, 0.0])


def test_they_are_those_of_small_steps_along_the_line(
    inverse: rp.RepeatableInverse,
) -> None:
    q, leaf = Q0, inverse.leaf(Q0)
    for share in [*np.linspace(0, 1, 501)[1:], 1, 1]:
        q = inverse.step(q, moved(inverse, -0.6 * share, -0.9 * share), 1.0, leaf=leaf)
    found = joints_of(inverse, moved(inverse, -0.6, -0.9))
    assert np.abs(q - Q0).max() > 0.5
    np.testing.assert_allclose(found, q, atol=1e-9)


def test_there_are_none_out_of_reach_or_beyond_a_limit(
    inverse: rp.RepeatableInverse,
) -> None:
    assert joints_of(inverse, moved(inverse, 5.0, 5.0)) is None
    target = moved(inverse, -0.6, -0.9)
    found = joints_of(inverse, target)
    assert found is not None
    upper = np.maximum(found, Q0) + 0.1
    assert joints_of(inverse, target, upper) is not None
    upper[np.argmax(found - Q0)] -= 0.2
    assert joints_of(inverse, target, upper) is None


def test_the_direction_is_along_the_leaf_and_around_a_singularity(
    inverse: rp.RepeatableInverse,
) -> None:
    def regular(q: np.ndarray) -> float:
        return governor_law.regularity(inverse.task.jacobian(q), inverse(q))

    goal = joints_of(inverse, moved(inverse, -0.6, -0.9))
    assert goal is not None
    q, far = (
        Q0,
        moved(inverse, 5.0, 5.0).translation - moved(inverse, 0.0, 0.0).translation,
    )
    V = inverse.potentials.gradients(q[None])[0]
    d = leaf_direction.leaf_direction(inverse, q, goal)
    assert regular(q) > leaf_direction.ALONG and np.abs(V.T @ d).max() < 1e-12
    assert np.linalg.matrix_rank(np.column_stack([goal - q - d, V]), tol=1e-9) == 1
    while regular(q) > 0.5 * leaf_direction.ALONG:  # towards the edge of the reach
        q = q + 0.002 * inverse(q) @ (far[:2] / np.linalg.norm(far))
    beyond = q + 0.3 * inverse(q) @ far[:2]
    d = leaf_direction.leaf_direction(inverse, q, beyond)
    V = inverse.potentials.gradients(q[None])[0]
    assert np.abs(V.T @ d).max() < 1e-9 * np.linalg.norm(d)
    assert regular(q + 1e-5 * d / np.linalg.norm(d)) > regular(q)
