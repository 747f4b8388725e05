"""The constants of a cell's proof against sampled remainders: each bound holds, is not far from the
largest, and one that is too small is caught."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from arms import spatial_task
from cell_functions import cell_of, chart_of, panda

import repctl_pin as rp
from repctl_pin.inverse_function.chart import Chart
from repctl_pin.proof import cells
from repctl_pin.proof.cells import CellProof
from repctl_pin.proof.chain import Chain, chain_of
from repctl_pin.proof.commutator import commutator
from repctl_pin.proof.screws import screws

MIDDLE = np.array([0.0, -0.2345, 0.0, -2.415, 0.0, 2.18, 0.7853])
"""A configuration of the panda in the middle of the cell."""


@pytest.fixture(scope="module")
def chart() -> Chart:
    return chart_of(cell_of(rotation=0.2, half_width=0.05), MIDDLE)


def twists_used(problem: CellProof, seed: int, count: int = 60) -> float:
    """Compare what E has beside its value and its slopes with the bound: the largest share."""
    rng, chain, k = np.random.default_rng(seed), problem.chain, problem.cell.k
    n, used = chain.n, 0.0
    U = rng.uniform(-0.8, 0.8, (count, k))
    h = 10.0 ** rng.uniform(-1.5, -0.7, (count, 1)) * rng.uniform(0.2, 1, (count, k))
    points = problem.chart.solve(U, np.zeros((count, 1)))
    dF, _ = problem.chart.derivative(points, np.zeros((count, 1, k)))
    loose = 10.0 ** rng.uniform(-4, -1.5, (count, n))
    wide = np.einsum("Kna,Ka->Kn", np.abs(dF), h) + loose
    S, Q = chain.S[:, :n], points.Q
    theta = Q @ S.T + chain.o
    xi, tip = screws(chain, theta)
    E, E_q, E_u, turns = problem._twists(U, Q, xi, tip)
    linear, angular = problem._twists_rest(
        theta, (wide, loose), h, np.einsum("lj,Kja->Kla", S, dF), xi, tip, turns
    )
    for trial in range(40):
        way = np.sign(rng.standard_normal(U.shape)) if trial % 2 else rng.uniform(-1, 1, U.shape)
        off = (
            np.sign(rng.standard_normal(Q.shape)) if trial % 4 < 2 else rng.uniform(-1, 1, Q.shape)
        )
        du = h * way
        dq = np.einsum("Kna,Ka->Kn", dF, du) + loose * off
        there = (Q + dq) @ S.T + chain.o
        other = problem._twists(U + du, Q + dq, *screws(chain, there))[0]
        rest = other - E - np.einsum("Kjxa,Kj->Kxa", E_q, dq) - np.einsum("Kbxa,Kb->Kxa", E_u, du)
        size = np.linalg.norm(rest.reshape(count, 2, 3, k), axis=2)  # (K, 2, k)
        used = max(used, float((size / np.stack([linear, angular], axis=1).clip(1e-15)).max()))
    return used


def test_the_twists_remainder_is_bounded_and_the_bound_is_not_wasteful(chart: Chart) -> None:
    assert 0.3 < twists_used(CellProof(chart, compiled=False), 0) <= 1


def test_a_wrong_sign_or_a_missing_slope_shows_in_the_remainder(
    chart: Chart, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = CellProof(chart, compiled=False)
    right = CellProof._twists
    for change in (
        lambda E, E_q, E_u, turns: (E, -E_q, E_u, turns),
        lambda E, E_q, E_u, turns: (E, E_q, 0 * E_u, turns),
        lambda E, E_q, E_u, turns: (E, E_q * (np.arange(7) != 3)[:, None, None], E_u, turns),
    ):
        monkeypatch.setattr(
            CellProof, "_twists", lambda self, *a, change=change: change(*right(self, *a))
        )
        assert twists_used(problem, 1) > 1


def separated(chain: Chain, Q: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Integrate J δ along the straight way from Q to other, (K, 2): its linear and angular size."""
    nodes, weights = np.polynomial.legendre.leggauss(12)
    delta, found = other - Q, 0.0
    for t, weight in zip((nodes + 1) / 2, weights / 2, strict=True):
        xi, _ = screws(chain, (Q + t * delta) @ chain.S.T + chain.o)
        found = found + weight * np.einsum("Klx,lc,Kc->Kx", xi, chain.S, delta)
    return np.linalg.norm(np.asarray(found).reshape(-1, 2, 3), axis=2)


