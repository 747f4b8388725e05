"""Motions through poses of a cell: on their lines, on F, within the limits, whatever the order."""

from __future__ import annotations

import pickle
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from cell_functions import function_of
from controls import some
from sectors import found

import repctl_pin as rp

FRANKA = rp.Limits(acceleration="panda", jerk="panda")
RATE = 10_000.0
ROUNDING = 0.02
"""Largest share of a jerk limit that rounding adds to differences over 0.1 ms."""


@cache
def function(name: str) -> rp.InverseFunction:
    kind, _, which = name.partition(": ")
    return function_of(which) if kind == "cell" else found(which).function


def poses_of(F: rp.InverseFunction, count: int, seed: int = 0) -> list[pin.SE3]:
    """Random poses of a cell; in a sector in the order of the angle, so that corners are blunt."""
    U = 0.9 * F.cell.sample(count, seed)
    return [F.cell.at(u) for u in (U[np.argsort(U[:, 1])] if "angle" in F.cell.names else U)]


def largest_share(moved: rp.MotionBetween) -> float:
    """Largest used share of the limits of speed, acceleration and jerk: of differences of the
    samples, and of the derivatives."""
    _, *exact = moved.trajectory.derivatives(moved.t)
    by_difference = [np.diff(moved.q, k, axis=0) * RATE**k for k in (1, 2, 3)]
    limits = moved.velocity, moved.acceleration, moved.jerk
    shares = [
        float((np.abs(values) / limit).max())
        for three in (exact, by_difference)
        for values, limit in zip(three, limits, strict=True)
    ]
    shares[-1] -= ROUNDING
    return max(shares)


CASES = {
    "cell: poses": 0.03,
    "cell: positions": 0.03,
    "cell: tool axes": 0.03,
    "sector: position": 0.05,
}


@pytest.mark.parametrize("name", some(CASES, "cell: poses", "sector: position"))
def test_every_sample_is_f_within_the_limits(name: str) -> None:
    F = function(name)
    poses = poses_of(F, 6)
    blend = CASES[name]
    moved = rp.motion_between(F, poses, FRANKA, blend=blend, rate=RATE)
    assert moved.rests[0] == 0 and moved.rests[-1] == 5
    assert (len(moved.rests) < 6) == (blend > 0)
    assert largest_share(moved) <= 1.0
    rows = np.rint(moved.times[list(moved.rests)] * RATE).astype(int)
    assert (moved.q[rows] == [F(poses[k]) for k in moved.rests]).all()
    assert not moved.qdot[rows].any()
    some = moved.q[::37]
    X = np.array([F.task.placement(q).homogeneous for q in some])
    assert np.abs(F.batch(X) - some).max() < 1e-12
    assert np.abs(moved.at(moved.t[::37]) - some).max() < 1e-14
    assert (moved.at(-1.0) == moved.at(0.0)).all()
    assert np.array_equal(pickle.loads(pickle.dumps(moved)).at(0.3), moved.at(0.3))


def test_joints_do_not_depend_on_the_order_of_the_poses() -> None:
    F, random = function("cell: poses"), np.random.default_rng(0)
    poses = poses_of(F, 5)
    Q = np.array([F(x) for x in poses])
    for _ in range(4):
        order = random.permutation(5)
        moved = rp.motion_between(F, [poses[k] for k in order], rp.Limits(acceleration=5.0))
        rows = np.rint(moved.times * 1000).astype(int)
        assert moved.rests == (0, 1, 2, 3, 4)
        assert (moved.q[rows] == Q[order]).all()


def test_the_tool_moves_straight_and_turns_about_one_axis() -> None:
    F = function("cell: poses")
    for start, end in zip(poses_of(F, 4), poses_of(F, 4)[1:], strict=False):
        moved = rp.motion_between(F, [start, end], FRANKA)
        assert moved.lines == ("tool",)
        X = [F.task.placement(q) for q in moved.q]
        way = end.translation - start.translation
        gone = np.array([x.translation for x in X]) - start.translation
        share = gone @ way / (way @ way)
        assert np.abs(gone - share[:, None] * way).max() < 1e-12
        turned = np.array([pin.log3(x.rotation @ start.rotation.T) for x in X])
        whole = pin.log3(end.rotation @ start.rotation.T)
        assert np.abs(turned - share[:, None] * whole).max() < 1e-11


def test_a_line_that_leaves_the_cell_is_straight_in_its_coordinates() -> None:
    """Between two corners of the rotations the shortest turn leaves the box; and in a sector a
    chord comes too near to the axis."""
    F = function("cell: poses")
    ends = np.array([[0, 0, 0, 1, 1, -1], [0, 0, 0, 1, -1, 1]], float)
    G = function("sector: position")
    for function_, U in ((F, ends), (G, np.array([[-0.5, -0.8, 0.0], [-0.5, 0.8, 0.2]]))):
        cell = function_.cell
        moved = rp.motion_between(function_, [cell.at(u) for u in U], FRANKA)
        assert moved.lines == ("cell",)
        X = [function_.task.placement(q) for q in moved.q]
        places = np.array([x.translation for x in X]), np.array([x.rotation for x in X])
        u = cell.inside(*cell.coordinates(*places))
        share = (u - U[0]) @ (U[1] - U[0]) / ((U[1] - U[0]) @ (U[1] - U[0]))
        assert np.abs(u - U[0] - share[:, None] * (U[1] - U[0])).max() < 1e-9


