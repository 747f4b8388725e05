"""The bounds of a cell's proof against sampled values: each holds, is not far from the largest, and
one that is too small is caught."""

from __future__ import annotations

import ctypes
from copy import copy
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from arms import planar_task, sliding_task, spatial_task
from cell_functions import cell_of, chart_of, panda
from controls import some
from inside import cell_bounds, chain
from kernels import at, kernels, screws
from mutants import CELL_C, COMMUTATOR
from proofs import regular_start

import repctl_pin as rp

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
    V = []
    for theta in Q @ chain.S[:, : chain.n].T + chain.o:
        xi, tip = screws(kernels(), chain, theta)
        v = zeta @ chain.S.T @ xi
        if loose(chain).any():
            v = np.concatenate([v[:3] + np.cross(v[3:], tip), np.zeros(3)])
        V.append(v)
    return zeta, np.array(V)


def loose(chain: chain.Chain) -> np.ndarray:
    """Whether each column of S is a rotation that a position task leaves free: (N,)."""
    return np.asarray(chain.S[chain.level].any(axis=0))


def bounds_of_two(
    problem: cell_bounds.CellProof, steps: np.ndarray, library: ctypes.CDLL
) -> tuple[np.ndarray, np.ndarray]:
    """Λ (2, N), its linear and angular row, of ``|∫ J ζ dt| ≤ Λ |ζ|`` with |δ| ≤ steps (n,); and
    the same for the largest ``|J ζ|``, which rows of free rotations get. NaN without a bound."""
    chain, found = problem.chain, []
    for norms in ((1.0, 0.0), (0.0, 1.0)):
        D, both = np.zeros((chain.N, chain.N)), np.tile(norms, chain.N)
        cell = ctypes.byref(problem._cell)
        done = library.two_solutions(cell, at(both), at(np.array(steps)), at(D))
        found.append(D if done else np.full_like(D, np.nan))
    free = int(np.argmax(loose(chain))) if loose(chain).any() else 0
    linear, angular = found
    first = int(np.argmin(loose(chain)))
    mean = np.array([linear[first], angular[first]])
    return mean, np.array([linear[free], angular[free]])


def problem_of(task: rp.Task) -> cell_bounds.CellProof:
    """A small cell around the task's reference, of which only the chain matters here."""
    q = regular_start(task)
    turns = (1e-3,) if task.kind in ("pose", "axis") else ()
    cell = rp.Cell(task, task.placement(q), 1e-3, *turns)
    problem = cell_bounds.CellProof(chart_of(cell, q, 1, 64))
    problem.farthest = np.full(task.n, 2.0)
    return problem


def apart(
    problem: cell_bounds.CellProof, middle: int, seed: int, library: ctypes.CDLL | None = None
) -> np.ndarray:
    """Compare pairs of configurations at one pose with Λ: the largest shares of the integral's two
    rows, and of the largest velocity's linear one."""
    problem = copy(problem)
    problem.see_from(problem.chain.seen_from(middle, 0.5))
    library, task, chain = library or kernels(), problem.task, problem.chain
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
        zeta, V = velocities(task, chain, q, other)
        mean, most = bounds_of_two(problem, np.abs(other - q) + 1e-12, library)
        if not np.isfinite(mean).all():
            continue
        mean, most, done = mean @ np.abs(zeta), most @ np.abs(zeta), done + 1
        both = np.linalg.norm((weights @ V).reshape(2, 3), axis=1)
        used[:2] = np.maximum(used[:2], both / (mean + 1e-13))
        if loose(chain).any():
            V_max = np.linalg.norm(V[:, :3], axis=1).max()
            used[2] = max(used[2], V_max / most[0])
    assert done > 3
    return used


@pytest.mark.slow
def test_two_solutions_at_one_pose_are_apart_as_bounded(tmp_path: Path) -> None:
    for task in (panda(), spatial_task(7, tmp_path, kind="pose", seed=3)):
        problem = problem_of(task)
        for middle in (2, 4, 5):
            used = apart(problem, middle, middle)
            assert (used <= 1).all() and (used[:2] > 0).all()
    assert apart(problem_of(panda()), 4, 4).max() > 0.02  # third order: signs cancel


KINDS = ("axis", "position", "yz")


@pytest.mark.slow
@pytest.mark.parametrize("kind", some(KINDS, "position"))
def test_two_solutions_of_other_tasks_are_apart_as_bounded(kind: str, tmp_path: Path) -> None:
    used = np.zeros(3)
    for task in (panda(kind), spatial_task(7, tmp_path, kind=kind, seed=3)):
        problem = problem_of(task)
        for middle in (3, len(problem.chain.p) - 1):
            used = np.maximum(used, apart(problem, middle, middle))
    assert (used <= 1).all() and used[0] > 0.003
    assert kind == "axis" or used[2] > 0.1


