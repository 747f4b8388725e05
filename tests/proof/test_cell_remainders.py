"""The bounds of a cell's proof against sampled values: each holds, is not far from the largest, and
one that is too small is caught."""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from arms import planar_task, sliding_task, spatial_task
from cell_functions import cell_of, chart_of, panda
from mutants import CELL_C, COMMUTATOR, compiled, wrong

import repctl_pin as rp
from repctl_pin.extensions.proof import cells, chain, commutator, screws

MIDDLE = np.array([0.0, -0.2345, 0.0, -2.415, 0.0, 2.18, 0.7853])
"""A configuration of the panda in the middle of the cell."""


@pytest.fixture(scope="module")
def chart() -> Any:
    return chart_of(cell_of(rotation=0.2, half_width=0.05), MIDDLE)


# ---- two solutions at one pose -----------------------------------------------------------------


def velocities(
    task: rp.Task, chain: chain.Chain, q: np.ndarray, other: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """ζ (N,), the motion from q to other that closes the chain, and J ζ (T, 6) at the nodes of a
    quadrature of it, from the middle link; the rotations of a position task cancel the frame's."""
    x, y = task.placement(q), task.placement(other)
    zeta = np.zeros(chain.N)
    zeta[: chain.n] = other - q
    if task.kind == "axis":
        zeta[-1] = -pin.log3(x.rotation.T @ y.rotation)[2]
    elif task.m == 2:
        axis = ({0, 1, 2} - set(task.rows.tolist())).pop()
        zeta[chain.n] = (x.translation - y.translation)[axis]
    nodes, _ = np.polynomial.legendre.leggauss(12)
    Q = q + (nodes[:, None] + 1) / 2 * (other - q)
    xi, tip = screws.screws(chain, Q @ chain.S[:, : chain.n].T + chain.o)
    V = np.einsum("Klx,lc,c->Kx", xi, chain.S, zeta)
    if chain.loose.any():
        V[:, :3] += np.cross(V[:, 3:], tip)
        V[:, 3:] = 0
    return zeta, V


def apart(
    task: rp.Task, chain: chain.Chain, seed: int, law: ModuleType = commutator
) -> np.ndarray:
    """Compare pairs of configurations at one pose with Λ: the largest shares of the integral's two
    rows, and of the largest velocity's linear one."""
    rng, n, done = np.random.default_rng(seed), task.n, 0
    Q = task.reference + rng.uniform(-0.5, 0.5, (24, n))
    used, weights = np.zeros(3), np.polynomial.legendre.leggauss(12)[1] / 2
    for q in Q:
        x, N = task.placement(q), np.linalg.svd(task.jacobian(q))[2][task.m :]
        way = N.T @ rng.standard_normal(task.r)
        other = q + way * rng.uniform(0.02, 0.25) / np.linalg.norm(way)
        for _ in range(8):
            other = other + np.linalg.pinv(task.jacobian(other)) @ task.error(other, x)
        if np.abs(task.error(other, x)).max() > 1e-12 or np.abs(other - q).sum() > 0.8:
            continue
        steps = np.abs(other - q) + 1e-12
        zeta, V = velocities(task, chain, q, other)
        if task.kind == "axis":
            step = law.closed(chain, steps[None] @ np.abs(chain.S[:, :n]).T)[0]
            used[2] = max(used[2], abs(zeta[-1]) / (step[-1] + 1e-12))
        (mean, most) = law.commutator(chain, steps[None], np.abs(q) + 1)[0]
        if mean.max() > 1e20:
            continue
        mean, most, done = mean @ np.abs(zeta), most @ np.abs(zeta), done + 1
        both = np.linalg.norm((weights @ V).reshape(2, 3), axis=1)
        used[:2] = np.maximum(used[:2], both / (mean + 1e-13))
        if chain.loose.any():
            V_max = np.linalg.norm(V[:, :3], axis=1).max()
            used[2] = max(used[2], V_max / most[0])
    assert done > 3
    return used


def test_two_solutions_at_one_pose_are_apart_as_bounded(tmp_path: Path) -> None:
    for task in (panda(), spatial_task(7, tmp_path, kind="pose", seed=3)):
        for middle in (2, 4, 5):
            used = apart(task, chain.chain_of(task).seen_from(middle, 0.5), middle)
            assert (used <= 1).all() and (used[:2] > 0).all()
    used = apart(panda(), chain.chain_of(panda()).seen_from(4, 0.5), 4)
    assert used.max() > 0.02  # third order: signs cancel, what is left is small


KINDS = ("axis", "position", "yz")


@pytest.mark.parametrize("kind", KINDS)
def test_two_solutions_of_other_tasks_are_apart_as_bounded(
    kind: str, tmp_path: Path
) -> None:
    used = np.zeros(3)
    for task in (panda(kind), spatial_task(7, tmp_path, kind=kind, seed=3)):
        links = chain.chain_of(task)
        for middle in (3, len(links.p) - 1):
            found = apart(task, links.seen_from(middle, 0.5), middle)
            used = np.maximum(used, found)
    assert (used <= 1).all()
    assert used[0] > 0.003 and used[2] > 0.1


def velocity_changes_off(task: rp.Task, law: ModuleType = commutator) -> float:
    """The largest share of the bounds that the frame's velocity changes by, joint by joint: small
    steps of any sign."""
    whole, rng, worst = chain.chain_of(task), np.random.default_rng(0), 0.0
    moves = whole.S[:, : task.n].any(axis=1)
    S = np.where(moves[:, None], np.eye(len(whole.p)), 0.0)
    for trial in range(120):
        links = whole.seen_from(1 + trial % (len(whole.p) - 1), 0.5)
        theta = rng.uniform(-1, 1, (2, len(S))) * [[0.3 if trial % 2 else 1.5], [0.02]]
        theta[1] *= moves & (rng.uniform(size=len(S)) < 0.4)
        ways = [
            (xi, tip)
            for xi, tip in (
                screws.screws(links, x[None]) for x in (theta[0], theta.sum(0))
            )
        ]
        c = [(xi[0, :, :3] + np.cross(xi[0, :, 3:], tip[0]))[moves] for xi, tip in ways]
        slide = np.where(links.revolute, 0.0, np.abs(theta).sum(axis=0))
        K = law.velocity_changes(links, np.abs(theta[1:]), slide)[0, moves]
        worst = max(
            worst, float((np.linalg.norm(c[1] - c[0], axis=1) / (K + 1e-12)).max())
        )
    return worst


def test_the_frame_s_velocity_changes_as_bounded(tmp_path: Path) -> None:
    assert 0.9 < velocity_changes_off(planar_task((1.0, 0.9, 0.8), tmp_path)) <= 1
    assert 0.9 < velocity_changes_off(sliding_task(tmp_path)) <= 1
    assert 0.5 < velocity_changes_off(spatial_task(5, tmp_path)) <= 1


@pytest.mark.parametrize(
    "mutant",
    [
        pytest.param(m, marks=[pytest.mark.slow] if i > 1 else [])
        for i, m in enumerate(COMMUTATOR)
    ],
)
def test_a_wrong_bound_of_two_solutions_is_noticed(
    mutant: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    law = wrong(monkeypatch, "commutator.py", *COMMUTATOR[mutant])
    arms = planar_task((1.0, 0.9, 0.8), tmp_path), sliding_task(tmp_path)
    found = [velocity_changes_off(arm, law) for arm in arms]
    for kind in ("axis", "position") if max(found) <= 1 else ():
        found += [
            apart(panda(kind), chain.chain_of(panda(kind)).seen_from(3, 0.5), 3, law)
        ]
    assert np.max(np.hstack(found)) > 1


# ---- C -----------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_wrong_term_in_c_changes_the_bounds(tmp_path: Path) -> None:
    right = cells.CellProof(
        chart_of(cell_of(rotation=0.2, half_width=0.05), MIDDLE, 4, 256)
    )
    right.see_from(right.chain.seen_from(4, 0.0))  # joints move it, not only turn it
    rng = np.random.default_rng(4)
    U = rng.uniform(-0.9, 0.9, (96, 6))
    h = np.array([0.4, 0.2, 0.05])[np.arange(96) % 3, None] * rng.uniform(
        0.3, 1, U.shape
    )
    bounds = right.bounds(U, h)
    for name, (file, piece, instead) in CELL_C.items():
        problem = copy(right)
        problem.use(compiled(tmp_path, file, piece, instead))
        changed = problem.bounds(U, h)
        same = np.allclose(bounds.reach, changed.reach, 1e-5, 1e-7, equal_nan=True)
        same &= np.allclose(bounds.leaf_margin, changed.leaf_margin, rtol=1e-5)
        assert not same, name


def test_without_the_native_library_a_proof_over_a_cell_says_so(
    chart: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("REPCTL_NATIVE", "no")
    with pytest.raises(
        rp.InputError, match=r"requires the native library.*; unset REPCTL"
    ):
        cells.CellProof(chart)


def test_nothing_is_proved_with_a_wrong_distance_from_the_chart(chart: Any) -> None:
    """d* below the distance of F, or so large that F may not be the only solution within it."""
    Uc, half = np.zeros((2, 6)), np.full((2, 6), 0.01)
    C = chart.coefficients.copy()
    C[0, :, 0] += 1e-3
    problem = cells.CellProof(replace(chart, coefficients=C))
    assert (problem.bounds(Uc, half).leaf_margin > 0).all()
    for near in (1e-9, 0.3):
        problem.near = np.full(7, near)
        problem.see_from(problem.chain)
        assert (problem.bounds(Uc, half).leaf_margin == 0).all()
