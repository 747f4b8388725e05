"""Sectors whose range of radius depends on the height: the pose and its derivatives are enclosed on
boxes of coordinates, wrong terms are noticed, and a certificate holds for one profile only."""

from __future__ import annotations

import ctypes
import json
from dataclasses import replace
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from design_file import checksum
from inside import cell_bounds
from kernels import at, kernels
from mutants import BENT
from sectors import found, sector_of

import repctl_pin as rp
from repctl_pin.redundancy import leaf_margin

SIDES: dict[str, dict[str, Any]] = {
    "a radius by height": {},
    "an axis task by height": {},
    "position": {"radius": ([0.3, 0.0, 0.1, -0.02, 0.03], [0.6, 0.05, -0.05]), "height": 0.2},
    "another axis": {
        "radius": ([0.3, 0, 0, 0, 0, 0, 0, 0, -0.1], [0.5, 0, 0.05, 0, 0, 0, 0.1]),
        "height": 0.2,
    },
}
"""Sectors with bent sides, of degree 2 to 8, of each kind of task and around two axes."""


def bent(name: str, *, reduced: bool) -> rp.Sector:
    sector = sector_of(name, **SIDES[name])
    assert sector.profile.degree > 1
    return sector.without(sector.symmetries) if reduced else sector


CELLS = [
    pytest.param(name, reduced, marks=[] if reduced == (i % 2 == 1) else pytest.mark.slow)
    for i, name in enumerate(SIDES)
    for reduced in (False, True)
]


def problem_of(cell: rp.Sector) -> cell_bounds.CellProof:
    """The problem of a chart that is constant: only the poses of its cell matter here."""
    U, n, r = cell.sample(32), cell.task.n, cell.task.r
    Q, N = np.zeros((32, n)), np.tile(np.eye(n, r), (32, 1, 1))
    return cell_bounds.CellProof(cell_bounds.Chart.fitted(cell, U, Q, N, 1))


def models(problem: cell_bounds.CellProof, u: np.ndarray, h: np.ndarray, library: ctypes.CDLL):
    """Models of p, of the columns of R and of the m twists on a box u ± h: (12 + 6 m, M + 1)."""
    out = np.zeros((12 + 6 * problem.task.m, problem._space.M + 1))
    library.poses(ctypes.byref(problem._cell), at(u), at(h), at(out))
    return out


def poses(cell: rp.Sector, U: np.ndarray) -> np.ndarray:
    """The same quantities at points U (K, k), in NumPy, from the formulas of the sector."""
    Y = cell._offset + cell.spread(U)
    p, R = cell._placed(Y)
    others = np.setdiff1d(np.arange(cell.task.m), [*cell.moved, *cell._removed])
    T = cell._frame_twists(Y)[:, :, [*cell.moved, *cell._removed, *others]]
    parts = p, np.swapaxes(R, 1, 2).reshape(-1, 9), np.swapaxes(T, 1, 2).reshape(len(U), -1)
    return np.concatenate(parts, axis=1)


