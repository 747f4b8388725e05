"""Item 26.16: a path is proved to close itself, or the words say at how many points it was
checked."""

from __future__ import annotations

import pickle
import warnings
from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from controls import some
from inside import boxes, closed_path_proof, leaf_margin_bounds

import repctl_pin as rp
from repctl_pin.paths.task_path import with_arc

FEW = rp.FitOptions(samples=256, held_out=64)
Q = np.array([0.3, 0.9, 0.9])


@cache
def planar(degree: int = 3) -> rp.Design:
    task = rp.Robot.load("planar3r").task("tool", "xy")
    return rp.nearest_repeatable(rp.Pseudoinverse(task), None, rp.Box(Q, 0.5), degree=degree)


def turned_in_a_moment(task: rp.Task) -> rp.TaskPath:
    """A circle of 5 cm whose plane makes a full turn around the base within 1/480 of the cycle."""
    loop, width = rp.circle(task, Q, 0.05), 1 / 480

    def angle(s: float) -> float:
        u = min(max((s - 0.5) / width, 0.0), 1.0)
        return float(2 * np.pi * u**3 * (10 - 15 * u + 6 * u * u))

    def rate(s: float) -> float:
        u = min(max((s - 0.5) / width, 0.0), 1.0)
        return float(2 * np.pi * 30 * u**2 * (1 - u) ** 2 / width)

    def rotation(s: float) -> np.ndarray:
        return np.asarray(pin.exp3(np.array([0.0, 0.0, angle(s)])))

    def slope(s: float) -> np.ndarray:
        R = rotation(s)
        return R @ loop.slope(s) + rate(s) * np.cross([0, 0, 1.0], R @ loop.point(s))

    return rp.TaskPath(
        "turned", lambda s: rotation(s) @ loop.point(s), slope, task.placement(Q).rotation
    )


@pytest.mark.slow
def test_a_turn_between_two_samples_is_not_proved_to_close() -> None:
    """The motion ends (6.15, 0.86, −1.43) rad off, which 500 samples do not see. Without bounds of
    its arcs the words say what was checked; with a true one, the turn is found."""
    design = planar()
    path = turned_in_a_moment(design.task)
    fine = rp.follow(design.inverse, path, Q, cycles=1, steps=10_000, integrator=rp.LeafLock(2))
    assert np.abs(fine.q[-1] - Q).max() > 6
    closes = rp.prove(design, margin=0.01, closes=path).closes
    assert closes and closes.checked == 500 and not closes.path_proved
    assert closes.words.endswith("close, if the path itself closes (checked at 500 points)")

    def arc(a: float, b: float) -> tuple[float, float]:
        """The true length of an arc, from above: the rate of the turn is at most its largest."""
        touched = max(0.0, min(b, 0.5 + 1 / 480) - max(a, 0.5))
        return 0.1 * np.pi * (b - a) + 2 * np.pi * 1.875 * 480 * touched * 3.2, 0.0

    found = rp.prove(design, margin=0.01, closes=with_arc(path, arc)).closes
    assert not found and "the path itself does not close, by 6" in found.reason


@pytest.mark.parametrize(
    "name", some(["planar3r", "panda", "planar4r", "tiago", "ur5"], "planar4r")
)
def test_the_motion_is_in_its_boxes_between_the_samples(name: str) -> None:
    """Four times the steps, followed on the leaf, are the oracle."""
    problem = rp.Problem(name)
    task, q = problem.task, problem.start
    box = rp.Box(q, 0.4)
    design = rp.nearest_repeatable(rp.Pseudoinverse(task), None, box, degree=2, options=FEW)
    for path in (problem.cycle, rp.polygon(task, q, [[0.03, 0, 0], [0.03, 0.02, 0]], blend=0.003)):
        found = around(design, path, q)
        assert found.proved and not found.reason
        steps = len(found.Q) - 1
        if path.breaks:
            continue
        fine = rp.follow(
            design.inverse, path, q, cycles=1, steps=4 * steps, integrator=rp.LeafLock(4)
        )
        for k in range(5):
            off = np.abs(fine.q[k::4][:steps] - found.Q[:-1])
            assert (off <= found.half[:-1] + 1e-12).all()
        assert found.half.max() < 0.01