def velocity_changes_off(
    problem: cell_bounds.CellProof, library: ctypes.CDLL | None = None
) -> float:
    """The largest share of the bounds that the frame's velocity changes by, joint by joint: small
    steps of any sign."""
    library, whole, worst = library or kernels(), problem.chain, 0.0
    rng, n, problem = np.random.default_rng(0), problem.task.n, copy(problem)
    for trial in range(60):
        links = whole.seen_from(1 + trial % (len(whole.p) - 1), 0.5)
        q = rng.uniform(-1, 1, n) * (0.3 if trial % 2 else 1.5)
        step = rng.uniform(-1, 1, n) * 0.02 * (rng.uniform(size=n) < 0.4)
        problem.farthest = np.abs(q) + np.abs(step)
        problem.see_from(links)
        c = []
        for at_q in (q, q + step):
            xi, tip = screws(library, links, links.S[:, :n] @ at_q + links.o)
            ways = xi[:, :3] + np.cross(xi[:, 3:], tip)
            c.append((links.S.T @ ways)[:n])
        mean, most = bounds_of_two(problem, np.abs(step), library)
        K = (most - mean)[0, :n]
        change = np.linalg.norm(c[1] - c[0], axis=1)
        worst = max(worst, float((change / (K + 1e-12)).max()))
    return worst


@pytest.mark.slow
def test_the_frame_s_velocity_changes_as_bounded(tmp_path: Path) -> None:
    arms = planar_task((1.0, 0.9, 0.8), tmp_path), sliding_task(tmp_path)
    for arm in arms:
        assert 0.9 < velocity_changes_off(problem_of(arm)) <= 1
    assert 0.5 < velocity_changes_off(problem_of(spatial_task(5, tmp_path))) <= 1


@pytest.mark.slow
@pytest.mark.parametrize(
    "mutant",
    [pytest.param(m, marks=[pytest.mark.slow] if i else []) for i, m in enumerate(COMMUTATOR)],
)
def test_a_wrong_bound_of_two_solutions_is_noticed(mutant: str, tmp_path: Path) -> None:
    library = kernels("cell_bounds.c", *COMMUTATOR[mutant])
    arms = planar_task((1.0, 0.9, 0.8), tmp_path), sliding_task(tmp_path)
    found = [velocity_changes_off(problem_of(arm), library) for arm in arms]
    if max(found) <= 1:
        found += list(apart(problem_of(panda("axis")), 3, 3, library))
    assert max(found) > 1


# ---- C -----------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_wrong_term_in_c_changes_the_bounds() -> None:
    right = cell_bounds.CellProof(chart_of(cell_of(rotation=0.2, half_width=0.05), MIDDLE, 4, 256))
    right.see_from(right.chain.seen_from(4, 0.0))  # joints move it, not only turn it
    rng = np.random.default_rng(4)
    U = rng.uniform(-0.9, 0.9, (96, 6))
    h = np.array([0.4, 0.2, 0.05])[np.arange(96) % 3, None] * rng.uniform(0.3, 1, U.shape)
    bounds = right.bounds(U, h)
    for name, (file, piece, instead) in CELL_C.items():
        problem = copy(right)
        problem.use(kernels(file, piece, instead))
        changed = problem.bounds(U, h)
        same = np.allclose(bounds.reach, changed.reach, 1e-5, 1e-7, equal_nan=True)
        same &= np.allclose(bounds.leaf_margin, changed.leaf_margin, rtol=1e-5)
        assert not same, name


def test_without_the_native_library_a_proof_over_a_cell_says_so(
    chart: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("REPCTL_NATIVE", "no")
    with pytest.raises(rp.InputError, match=r"requires the native library.*; unset REPCTL"):
        cell_bounds.CellProof(chart)


def test_nothing_is_proved_with_a_wrong_distance_from_the_chart(chart: Any) -> None:
    """d* below the distance of F, or so large that F may not be the only solution within it."""
    Uc, half = np.zeros((2, 6)), np.full((2, 6), 0.01)
    C = chart.coefficients.copy()
    C[0, :, 0] += 1e-3
    problem = cell_bounds.CellProof(replace(chart, coefficients=C))
    assert (problem.bounds(Uc, half).leaf_margin > 0).all()
    for near in (1e-9, 0.3):
        problem.distances = np.full((1, 7), near)
        problem.see_from(problem.chain)
        assert (problem.bounds(Uc, half).leaf_margin == 0).all()
