"""Proofs of a cell's function: F stays where it is enclosed, its margins hold, and what is false is
not proved."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
import sectors
from arms import spatial_task
from controls import evaluate_cells_quickly
from inside import cell_bounds, margins

import repctl_pin as rp


def function_over(
    task: rp.Task,
    placement: pin.SE3,
    half_width: object,
    rotation: object,
    count: int = 256,
    degree: int = 3,
) -> rp.CellDesign:
    cell = rp.Cell(task, placement, half_width, rotation)
    options = rp.FitOptions(samples=count, held_out=count)
    return rp.nearest_inverse_function(rp.Pseudoinverse(task), cell, degree=degree, options=options)


def quick_function_over(*given: Any) -> rp.CellDesign:
    """A function of lower degree, fitted to fewer poses, whose worst ones were searched briefly."""
    with pytest.MonkeyPatch.context() as patch:
        evaluate_cells_quickly(patch)
        return function_over(*given, count=64, degree=2)


@pytest.fixture(scope="module")
def middle(panda_pose: rp.Task) -> pin.SE3:
    x = panda_pose.placement(panda_pose.reference)
    return pin.SE3(x.rotation, x.translation + np.array([0.15, 0, -0.19]))


@pytest.fixture(scope="module")
def places(panda_pose: rp.Task, middle: pin.SE3) -> rp.CellDesign:
    return function_over(panda_pose, middle, (0.05, 0.1, 0.05), 0.0)


@pytest.fixture(scope="module")
def turned(panda_pose: rp.Task, middle: pin.SE3) -> rp.CellDesign:
    return quick_function_over(panda_pose, middle, 0.03, 0.1)


@pytest.fixture(scope="module")
def small(panda_pose: rp.Task, middle: pin.SE3) -> rp.CellDesign:
    return quick_function_over(panda_pose, middle, (0.05, 0.1, 0.05), 0.0)


def check_enclosures(found: rp.CellDesign, width: float, count: int = 16) -> float:
    """Evaluate F in many boxes of poses: inside the enclosure; how much of its width is used; the
    share enclosed."""
    chart, task = found.function.chart, found.task
    problem, rng, k = cell_bounds.CellProof(chart), np.random.default_rng(0), found.cell.k
    Uc = rng.uniform(width - 1, 1 - width, (count, k))
    half = width * rng.uniform(0.3, 1, Uc.shape)
    bounds = problem.bounds(Uc, half)
    Q, reach = bounds.Q, bounds.reach
    good = bounds.leaf_margin > 0
    used = 0.0
    for trial in range(12):
        way = np.sign(rng.standard_normal(Uc.shape)) if trial % 2 else rng.uniform(-1, 1, Uc.shape)
        points = chart.solve(Uc + half * way, np.zeros((count, task.r)))
        inside = (np.abs(points.Q - Q) / reach)[good]
        used = max(used, float(inside.max()))
        assert (inside <= 1 + 1e-9).all()
        assert (problem.away(points)[good] <= problem.near).all()
        assert (margins.leaf_margins(chart, points) >= bounds.leaf_margin - 1e-9).all()
        sigma = np.linalg.svd(task.jacobians(points.Q), compute_uv=False)[:, -1]
        assert (sigma >= bounds.sigma_min - 1e-9).all()
        assert (task.limit_margin(points.Q).min(axis=1) >= bounds.limit_margin - 1e-9).all()
    assert used > 0.5
    return float(good.mean())


def test_the_function_stays_in_the_boxes_it_is_enclosed_in(turned: rp.CellDesign) -> None:
    assert check_enclosures(turned, 0.05) > 0.9


@pytest.mark.slow
def test_the_function_of_one_orientation_stays_in_the_boxes_it_is_enclosed_in(
    places: rp.CellDesign,
) -> None:
    assert check_enclosures(places, 0.02) == 1.0


@pytest.mark.slow
def test_a_cell_is_proved_near_to_what_was_found(places: rp.CellDesign, tmp_path: Path) -> None:
    proof = rp.prove(places)
    assert proof and "is the only solution" in proof.what
    assert 0.9 * places.leaf_margin <= proof.leaf_margin <= places.leaf_margin + 1e-9
    assert places.limit_margin_worst - 0.05 < proof.limit_margin <= places.limit_margin_worst + 1e-6
    U = places.cell.sample(2048, 5)
    Q = places.function.batch(U)
    assert places.task.limit_margin(Q).min() >= proof.limit_margin
    certain = replace(places, proof=proof)
    assert "proved > 0.9" in certain.summary() and "found, not proved" in places.summary()
    loaded = rp.load(rp.save(certain, tmp_path / "cell.json"))
    assert repr(loaded.proof) == repr(proof)


def test_what_is_false_of_a_cell_is_not_proved_and_the_pose_is_shown(small: rp.CellDesign) -> None:
    asked = small.limit_margin_worst + 0.02
    proof = rp.prove(small, limit_margin=asked)
    assert not proof and proof.reason.startswith("the limit margin there is")
    q = small.function.batch(proof.worst[None])[0]
    assert small.task.limit_margin(q).min() < asked


def test_a_cell_that_is_not_covered_is_not_proved(small: rp.CellDesign) -> None:
    chart = small.function.chart
    beyond = rp.InverseFunction(replace(chart, cell=small.cell.scaled(6.0)), keep_limits=False)
    proof = rp.prove(replace(small, function=beyond), margin=0, limit_margin=-9.0, seconds=20)
    assert (
        not proof
        and proof.leaf_margin == 0
        and proof.reason == "no configuration exists on this leaf at that pose"
    )
    with pytest.raises(rp.InputError, match="no configuration exists on this leaf"):
        beyond.batch(proof.worst[None])


@pytest.mark.slow
def test_an_arm_with_a_prismatic_joint_is_enclosed_too(tmp_path: Path) -> None:
    task = spatial_task(7, tmp_path, kind="pose", seed=3)
    rng = np.random.default_rng(0)
    Q = task.reference + rng.uniform(-0.7, 0.7, (64, 7))
    q = Q[np.argmax(np.linalg.svd(task.jacobians(Q), compute_uv=False)[:, -1])]
    cell = rp.Cell(task, task.placement(q), 0.02, 0.02)
    desired = rp.Pseudoinverse(task)
    found = rp.nearest_inverse_function(
        desired, cell, posture=q, degree=2, options=rp.FitOptions(samples=256, held_out=256)
    )
    assert check_enclosures(found, 0.02, 12) > 0.5


OTHERS = {
    "xy": ("planar4r", "tool", (0.2,)),
    "axis": ("panda", "panda_hand_tcp", (0.03, 0.1)),
    "position": ("panda", "panda_hand_tcp", (0.05,)),
}
"""Cells of other tasks: robot, frame, and half-widths, m and rad."""


@pytest.mark.slow
@pytest.mark.parametrize("kind", OTHERS)
def test_cells_of_other_tasks_are_proved(kind: str) -> None:
    name, frame, size = OTHERS[kind]
    task = rp.Robot.load(name).task(frame, kind)
    q = task.reference
    found = rp.nearest_inverse_function(
        rp.Pseudoinverse(task),
        rp.Cell(task, task.placement(q), *size),
        posture=q,
        degree=2,
        options=rp.FitOptions(samples=64, held_out=64),
    )
    assert check_enclosures(found, 0.05, 8) == 1.0
    proof = rp.prove(found)
    assert proof and f", {kind}: n = " in proof.what, proof.reason
    assert 0.85 * found.leaf_margin < proof.leaf_margin <= found.leaf_margin + 1e-9
    assert proof.limit_margin > found.limit_margin_worst - 0.15


def test_a_sector_is_proved_at_every_angle_and_spin() -> None:
    """Over its reduced coordinates: the symmetric ones need no boxes."""
    design = sectors.found("one orientation")
    asked = design.evaluation.limit_margin_worst - 0.05
    proof = rp.prove(design, margin=0.6, limit_margin=asked)
    assert proof, proof.reason
    assert len(proof.worst) == design.function.chart.cell.k < design.cell.k
    chart, whole, rng = design.function.chart, design.cell, np.random.default_rng(0)
    U = rng.uniform(-1, 1, (400, whole.k))
    Q = design.function.batch(U)
    p, R = whole.placements(U)
    for q, place, turn in zip(Q[:20], p, R, strict=False):
        x = design.task.placement(q)
        np.testing.assert_allclose(x.translation, place, atol=1e-9)
        np.testing.assert_allclose(x.rotation, turn, atol=1e-9)
    others = whole.limit_margin(Q)[:, 1:]  # the first joint goes as far as it can
    assert others.min() >= proof.limit_margin - 1e-9
    points = chart.solve(rng.uniform(-1, 1, (400, chart.cell.k)), np.zeros((400, 1)))
    assert margins.leaf_margins(chart, points).min() >= proof.leaf_margin
    assert not rp.prove(design, margin=0, limit_margin=asked + 0.2)


def test_a_symmetric_joint_s_limits_are_narrower_by_the_sector_s_angle() -> None:
    for name, width in (("position", 1.0), ("one orientation", -np.inf)):
        sector = sectors.found(name).function.chart.cell
        assert sector.removed[0].joint == 0
        lower, upper = cell_bounds.limits_of(sector)
        narrower = [width, *np.zeros(6)]
        np.testing.assert_allclose(lower - sector.task.lower, narrower)
        np.testing.assert_allclose(sector.task.upper - upper, narrower)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "frame", "kind", "size"),
    [
        ("panda", "panda_hand_tcp", "axis", (0.03, 0.1)),
        ("kinova", "j2s6s200_end_effector", "position", (0.05,)),
        ("planar4r", "tool", "xy", (0.3,)),
    ],
)
def test_a_hundred_thousand_poses_of_other_tasks_violate_nothing(
    name: str, frame: str, kind: str, size: tuple[float, ...]
) -> None:
    task = rp.Robot.load(name).task(frame, kind)
    q = task.reference
    found = rp.nearest_inverse_function(
        rp.Pseudoinverse(task),
        rp.Cell(task, task.placement(q), *size),
        posture=q,
        degree=3,
        options=rp.FitOptions(samples=256, held_out=256),
    )
    proof = rp.prove(found)
    assert proof, proof.reason
    problem, chart = cell_bounds.CellProof(found.function.chart), found.function.chart
    rng, r = np.random.default_rng(1), task.r
    for _ in range(10):
        U = rng.uniform(-1, 1, (10_000, found.cell.k))
        U[::2] = np.sign(U[::2]) * np.abs(U[::2]) ** 0.1
        points = chart.solve(U, np.zeros((len(U), r)))
        assert points.found.all() and (problem.away(points) <= problem.near).all()
        s = np.linalg.svd(task.jacobians(points.Q), compute_uv=False)
        assert s[:, -1].min() >= proof.sigma_min
        assert margins.leaf_margins(chart, points).min() >= proof.leaf_margin
        assert task.limit_margin(points.Q).min() >= proof.limit_margin


@pytest.mark.slow
def test_a_smaller_neighbourhood_of_the_polynomial_gives_a_proof(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """55: with d* of 2 cm, F near the inner edge of xarm7's table is not proved unique on the
    smallest boxes. There, a smaller d* is used, and the proof names it."""
    task = rp.Robot.load("xarm7").task("link_eef", "pose")
    q = np.array([-0.42, -0.22, 0, 0.09, 0, 0.31, 0])
    cell = rp.Sector(task, task.placement(q), radius=0.03, height=0.09)
    options = rp.FitOptions(samples=64, held_out=64)
    found = rp.nearest_inverse_function(
        rp.Pseudoinverse(task), cell, posture=q, degree=1, options=options
    )
    proof = rp.prove(found)
    assert proof and "within (0.02, " in proof.what and "on some boxes within (0.0" in proof.what
    monkeypatch.setattr(cell_bounds, "_SLACKS", cell_bounds._SLACKS[:1])
    monkeypatch.setattr(cell_bounds, "_NEARER", np.zeros(0))
    assert "too small to halve" in rp.prove(found).reason


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "frame", "start"),
    [
        ("panda", "panda_hand_tcp", (0, -0.2345, 0, -2.415, 0, 2.18, 0.7853)),
        ("xarm7", "link_eef", (0, -0.3, 0, 1.2, 0, 1.5, 0)),
        ("baxter", "left_gripper", (0.2, -0.6, -0.6, 1.3, 0.4, 0.8, 0)),
    ],
)
def test_a_third_of_a_million_poses_of_a_proved_cell_violate_nothing(
    name: str, frame: str, start: tuple[float, ...]
) -> None:
    task = rp.Robot.load(name).task(frame, "pose")
    q = np.array(start, float)
    found = rp.nearest_inverse_function(
        rp.Pseudoinverse(task),
        rp.Cell(task, task.placement(q), 0.02, 0.06),
        posture=q,
        degree=3,
        options=rp.FitOptions(samples=256, held_out=256),
    )
    proof = rp.prove(found)
    assert proof, proof.reason
    problem = cell_bounds.CellProof(found.function.chart)
    rng, chart = np.random.default_rng(1), found.function.chart
    for _ in range(34):
        U = rng.uniform(-1, 1, (10_000, 6))
        U[::2] = np.sign(U[::2]) * np.abs(U[::2]) ** 0.1  # half of them near the boundary
        points = chart.solve(U, np.zeros((len(U), 1)))
        assert points.found.all() and (problem.away(points) <= problem.near).all()
        s = np.linalg.svd(task.jacobians(points.Q), compute_uv=False)
        assert s[:, -1].min() >= proof.sigma_min
        assert margins.leaf_margins(chart, points).min() >= proof.leaf_margin
        assert task.limit_margin(points.Q).min() >= proof.limit_margin


@pytest.mark.slow
def test_a_certificate_of_an_older_theorem_is_dropped_with_one_line(
    places: rp.CellDesign, tmp_path: Path
) -> None:
    """Up to theorem 4, another quantity was bounded, which is larger than the leaf margin."""
    proof = rp.prove(places, margin=0.3)
    assert proof and proof.theorem == 5
    older = replace(proof, theorem=4, seal="").sealed(proof.subject)
    with pytest.warns(UserWarning) as told:
        dropped = replace(places, proof=older)
    assert dropped.proof is None and len(told) == 1
    said = str(told[0].message)
    assert "theorem 4 bounds another quantity" in said and "prove again" in said
    assert "\n" not in said
    assert replace(places, proof=proof).proof is not None