def boxes(k: int, count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Boxes of three sizes in the cell; a third of their sides lie at its edges."""
    rng = np.random.default_rng(seed)
    half = np.array([0.5, 0.1, 1e-3])[np.arange(count) % 3, None] * rng.uniform(0.2, 1, (count, k))
    Uc = rng.uniform(half - 1, 1 - half)
    edge = rng.uniform(size=Uc.shape) < 1 / 3
    return np.where(edge, np.sign(Uc) * (1 - half), Uc), half


def used(cell: rp.Sector, library: ctypes.CDLL, count: int = 12, points: int = 128) -> float:
    """The largest share of a bound by which a true value differs from the model's polynomial.

    Half of the points of a box lie on its sides. The bound is widened by NumPy's own rounding.
    """
    problem, rng, worst = problem_of(cell), np.random.default_rng(1), 0.0
    exponents = cell_bounds.Monomials(cell.k, cell_bounds.ORDER).exponents
    for u, h in zip(*boxes(cell.k, count), strict=True):
        t = rng.uniform(-1, 1, (points, cell.k))
        side = rng.uniform(size=t.shape) < 0.5
        t[::2] = np.where(side, np.sign(t), t)[::2]
        found = models(problem, u, h, library)
        values = (t[:, None] ** exponents).prod(axis=2) @ found[:, :-1].T
        off = np.abs(poses(cell, u + h * t) - values)
        worst = max(worst, float((off / (found[:, -1] + 4e-15)).max()))
    return worst


@pytest.mark.parametrize(("name", "reduced"), CELLS)
def test_poses_and_their_derivatives_stay_in_their_enclosures(name: str, reduced: bool) -> None:
    """Law: 12,288 points in boxes of eight sectors."""
    assert used(bent(name, reduced=reduced), kernels()) <= 1


@pytest.mark.slow
def test_the_enclosures_of_poses_are_not_wasteful() -> None:
    """In a reduced sector, all that is left out is a product of degree 4 or more of y and η."""
    assert max(used(bent(name, reduced=True), kernels()) for name in SIDES) > 0.5


@pytest.mark.slow
@pytest.mark.parametrize("mutant", BENT)
def test_a_wrong_enclosure_of_a_pose_is_noticed(mutant: str) -> None:
    library = kernels(*BENT[mutant])
    assert (
        max(
            used(bent(name, reduced=reduced), library)
            for name, reduced in (case.values for case in CELLS)
        )
        > 1
    )


def test_the_distances_from_the_chart_are_nested() -> None:
    """F in the smaller of two is in the larger one: two boxes that meet have the same F."""
    problem = cell_bounds.CellProof(found("one orientation by height").function.chart)
    assert (np.diff(problem.distances, axis=0) < 0).all() and (problem.distances > 0).all()
    Uc = np.zeros((1, problem.cell.k))
    bounds = problem.bounds(Uc, Uc + 1e-3)
    assert bounds.level[0] == 0 and bounds.leaf_margin[0] > 0
    problem.distances = np.array([[3.0] * problem.task.n, problem.distances[0].tolist()])
    problem.see_from(problem.chain)
    again = problem.bounds(Uc, Uc + 1e-3)
    assert again.level[0] == 1 and again.leaf_margin[0] > 0
    problem.distances = problem.distances[:1]
    problem.see_from(problem.chain)
    none = problem.bounds(Uc, Uc + 1e-3)
    assert none.level[0] == -1 and none.leaf_margin[0] == 0


def test_a_certificate_holds_for_one_profile_only(tmp_path: Path) -> None:
    """A changed coefficient of the profile in cell.json drops the certificate with one line."""
    design = found("one orientation by height")
    proof = rp.prove(design, margin=0.1, limit_margin=-1.0)
    assert proof, proof.reason
    file = rp.save(replace(design, proof=proof), tmp_path / "cell.json")
    again = rp.load(file)
    assert repr(again.proof) == repr(proof) and again.subject == design.subject
    text = json.loads(file.read_text("utf-8"))
    profile = next(part["profile"] for part in walk(text) if "profile" in part)
    for row in (0, 1):
        profile[row][1] += 1e-9
        text["checksum"] = checksum(text)
        file.write_text(json.dumps(text), encoding="utf-8")
        with pytest.warns(UserWarning, match="certificate") as told:
            dropped = rp.load(file)
        assert dropped.proof is None and len(told) == 1 and "\n" not in str(told[0].message)
        profile[row][1] -= 1e-9


def walk(part: Any) -> Any:
    """Yield all objects in a JSON text."""
    if isinstance(part, dict):
        yield part
    for each in part.values() if isinstance(part, dict) else part if isinstance(part, list) else ():
        yield from walk(each)


@pytest.mark.slow
@pytest.mark.parametrize(("degree", "limit", "leaf"), [(4, 0.065, 0.29), (8, 0.065, 0.23)])
def test_ten_thousand_poses_of_a_proved_sector_with_bent_sides_violate_nothing(
    degree: int, limit: float, leaf: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Oracle: the forward kinematics, the limits, and Newton's method from elsewhere within d*.

    40 % of the poses lie at edges. With one d* for all of xarm7's table, F was not proved unique at
    the inner edge.
    The table with sides of degree 4 at nodes of 3 cm is smaller than that found by default.
    """
    if degree == 4:
        best_cell = import_module(rp.best_cell.__module__)
        whole_table = import_module(best_cell.WholeTable.__module__)
        largest_profile = import_module(whole_table.area_of.__module__)
        smooth = partial(whole_table.shaped_places, smooth=True)
        monkeypatch.setattr(whole_table, "shaped_places", lambda *given, **_: smooth(*given))
        monkeypatch.setattr(largest_profile, "SPARE", 0.85)
    task = rp.Robot.load("xarm7").task(None, "pose")
    place = rp.best_cell(task, orientation="down")
    assert place.table is not None
    found, F = place.table.design, place.table.design.function
    proof = rp.prove(found)
    assert F.cell.profile.degree == degree and proof, proof.reason
    rng = np.random.default_rng(7)
    U = rng.uniform(-1, 1, (10_000, F.cell.k))
    at_edge = rng.integers(0, 2, 4000)  # radius or height
    U[np.arange(4000), 2 * at_edge] = rng.choice([-1.0, 1.0], 4000)
    Q = F.batch(U)
    # the poses, the limits and the margins
    for q, x, R in zip(Q, *F.cell.placements(U), strict=True):
        at = task.placement(q)
        assert np.abs(at.translation - x).max() < 1e-9 and np.abs(at.rotation - R).max() < 1e-9
    low, high = F.cell.radii(F.cell.placements(U)[0][:, 2]).T
    radius = np.hypot(*F.cell.placements(U)[0][:, :2].T)
    assert (radius > low - 1e-9).all() and (radius < high + 1e-9).all()
    J = task.jacobians(Q)
    assert np.linalg.svd(J, compute_uv=False)[:, -1].min() >= proof.sigma_min
    turning = [one.joint for one in F.chart.cell.removed]
    others = np.delete(F.cell.limit_margin(Q), turning, axis=1)
    assert others.min() >= proof.limit_margin > limit
    N = np.linalg.svd(J)[2][:, task.m :].swapaxes(1, 2)
    V = found.inverse.potentials.gradients(Q)
    assert leaf_margin(N, V).min() >= proof.leaf_margin > leaf
    # no other solution within d*, which is the box's own; smaller ones are needed only without Δ,
    # where some boxes of the larger sector have none
    for intervals, smaller in (({2: 32}, False), ({}, True))[: 2 if degree == 4 else 1]:
        monkeypatch.setattr(cell_bounds, "_INTERVALS", intervals)
        require_only_solutions(F.chart, U[:, [0, 2]], rng, smaller=smaller)


def require_only_solutions(
    chart: cell_bounds.Chart, u: np.ndarray, rng: np.random.Generator, *, smaller: bool
) -> None:
    """Search for other solutions within the d* of a box at each of 10,000 poses.

    ``smaller``: whether some boxes must need a smaller d* than the largest."""
    task, problem = chart.cell.task, cell_bounds.CellProof(chart)
    level = problem.bounds(u, np.full_like(u, 1e-7)).level
    assert (level >= 0).all() and level.max() < len(problem.distances)
    assert not smaller or level.max() > 0
    mine = chart.solve(u)
    near = problem.distances[level]
    assert (problem.away(mine) <= near).all()
    c, (q_ref, n_ref), closed = problem.center(mine), chart.reference(u), 0
    for i in range(0, 10_000, 5):
        q, x = c[i] + near[i] * rng.choice([-1.0, 1.0], task.n), chart.cell.at(u[i])
        for _ in range(12):
            J_V = np.concatenate([task.jacobian(q), n_ref[i].T])
            away = np.concatenate([task.error(q, x), -n_ref[i].T @ (q - q_ref[i])])
            q = q + np.linalg.solve(J_V, away)
        inside = (np.abs(q - c[i]) <= near[i]).all() and np.abs(task.error(q, x)).max() < 1e-9
        closed += inside
        assert not inside or np.abs(q - mine.Q[i]).max() < 1e-7
    assert closed > 1000