def test_blends_are_those_of_waypoints() -> None:
    """Independent oracle for the curve: the closed path through the same points, at the corner."""
    F, rho = function("cell: positions"), 0.02
    middle = F.cell.placement
    steps = np.array([[-0.08, -0.05, 0], [0.05, -0.05, 0], [0.05, 0.06, 0.05]])
    points = middle.translation + steps
    poses = [pin.SE3(middle.rotation, p) for p in points]
    resting, moved = (rp.motion_between(F, poses, FRANKA, blend=r) for r in (0.0, rho))
    assert (resting.rests, moved.rests) == ((0, 1, 2), (0, 2))
    assert moved.duration < resting.duration
    closed = rp.waypoints(np.vstack([points, points[:1]]), middle.rotation, blend=rho)
    curve = np.array([closed.point(s) for s in np.linspace(0, 1, 8001)])
    places = np.array([F.task.placement(q).translation for q in moved.q])
    corner = places[np.linalg.norm(places - points[1], axis=1) < 0.03]
    away = np.linalg.norm(corner[:, None] - curve, axis=2).min(axis=1)
    assert len(corner) > 30 and away.max() < 3e-5
    nearest = np.linalg.norm(places - points[1], axis=1).min()
    at = F.task.placement(moved.at(moved.times[1])).translation
    assert abs(np.linalg.norm(at - points[1]) - nearest) < 1e-5
    back = [poses[0], poses[1], poses[0]]
    assert rp.motion_between(F, back, FRANKA, blend=rho).rests == (0, 1, 2)


def test_a_pose_on_the_line_is_no_corner() -> None:
    F = function("cell: poses")
    a, b = F.cell.at(-0.5 * np.ones(6)), F.cell.at(0.4 * np.ones(6))
    turn = pin.log3(b.rotation @ a.rotation.T)
    way = b.translation - a.translation
    via = pin.SE3(pin.exp3(0.3 * turn) @ a.rotation, a.translation + 0.3 * way)
    whole = rp.motion_between(F, [a, b], FRANKA)
    moved = rp.motion_between(F, [a, via, b], FRANKA, blend=0.01)
    assert moved.rests == (0, 2)
    assert abs(moved.duration - whole.duration) < 0.01
    assert np.abs(moved.at(moved.times[1]) - F(via)).max() < 2e-3


def test_a_short_motion_takes_the_time_of_the_closed_form() -> None:
    """On a short straight joint path with bounded jerk J, ``T = (32 d / J)^⅓``."""
    F = function("cell: poses")
    start = F.cell.placement
    for step in (1e-5, 1e-7):
        end = pin.SE3(start.rotation, start.translation + [step, 0.0, 0.0])
        d = np.abs(F(end) - F(start))
        jerk = 10.0
        limits = rp.Limits(acceleration=1e3, jerk=jerk)
        moved = rp.motion_between(F, [start, end], limits, rate=1e5)
        T = (32 * d.max() / jerk) ** (1 / 3)
        assert abs(moved.duration / T - 1) < 0.02


def test_limits_of_tool_speed_and_very_low_jerk() -> None:
    F = function("cell: poses")
    poses = poses_of(F, 2)
    slow = rp.motion_between(F, poses, rp.Limits(acceleration=5.0, tool_speed=0.05))
    places = np.array([F.task.placement(q).translation for q in slow.q])
    speed = np.linalg.norm(np.diff(places, axis=0), axis=1) * 1000
    assert 0.999 < speed.max() / 0.05 <= 1.0
    gentle = rp.motion_between(F, poses, rp.Limits(acceleration=5.0, jerk=1e-3), rate=10.0)
    jerk = np.abs(gentle.trajectory.derivatives(np.linspace(0, gentle.duration, 9999))[3])
    assert 0.9 < jerk.max() / 1e-3 <= 1.0


def test_another_tool_moves_straight() -> None:
    T = pin.SE3(pin.rpy.rpyToMatrix(0.3, -0.5, 1.1), np.array([0.05, -0.03, 0.12]))
    F = function("cell: poses").with_tool(T)
    poses = [x * T for x in poses_of(function("cell: poses"), 3)]
    moved = rp.motion_between(F, poses, FRANKA)
    rows = np.rint(moved.times * 1000).astype(int)
    assert (moved.q[rows] == [F(x) for x in poses]).all()
    a, b = (x.translation for x in poses[:2])
    tips = np.array([F.task.placement(q).translation - a for q in moved.q[: rows[1]]])
    along = (b - a) / np.linalg.norm(b - a)
    assert np.abs(np.cross(tips, along)).max() < 1e-11


