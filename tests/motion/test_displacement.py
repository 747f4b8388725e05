"""How far bodies are off, and where the drift leads, against brute force."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import repctl_pin as rp
from repctl_pin.motion.displacement import displacements, leaves_range
from repctl_pin.robot.visuals import Visuals
from repctl_pin.show.page.body_points import body_drift, corners


def test_a_body_is_off_by_the_way_of_its_farthest_point() -> None:
    """Random bodies and placements; every point of a body, also inside it, against the corners."""
    rng = np.random.default_rng(0)
    bodies = [rng.normal(size=(count, 3)) for count in (1, 8, 200)]
    before, after = (
        np.array([[pin.SE3.Random().homogeneous for _ in bodies] for _ in range(7)])
        for _ in range(2)
    )
    way, which = displacements(before, after, bodies)
    for t in range(7):
        for s, points in enumerate(bodies):
            moved = [after[t, s] @ [*p, 1] - before[t, s] @ [*p, 1] for p in points]
            ways = np.linalg.norm(moved, axis=1)
            assert way[t, s] == pytest.approx(ways.max(), abs=1e-12)
            assert ways[which[t, s]] == pytest.approx(ways.max(), abs=1e-12)
            inside = rng.dirichlet(np.ones(len(points)), 50) @ points
            D = (after - before)[t, s]
            assert (
                np.linalg.norm(np.c_[inside, np.ones(50)] @ D.T, axis=1).max()
                <= way[t, s] + 1e-9
            )


def test_what_stands_still_is_not_off() -> None:
    place = np.array([[pin.SE3.Random().homogeneous]])
    assert displacements(place, place, [np.ones((4, 3))])[0].tolist() == [[0.0]]


def test_round_bodies_are_measured_to_a_percent() -> None:
    """A sphere of radius R that turns by φ about a point at distance d: 2 (d + R) sin(φ/2)."""
    visuals = Visuals.of(rp.Robot.load("planar3r"))
    shape = next(
        s for s in visuals.shapes if s.kind in ("sphere", "capsule", "cylinder")
    )
    sphere = replace(shape, kind="sphere", size=(0.2,), path=None)
    still, turned = np.eye(4), np.eye(4)
    turned[:3, :3] = pin.exp3(np.array([0.0, 0.0, 0.5]))
    shift = np.eye(4)
    shift[0, 3] = 0.7
    placements = np.array([[still @ shift], [turned @ shift]])
    off = body_drift(corners([sphere]), placements, 2).off
    # the end of a cycle is measured against the start
    assert off[1, 0] == pytest.approx(2 * (0.7 + 0.2) * np.sin(0.25), rel=0.01)


def moving(q: np.ndarray, cycles: int) -> rp.Motion:
    """A motion of planar3r with these joint positions."""
    task = rp.Robot.load("planar3r").task(kind="xy")
    q0 = np.array([0.3, 0.8, 0.8])
    made = rp.follow(
        rp.Pseudoinverse(task), rp.circle(task, q0, 0.1), q0, cycles=cycles, steps=40
    )
    return replace(made, q=q, qdot=np.zeros_like(q), drift=np.ones(cycles))


def test_a_steady_drift_leaves_the_range_when_it_says() -> None:
    """Joint 2 swings and creeps by 0.11 rad a cycle: the same motion run on, step by step."""
    task = rp.Robot.load("planar3r").task(kind="xy")
    upper = task.joint_limits[1]

    def at(s: np.ndarray) -> np.ndarray:
        swing = 0.1 * np.sin(2 * np.pi * s)
        return np.c_[0.3 + swing, 0.8 + 0.11 * s + swing, 0.8 - 0.01 * s]

    found = leaves_range(moving(at(np.linspace(0, 2, 81)), 2))
    s = np.linspace(0, 100, 4001)
    left = np.argmax(at(s)[:, 1] > upper[1]) / 40
    assert found == (int(left) + 1, task.robot_joints[1])


def test_no_drift_leads_nowhere() -> None:
    still = np.tile([0.3, 0.8, 0.8], (81, 1))
    assert leaves_range(moving(still, 2)) is None
    gone = still + np.linspace(0, 10, 81)[:, None]  # beyond the range already
    assert leaves_range(moving(gone, 2)) is None
