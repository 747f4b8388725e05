"""The gradients V of a cell's potentials along F: enclosed on boxes of poses, in C; compared with
finite differences, samples and ball arithmetic, and wrong terms are noticed."""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from arms import spatial_task
from cell_functions import cell_of, chart_of, middle, panda
from inside import cell_bounds, margins
from kernels import kernels
from mutants import CELL_V
from proofs import regular_start

import repctl_pin as rp
from repctl_pin.redundancy import leaf_margin, nullspace

MIDDLE = np.array([0.0, -0.2345, 0.0, -2.415, 0.0, 2.18, 0.7853])
"""A configuration of the panda in the middle of its cells."""


def turned(chart: Any, size: float, seed: int = 0) -> Any:
    """A chart whose normals turn along the cell, so that V is far from the null space."""
    C = chart.coefficients.copy()
    slopes = np.random.default_rng(seed).standard_normal((chart.cell.k, *C.shape[1:]))
    C[1 : 1 + chart.cell.k, :, 1:] += size * slopes[..., 1:]
    return replace(chart, coefficients=C)


def charts(folder: Path) -> dict[str, Any]:
    """Charts of every kind of cell, r = 1 and 2, with a prismatic joint too."""
    found = {
        "pose": chart_of(cell_of(rotation=0.2, half_width=0.05), MIDDLE),
        "one orientation": chart_of(cell_of(), MIDDLE),
        "axis": chart_of(cell_of("axis", 0.2, 0.05), MIDDLE),
        "position": chart_of(cell_of("position", 0.0, 0.05), MIDDLE, 2),
    }
    place = pin.SE3(middle().rotation, np.array([0.45, 0.1, 0.35]))
    whole = rp.Sector(panda(), place, radius=0.03, height=0.03, angle=0.1, half_angle=0.1, spin=0.1)
    q = rp.solve_ik(panda(), MIDDLE, place)
    found["sector"] = chart_of(whole, q)
    found["reduced sector"] = chart_of(whole.without(whole.symmetries), q)
    sides = [0.42, 0.01, 0.01], [0.48, -0.01, 0.0, 0.005]
    shape: dict[str, Any] = {"radius": sides, "height": 0.05, "angle": 0.1, "half_angle": 0.1}
    bent = rp.Sector(panda(), place, **shape, spin=0.1)
    q = rp.solve_ik(panda(), MIDDLE, bent.placement)
    found["bent sector"] = chart_of(bent, q)
    found["reduced bent sector"] = chart_of(bent.without(bent.symmetries), q)
    for kind, n, size in (("pose", 7, (0.02, 0.05)), ("yz", 5, (0.05,))):
        task = spatial_task(n, folder, kind=kind, seed=3)
        q = regular_start(task)
        cell = rp.Cell(task, task.placement(q), *size)
        found[f"prismatic, {kind}"] = chart_of(cell, q, 2, 64)
    return found


