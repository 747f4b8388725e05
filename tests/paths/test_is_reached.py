"""All points of a path at once have solutions where they have them one after another."""

from __future__ import annotations

from importlib import import_module

import numpy as np
import pytest

import repctl_pin as rp

IK = import_module(rp.solve_ik.__module__)

Q0 = np.array([0.3, 0.8, 0.8])


def circle_and_cycle(radius: float) -> tuple[rp.Task, rp.ClosedPath, np.ndarray]:
    """A circle of planar3r and the first cycle of J⁺ on it."""
    task = rp.Robot.load("planar3r").task("tool", "xy")
    path = rp.circle(task, Q0, radius)
    return task, path, rp.follow(rp.Pseudoinverse(task), path, Q0, cycles=1, steps=96).q


@pytest.mark.parametrize("radius", [0.05, 0.3, 0.6])
def test_a_path_that_is_solved_point_by_point_is_reached(radius: float) -> None:
    task, path, Q = circle_and_cycle(radius)
    IK.check_reach(task, Q0, path)
    assert IK.is_reached(task, path, Q)
    # errors of the motion are corrected, jumps of a joint are not
    rng = np.random.default_rng(0)
    assert IK.is_reached(task, path, Q + rng.uniform(-0.02, 0.02, Q.shape))
    assert not IK.is_reached(task, path, Q + [[0.9, 0.0, 0.0]])


def test_a_corner_beyond_the_arm_is_not_reached() -> None:
    """The arm is 3 m long. The motion belongs to the same corners, drawn in."""
    task, start = rp.Robot.load("planar3r").task("tool", "xy"), np.array([0.0, 0.3, 0.3])
    p = task.placement(start).translation
    assert 2.5 < np.linalg.norm(p) < 3
    near = rp.waypoints([p, p + [-0.1, -0.1, 0], p + [-0.2, 0, 0], p], np.eye(3))
    far = rp.waypoints([p, p + [0.3, 0.1, 0], p + [-0.2, 0, 0], p], np.eye(3))
    Q = rp.follow(rp.Pseudoinverse(task), near, start, cycles=1, steps=96).q
    assert IK.is_reached(task, near, Q)
    assert not IK.is_reached(task, far, Q)
    with pytest.raises(rp.InputError):
        IK.check_reach(task, start, far)
