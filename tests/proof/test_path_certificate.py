"""A path's own certificate: circles can be shrunk, rings round the base cannot."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from controls import some
from test_counter_examples import RINGS

import repctl_pin as rp

FEW = rp.FitOptions(samples=256, held_out=64)


@cache
def inverse_around(name: str) -> tuple[rp.RepeatableInverse, rp.Problem]:
    problem = rp.Problem(name)
    desired, box = rp.Pseudoinverse(problem.task), rp.Box(problem.start, 0.4)
    design = rp.nearest_repeatable(desired, None, box, degree=1, options=FEW)
    return design.inverse, problem


@pytest.mark.parametrize("name", some(["panda", "planar3r", "planar4r", "tiago"], "planar4r"))
def test_a_circle_shrinks_and_so_do_the_motions_along_it(name: str) -> None:
    """Circles through the start, of smaller radius, are the paths of the theorem: each closes,
    and each is on the straight lines to the poses of the largest."""
    inverse, problem = inverse_around(name)
    task, q0, path = problem.task, problem.start, problem.cycle
    found = rp.path_certificate(inverse, path, q0)
    assert found and not found.reason and found.gap < 1e-9 and found.mismatch < 1e-9
    assert "it closes: checked at 121 poses, not proved" in found.words
    pose, radius = task.placement(q0), 0.04
    for share in (0.25, 0.5, 1.0):
        loop = rp.circle(task, q0, share * radius)
        motion = rp.follow(inverse, loop, q0, cycles=1, steps=240)
        assert np.abs(motion.q[-1] - q0).max() < 1e-8
        half = rp.circle(task, q0, radius).placement(0.5)
        half.translation = pose.translation + share * (half.translation - pose.translation)
        assert inverse.solve(half, q0) == pytest.approx(motion.q[120], abs=1e-7)


@pytest.mark.parametrize("case", some(RINGS, "planar, r = 2"))
def test_a_ring_round_the_base_does_not_shrink(case: str, tmp_path: Path) -> None:
    make, start = RINGS[case]
    task, q = make(tmp_path), np.array(start, float)
    x, y, _ = task.placement(q).translation
    turn = float(np.arctan2(y, x))
    path = rp.circle(task, q, float(np.hypot(x, y)), start_angle=turn)
    ways = rp.follow(rp.Pseudoinverse(task), path, q, cycles=1, steps=200).q
    tube = rp.Tube(ways, 0.25)
    desired = rp.Pseudoinverse(task)
    design = rp.nearest_repeatable(desired, None, tube, degree=2, options=FEW)
    found = rp.path_certificate(design.inverse, path, q)
    assert not found and not found.mismatch < 0.1
    assert found.words.startswith("the path need not close: the arm cannot follow")


def there_and_back(task: rp.Task, q: np.ndarray, turns: float) -> rp.TaskPath:
    """A part of a circle round the base, and back on it."""
    x, y, z = task.placement(q).translation

    def angle(s: float) -> float:
        return float(np.pi * turns * (1 - np.cos(2 * np.pi * s)))

    def rate(s: float) -> float:
        return float(2 * np.pi**2 * turns * np.sin(2 * np.pi * s))

    def point(s: float) -> np.ndarray:
        c, k = np.cos(angle(s)), np.sin(angle(s))
        return np.array([c * x - k * y, k * x + c * y, z])

    def slope(s: float) -> np.ndarray:
        p = point(s)
        return rate(s) * np.array([-p[1], p[0], 0.0])

    return replace(rp.circle(task, q, 0.1), point=point, slope=slope)


def test_a_path_that_goes_back_on_itself_closes_without_a_certificate() -> None:
    """The motion ends where it began, but the straight lines cross the base: it is not enough that
    the motion closes."""
    task = rp.Robot.load("planar3r").task("tool", "xy")
    box = rp.Box((0, 1.26, 0.385), (3.4, 0.55, 0.75))
    inverse = rp.nearest_repeatable(rp.Pseudoinverse(task), None, box, degree=3).inverse
    q = np.array([-3.1, 0.9, 0.9])
    long, short = (there_and_back(task, q, turns) for turns in (0.8, 0.05))
    found = rp.path_certificate(inverse, long, q)
    assert found.gap < 1e-6 and not found
    assert rp.path_certificate(inverse, short, q)


@pytest.mark.slow
def test_both_hands_at_once() -> None:
    task = rp.Robot.load("baxter").task(["left_gripper", "right_gripper"], "position")
    q = rp.Problem(task, path=False).start
    desired, box = rp.Pseudoinverse(task), rp.Box(q, 0.3)
    inverse = rp.nearest_repeatable(desired, None, box, degree=1, options=FEW).inverse
    small = [lambda one, at: rp.circle(one, at, 0.03), None]
    found = rp.path_certificate(inverse, rp.several_paths(task, q, small), q)
    assert found and found.gap < 1e-7


def test_wrong_arguments_are_named() -> None:
    inverse, problem = inverse_around("planar3r")
    with pytest.raises(rp.InputError, match="inverse"):
        rp.path_certificate(rp.Pseudoinverse(problem.task), problem.cycle, problem.start)  # type: ignore[arg-type]
    with pytest.raises(rp.InputError, match="path"):
        rp.path_certificate(inverse, "circle", problem.start)  # type: ignore[arg-type]
    with pytest.raises(rp.InputError, match="start"):
        rp.path_certificate(inverse, problem.cycle, problem.start + 0.1)
    with pytest.raises(rp.InputError, match="q0"):
        rp.path_certificate(inverse, problem.cycle, [0.0])


@pytest.mark.parametrize(
    "name", some(["panda", "planar3r", "planar4r", "tiago", "xarm7"], "planar4r")
)
@pytest.mark.parametrize("corners", some([3, 4, 7, 11, 30], 3, 30))
def test_random_polygons_that_close_are_shrunk(name: str, corners: int) -> None:
    """Item 26.15: steps are not uniform on a path with corners, so a ray must end at the value of s
    at which the motion is known. Newton from corner to corner is the oracle."""
    inverse, problem = inverse_around(name)
    task, q0 = problem.task, problem.start
    rng = np.random.default_rng(corners)
    for _ in range(2):
        edges = rng.normal(size=(corners - 1, 3)) * [0.02, 0.02, 0 if task.kind == "xy" else 0.02]
        path = rp.polygon(task, q0, edges)
        q = q0
        for s in (*path.breaks, 1.0):
            q = inverse.solve(path.placement(s % 1.0), q)
        assert np.abs(q - q0).max() < 1e-9
        found = rp.path_certificate(inverse, path, q0)
        assert found and found.mismatch < 1e-9 and found.poses >= 121, found.words