@pytest.fixture(scope="module")
def every(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    return charts(tmp_path_factory.mktemp("arms"))


@pytest.mark.slow
def test_v_is_the_gradient_of_the_potentials_and_its_margin_the_price(
    every: dict[str, Any],
) -> None:
    """By central differences of h, and by 1 / ‖I − G J‖₂ = 1 / max ‖G ẋ‖ / ‖J⁺ ẋ‖."""
    for chart in every.values():
        chart, task = turned(chart, 0.05), chart.cell.task
        at = chart.solve(chart.cell.sample(4), np.zeros((4, task.r)))
        V, h = margins.potential_gradients(chart, at), 1e-6
        potentials = rp.InverseFunction(chart).inverse.potentials
        for q, gradient, J, margin in zip(
            at.Q, V, at.J, margins.leaf_margins(chart, at), strict=True
        ):
            steps = q + h * np.concatenate([np.eye(task.n), -np.eye(task.n)])
            up, down = np.split(potentials.values(steps), 2)
            np.testing.assert_allclose((up - down) / (2 * h), gradient, atol=1e-7)
            G = np.linalg.inv(np.vstack([J, gradient.T]))[:, : task.m]
            across = np.linalg.norm(np.eye(task.n) - G @ J, 2)
            np.testing.assert_allclose(margin, 1 / across, rtol=1e-9)
            np.testing.assert_allclose(
                np.linalg.norm(G @ np.linalg.pinv(np.linalg.pinv(J)), 2), across, rtol=1e-8
            )
            N = nullspace(J)
            np.testing.assert_allclose(leaf_margin(N, gradient), margin, rtol=1e-9)


# ---- enclosures --------------------------------------------------------------------------------


def used(
    problem: cell_bounds.CellProof,
    Uc: np.ndarray,
    half: np.ndarray,
    trials: int = 12,
    start: np.ndarray | None = None,
) -> tuple[float, float]:
    """The largest ratio of what V differs from its expansion by to its bound; the share enclosed.

    The bounds of the leaf margin are checked, too.
    """
    chart, task = problem.chart, problem.task
    K, k = Uc.shape
    V = np.full((K, task.r, task.n, 2 + k), np.nan)
    start = problem.start(Uc, half) if start is None else start
    found = problem.bounds_from(Uc, half, start, V)
    good, worst = np.isfinite(V).all(axis=(1, 2, 3)), 0.0
    for trial in range(trials):
        t = np.random.default_rng(trial).uniform(-1, 1, Uc.shape)
        t = np.sign(t) if trial % 2 else t
        at = chart.solve(Uc + half * t, np.zeros((K, task.r)))
        true = np.swapaxes(margins.potential_gradients(chart, at), 1, 2)
        off = np.abs(true - V[..., 0] - np.einsum("Kaij,Kj->Kai", V[..., 1:-1], t))
        ratio = off / (V[..., -1] + 1e-10)
        worst = max(worst, float(ratio[good].max(initial=0.0)))
        margin = margins.leaf_margins(chart, at)
        assert (margin >= found.leaf_margin - 1e-9).all()
        inside = np.abs(at.Q - found.Q) <= found.reach + 1e-12
        assert inside[found.leaf_margin > 0].all()
    return worst, float(good.mean())


def boxes(k: int, width: float, count: int = 8, seed: int = 0) -> tuple[Any, Any]:
    rng = np.random.default_rng(seed)
    Uc = rng.uniform(width - 1, 1 - width, (count, k))
    return Uc, width * rng.uniform(0.3, 1, Uc.shape)


def enclosed(chart: Any, size: float) -> None:
    problem = cell_bounds.CellProof(turned(chart, size))
    for width in (0.1, 1e-3):
        ratio, share = used(problem, *boxes(chart.cell.k, width), trials=2)
        assert ratio <= 1
    assert share == 1


@pytest.mark.slow
def test_gradients_stay_in_their_enclosures(every: dict[str, Any]) -> None:
    for name, chart in every.items():
        enclosed(chart, 0.0 if name in ("sector", "bent sector") else 0.05)


@pytest.mark.slow
def test_gradients_of_two_charts_at_a_second_size_stay_in_their_enclosures(
    every: dict[str, Any],
) -> None:
    enclosed(every["pose"], 0.0)
    enclosed(every["sector"], 0.05)
    enclosed(every["bent sector"], 0.05)


def scenarios(every: dict[str, Any]) -> Any:
    """Problems, boxes and starts in which one term after the other is nearly all of the bound.

    On a thin box with the start at q_ref, V differs by what lies between q_ref and F: the slopes of
    the normals; J and the twists, seen from the first or the last link. On a longer one along a
    single coordinate, it differs by terms of second order.
    """
    for name in ("pose", "axis", "position", "sector", "bent sector", "prismatic, pose"):
        chart = every[name]
        k, n = chart.cell.k, chart.cell.task.n
        C = chart.coefficients.copy()
        C[0, :, 0] += 1e-3 * np.random.default_rng(1).standard_normal(n)
        for size in (0.0, 0.3):
            problem = cell_bounds.CellProof(turned(replace(chart, coefficients=C), size))
            whole = problem.chain
            for link in (None, 1, len(whole.p) - 1):
                if link is not None:
                    problem = copy(problem)
                    problem.see_from(whole.seen_from(link, 0.0))
                Uc = np.random.default_rng(2).uniform(-0.9, 0.9, (8, k))
                yield problem, Uc, np.full_like(Uc, 1e-6), np.zeros((8, n, 1 + k))
                for way in range(k if link is None else 0):
                    half = np.full_like(Uc, 1e-6)
                    half[:, way] = 0.03
                    yield problem, 0.9 * Uc, half, None


def most_used(every: dict[str, Any], library: Any = None) -> float:
    worst = 0.0
    for problem, Uc, half, start in scenarios(every):
        if library is not None:
            problem = copy(problem)
            problem.use(library)
        try:
            worst = max(worst, used(problem, Uc, half, 4, start)[0])
        except AssertionError:
            return np.inf
        if worst > 1:
            break
    return worst


@pytest.mark.slow
def test_the_enclosures_of_gradients_are_not_wasteful(every: dict[str, Any]) -> None:
    assert 0.8 < most_used(every) <= 1


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("mutant", CELL_V)
def test_a_wrong_term_of_the_gradients_is_noticed(mutant: str, every: dict[str, Any]) -> None:
    assert most_used(every, kernels(*CELL_V[mutant])) > 1