def apart(task: rp.Task, chain: Chain, seed: int, factor: float = 1.0) -> tuple[float, float]:
    """Compare pairs of configurations at one pose with Λ: the largest share of both rows."""
    rng, n = np.random.default_rng(seed), task.n
    Q = task.reference + rng.uniform(-0.5, 0.5, (12, n))
    used = np.zeros(2)
    for q in Q:
        x, N = task.placement(q), np.linalg.svd(task.jacobian(q))[2][-1]
        other = q + N * rng.uniform(0.02, 0.25)
        for _ in range(8):
            other = other + np.linalg.pinv(task.jacobian(other)) @ task.error(other, x)
        if np.abs(task.error(other, x)).max() > 1e-12 or np.abs(other - q).sum() > 0.8:
            continue
        half = np.abs(other - q) / 2 + 1e-12
        bound = commutator(chain, half, np.abs(q) + 1) @ np.abs(other - q)
        used = np.maximum(used, separated(chain, q[None], other[None])[0] / (factor * bound))
    return float(used[0]), float(used[1])


def test_two_solutions_at_one_pose_are_apart_as_bounded(tmp_path: Path) -> None:
    task = panda()
    for task in (panda(), spatial_task(7, tmp_path, kind="pose", seed=3)):
        for middle in (2, 4, 5):
            linear, angular = apart(task, chain_of(task).seen_from(middle, 0.5), middle)
            assert 0 < linear <= 1 and 0 < angular <= 1
    linear, angular = apart(panda(), chain_of(panda()).seen_from(4, 0.5), 4)
    assert max(linear, angular) > 0.02  # third order: signs cancel, what is left is small


def test_both_kernels_give_the_same_enclosures(chart: Chart) -> None:
    plain, compiled = CellProof(chart, compiled=False), CellProof(chart)
    rng, k = np.random.default_rng(3), 6
    U = rng.uniform(-0.9, 0.9, (48, k))
    h = np.array([0.3, 0.1, 0.05])[np.arange(48) % 3, None] * rng.uniform(0.3, 1, U.shape)
    (one, Q, reach), (two, Q_c, reach_c) = plain.enclosed(U, h), compiled.enclosed(U, h)
    good = one.leaf.leaf_margin > 0
    assert 0.3 < good.mean() < 1 and (good == (two.leaf.leaf_margin > 0)).all()
    np.testing.assert_allclose(Q_c, Q, atol=1e-8)
    np.testing.assert_allclose(reach_c[good], reach[good], rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(two.leaf.center, one.leaf.center, rtol=1e-6)
    # C bounds the leaf margin and σ_min to first order, NumPy to second
    for name in ("leaf_margin", "sigma_min"):
        first, second = getattr(two.leaf, name)[good], getattr(one.leaf, name)[good]
        assert (first <= second * (1 + 1e-6)).all() and (first > 0.95 * second).all()
    np.testing.assert_allclose(two.limit_margin[good], one.limit_margin[good], atol=1e-8)
    np.testing.assert_allclose(two.center_limit, one.center_limit, atol=1e-8)
    assert (one.found == two.found).all()


def test_a_cell_is_proved_without_a_compiler_too(
    chart: Chart, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cells, "library", lambda: None)
    problem = CellProof(chart)
    assert problem._kernel is None
    assert problem.bounds(np.zeros((1, 6)), np.full((1, 6), 0.01)).leaf.leaf_margin[0] > 0.9