def test_it_can_be_written_run_and_approached(tmp_path: Path) -> None:
    F = function("cell: poses")
    poses = poses_of(F, 3)
    moved = rp.motion_between(F, poses, FRANKA, rate=100.0)
    table = np.genfromtxt(
        rp.write_motion(moved, tmp_path / "day.csv"), delimiter=",", skip_header=1
    )
    assert np.array_equal(table, np.hstack([moved.t[:, None], moved.q, moved.qdot, moved.qddot]))
    assert rp.write_motion(moved, tmp_path / "day.yaml").read_text().count("- pos") == len(table)
    run = rp.Run(moved)
    for k in range(400):
        q, _ = run.step(0.01, override=0.0 if 30 < k < 90 else 1.0)
    assert np.abs(q - F(poses[-1])).max() < 1e-14
    assert moved.motion is not None and moved.motion.limit_margin.min() > 0
    assert "3 poses" in repr(moved) and moved.stops == 1 and moved.cycle_time == moved.duration
    way = rp.approach(moved.q[0] + 0.1, moved.motion, FRANKA)
    assert np.allclose(way.q[-1], F(poses[0]), atol=1e-12)


def test_the_forms_of_poses_are_those_of_f() -> None:
    F = function("cell: poses")
    poses = poses_of(F, 2)
    moved = rp.motion_between(F, poses, FRANKA, rate=50.0)
    matrices = np.array([x.homogeneous for x in poses])
    rows = np.array([[*x.translation, *pin.Quaternion(x.rotation).coeffs()] for x in poses])
    assert np.array_equal(rp.motion_between(F, matrices, FRANKA, rate=50.0).q, moved.q)
    assert np.allclose(rp.motion_between(F, rows, FRANKA, rate=50.0).q, moved.q)


def test_what_cannot_be_is_refused_in_one_line() -> None:
    F = function("cell: poses")
    a, b = poses_of(F, 2)
    far = pin.SE3(b.rotation, b.translation + [0.5, 0.0, 0.0])
    nan = pin.SE3(a.rotation, np.array([np.nan, 0.0, 0.0]))
    for poses, words in (
        ([], "at least two poses; got none"),
        ([a], "at least two poses; got only one"),
        ([a, b, b], "pose 2 is equal to pose 1; remove one of them"),
        ([a, far], r"pose 1: the target lies outside the cell: x is \+0\.\d+ m from the middle"),
        ([a, nan], "pose 1 has a number that is not finite"),
        (np.zeros((2, 6)), r"poses must be a list of placements, or a \(P, 4, 4\) or"),
        ("ab", "poses must be a list of placements"),
    ):
        with pytest.raises(rp.InputError, match=words):
            rp.motion_between(F, poses, FRANKA)
    for limits, words in ((None, "limits must be rp.Limits"), (5.0, "limits must be")):
        with pytest.raises(rp.InputError, match=words):
            rp.motion_between(F, [a, b], limits)
    with pytest.raises(rp.InputError, match="lower the rate"):
        rp.motion_between(F, [a, b], FRANKA, rate=1e9)
    with pytest.raises(rp.InputError, match="F must be a function of a cell"):
        rp.motion_between(F.cell, [a, b], FRANKA)
    with pytest.raises(rp.InputError, match="t must be a finite number"):
        rp.motion_between(F, [a, b], FRANKA, rate=10.0).at([0.0, np.nan])


class Holed(rp.InverseFunction):
    """A function that has no configuration in a thin layer of its cell."""

    def batch(self, targets: Any, **how: Any) -> np.ndarray:
        Q = super().batch(targets, **how)
        hole = np.abs(targets[:, 0, 3] - self.cell.placement.translation[0]) < 0.01
        if how.get("missing") != "nan" and hole.any():
            raise rp.InputError("target 7: at here, joint4 would be outside its limits")
        Q[hole] = np.nan
        return Q


def test_a_motion_that_f_does_not_have_is_refused_with_the_reason() -> None:
    F = Holed(function("cell: poses").chart)
    ends = [F.cell.at(s * np.ones(6)) for s in (-0.8, 0.8)]
    words = "no motion from pose 0 to pose 1: at here, joint4 would be outside its limits; go"
    with pytest.raises(rp.InputError, match=words):
        rp.motion_between(F, ends, FRANKA)


@pytest.mark.slow
def test_a_thousand_days_in_random_orders() -> None:
    F, random = function("cell: poses"), np.random.default_rng(1)
    poses = poses_of(F, 10)
    Q = np.array([F(x) for x in poses])
    for _ in range(1000):
        order = random.permutation(10)
        moved = rp.motion_between(F, [poses[k] for k in order], rp.Limits(acceleration="panda"))
        rows = np.rint(moved.times * 1000).astype(int)
        assert (moved.q[rows] == Q[order]).all() and not moved.qdot[rows].any()