def around(design: rp.Design, path: rp.TaskPath, q: np.ndarray) -> closed_path_proof.Enclosure:
    box = boxes.enclosing(*boxes.cover(design.region))
    problem = leaf_margin_bounds.leaf_margin_of(design.task, design.inverse.potentials, box)
    return closed_path_proof.enclosed(design.inverse, problem, path, q)


def test_a_path_round_the_base_is_not_proved(tmp_path: Path) -> None:
    """Each arc is proved, but the end is not the start."""
    task = rp.Robot.load("planar3r").task("tool", "xy")
    box = rp.Box((0, 1.26, 0.385), (3.4, 0.55, 0.75))
    design = rp.nearest_repeatable(rp.Pseudoinverse(task), None, box, degree=3)
    q = np.array([-3.1, 0.9, 0.9])
    x, y, _ = task.placement(q).translation
    ring = rp.circle(task, q, float(np.hypot(x, y)), start_angle=float(np.arctan2(y, x)))
    found = around(design, ring, q)
    assert not found.proved and "does not close" in found.reason


@pytest.mark.slow
def test_both_hands_are_enclosed_though_one_is_still() -> None:
    task = rp.Robot.load("baxter").task(["left_gripper", "right_gripper"], "position")
    q = rp.Problem(task, path=False).start
    desired, box = rp.Pseudoinverse(task), rp.Box(q, 0.3)
    design = rp.nearest_repeatable(desired, None, box, degree=1, options=FEW)
    path = rp.several_paths(task, q, [lambda one, at: rp.circle(one, at, 0.02), None])
    assert around(design, path, q).proved


@pytest.mark.slow
def test_lengths_of_arcs_are_bounds() -> None:
    """Sums of chords of random arcs never exceed them; polynomial pieces have their own."""
    problem = rp.Problem("panda")
    task, q = problem.task, problem.start
    here, rng = task.placement(q), np.random.default_rng(0)
    turns = [here.rotation @ pin.exp3(0.4 * rng.normal(size=3)) for _ in range(5)]
    corners = here.translation + 0.1 * rng.normal(size=(5, 3))
    turning = [*corners, corners[0]], [*turns, turns[0]]
    paths = [
        rp.circle(task, q, 0.1, rotation="tangent"),
        rp.circle(task, q, 0.1, rotation=[0.2, 0.1, 0.2]),
        rp.figure_eight(task, q, 0.1),
        rp.polygon(task, q, [[0.1, 0, 0], [0.1, 0.1, 0], [0, 0.1, 0]], blend=0.02),
        rp.waypoints(*turning),
        rp.waypoints(*turning, times=[0, 0.1, 3, 4, 4.2, 6]),
    ]
    for path in list(paths):
        paths.append(pickle.loads(pickle.dumps(path)))
    for path in paths:
        assert path.arc is not None
        for a, b in (sorted(rng.uniform(0, 1, 2)) for _ in range(8)):
            b = min(b, a + 0.03)
            if any(a <= s <= b for s in path.breaks):
                continue
            poses = [path.placement(s) for s in np.linspace(a, b, 20)]
            steps = list(pairwise(poses))
            length = sum(np.linalg.norm(y.translation - x.translation) for x, y in steps)
            turned = sum(np.linalg.norm(pin.log3(x.rotation.T @ y.rotation)) for x, y in steps)
            most = np.array(path.arc(a, b))
            assert (np.array([length, turned]) <= most * (1 + 1e-9) + 1e-9).all()


def test_a_changed_curve_has_no_bounds_of_its_arcs() -> None:
    path = rp.circle(planar().task, Q, 0.1)
    assert replace(path, point=path.point).arc is None


def test_the_number_of_points_is_kept_in_a_file(tmp_path: Path) -> None:
    """A path that was only checked cannot become a proved one, nor by a file that leaves it out."""
    design = planar()
    path = turned_in_a_moment(design.task)
    for closes, checked in ((path, 500), (rp.circle(design.task, Q, 0.05), 0)):
        proof = rp.prove(design, margin=0.01, closes=closes)
        file = rp.save(replace(design, proof=proof), tmp_path / "design.json")
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            again = rp.load(file).proof
        assert again is not None and again.closes.checked == checked
        assert again.closes.path_proved == (checked == 0)
        with pytest.raises(rp.InputError, match="changed in part"):
            replace(proof, closes=replace(proof.closes, checked=500 - checked))
