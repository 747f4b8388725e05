"""The bounds of a cell's proof against sampled values: each holds, is not far from the largest, and
one that is too small is caught."""

from __future__ import annotations

from copy import copy
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from arms import planar_task, sliding_task, spatial_task
from cell_functions import cell_of, chart_of, panda
from mutants import CELL_C, CELLS, CHAIN, COMMUTATOR, compiled, wrong
from second_order import monomials
from sectors import sector_of

import repctl_pin as rp
from repctl_pin.extensions.proof import (
    cell_kernel,
    cell_poses,
    cells,
    chain,
    commutator,
    screws,
    taylor_chain,
)

MIDDLE = np.array([0.0, -0.2345, 0.0, -2.415, 0.0, 2.18, 0.7853])
"""A configuration of the panda in the middle of the cell."""

Boxes = tuple[np.ndarray, np.ndarray]

SCALES = [(0.1, 1e-4, 0.05), (1e-4, 0.1, 0.05), (0.1, 0.4, 0.05), (1e-4, 0.4, 1e-5)]
"""How far and by which angle a pose is from f(q_ref), m and rad, and how far q is from q_ref."""


@pytest.fixture(scope="module")
def chart() -> Any:
    return chart_of(cell_of(rotation=0.2, half_width=0.05), MIDDLE)


@pytest.fixture(scope="module")
def plain(chart: Any) -> cells.CellProof:
    return cells.CellProof(chart, compiled=False)


def boxes_of(k: int, count: int, seed: int = 0) -> Boxes:
    rng = np.random.default_rng(seed)
    h = 10.0 ** rng.uniform(-1.5, -0.5, (count, 1)) * rng.uniform(0.2, 1, (count, k))
    return rng.uniform(-0.6, 0.6, (count, k)), h


def points_in(boxes: Boxes, trial: int) -> np.ndarray:
    rng = np.random.default_rng(trial)
    way = rng.uniform(-1, 1, boxes[0].shape)
    return np.asarray(np.sign(way) if trial % 2 else way)


# ---- Taylor models of poses, charts and chains -------------------------------------------------


@pytest.mark.parametrize(
    "cell",
    [
        cell_of(rotation=0.3),
        cell_of("axis", rotation=0.3),
        sector_of("pose"),
        sector_of("another axis"),
    ],
    ids=repr,
)
def test_poses_are_those_of_the_cell(cell: rp.Cell) -> None:
    Uc, h = boxes_of(cell.k, 12)
    p, R = cell_poses.Poses.of(cell).at(Uc, h)
    used = 0.0
    for trial in range(12):
        t = points_in((Uc, h), trial)
        T = monomials(t)
        true_p, true_R = cell.placements(Uc + h * t)
        for model, true in ((p, true_p), (R, np.swapaxes(true_R, 1, 2))):
            off = np.abs(np.einsum("K...m,Km->K...", model.P, T) - true)
            assert (off <= model.r + 1e-14).all()
            used = max(used, float((off / (model.r + 1e-13)).max()))
    assert used > 0.02


def screws_off(
    problem: cells.CellProof, count: int = 16, closure: ModuleType = taylor_chain
) -> dict[str, float]:
    """The largest ratios of actual differences to bounds: of q_ref and n_ref, of A J_V at q_ref,
    of J beside q_ref, and of ξ."""
    chain, k, n = problem.chain, problem.cell.k, problem.chain.n
    Uc, h = boxes_of(k, count)
    reference, normals = problem._models(Uc, h)
    poses, kind = problem.poses.at(Uc, h), problem.task.kind
    along = closure.closure_of(chain, kind, poses, reference, problem.eps)
    theta = reference.P[..., 0] @ chain.S[:, :n].T + chain.o
    g = np.array([0.05, 0.005])[np.arange(count) % 2, None] * np.ones(n)
    A = np.tile(np.eye(chain.N), (count, 1, 1))
    dJ = np.zeros((count, n, chain.N, chain.N))
    dJ[:, :, :6] = np.swapaxes(screws.slopes(chain, *screws.screws(chain, theta)), 2, 3)
    rest = problem._rest(A, dJ, theta, reference.reach, g)
    used = dict.fromkeys(("chart", "J", "beside", "ξ"), 0.0)
    for trial in range(30):
        t = points_in((Uc, h), trial)
        T = monomials(t)

        def ratio(
            name: str, off: np.ndarray, bound: np.ndarray, used: dict[str, float] = used
        ) -> None:
            used[name] = max(used[name], float((np.abs(off) / (bound + 1e-11)).max()))

        def at(model: object, T: np.ndarray = T) -> np.ndarray:
            return np.einsum("K...m,Km->K...", model.P, T)

        q, n_ref = problem.chart.reference(Uc + h * t)
        ratio("chart", at(reference) - q, reference.r)
        ratio("chart", at(normals) - n_ref, normals.r)
        J, tip, R_b, R_t, o_b = seen(chain, q)
        ratio("J", at(along.J) - J, along.J.r)
        side = np.sign(np.random.default_rng(trial).standard_normal(q.shape))
        ratio("beside", seen(chain, q + g * side)[0] - J, rest[:, :6])
        p, R = problem.cell.placements(Uc + h * t)
        e = np.einsum("Kab,Kb->Ka", R_b, p) + o_b - tip
        s = 0.5 * np.cross(R_t, R_b @ R, axisa=1, axisb=1, axisc=1).sum(axis=2)
        ratio(
            "ξ",
            at(along.xi) - np.concatenate([e + np.cross(tip, s), s], axis=1),
            along.xi.r,
        )
        sizes = np.linalg.norm(np.stack([tip, e, s]), axis=2)
        assert (sizes <= along.sizes).all()
    return used


def seen(chain: chain.Chain, q: np.ndarray) -> tuple[np.ndarray, ...]:
    """Evaluate, from the middle link: J, the tool's place, the base's rotation, the tool's, and the
    base's place."""
    theta = q @ chain.S[:, : chain.n].T + chain.o
    xi, tip = screws.screws(chain, theta)
    J = np.einsum("Klx,lc->Kxc", xi, chain.S)
    R, o = np.tile(np.eye(3), (len(q), 1, 1)), np.zeros((len(q), 3))
    R_t = R
    for joint in range(len(chain.p)):
        if joint == chain.middle:
            middle, place, R = (
                R,
                o + R @ chain.shift,
                np.tile(np.eye(3), (len(q), 1, 1)),
            )
        o = o + R @ chain.p[joint]
        R = R @ chain.R[joint]
        R_t = R
        if chain.revolute[joint]:
            R = R @ screws.turn(chain.a[joint], theta[:, joint])
        else:
            o = o + theta[:, joint, None] * (R @ chain.a[joint])
    R_b = np.swapaxes(middle, 1, 2)
    return J, tip, R_b, R_t, -np.einsum("Kab,Kb->Ka", R_b, place)


def test_taylor_models_of_a_chain_hold_and_are_not_wasteful(
    plain: cells.CellProof,
) -> None:
    used = screws_off(plain)
    assert max(used.values()) <= 1
    assert used["J"] > 0.02 and used["beside"] > 0.4 and used["ξ"] > 0.02


def test_an_arm_with_a_prismatic_joint_has_the_same_bounds(tmp_path: Path) -> None:
    task = spatial_task(7, tmp_path, kind="pose", seed=3)
    rng = np.random.default_rng(0)
    Q = task.reference + rng.uniform(-0.7, 0.7, (64, 7))
    q = Q[np.argmax(np.linalg.svd(task.jacobians(Q), compute_uv=False)[:, -1])]
    chart = chart_of(rp.Cell(task, task.placement(q), 0.02, 0.02), q, 2, 64)
    problem = cells.CellProof(chart, compiled=False)
    for middle in (2, 4):
        problem.chain = chain.chain_of(task).seen_from(middle, 0.5)
        assert max(screws_off(problem, 8).values()) <= 1


# ---- the way from f(q_ref) to x ----------------------------------------------------------------


def turned_off(
    problem: cells.CellProof, seed: int, scale: tuple[float, float, float]
) -> np.ndarray:
    """How far a twist is from ξ, seen from the middle link beside q_ref: ratios to the bounds."""
    rng, chain, worst = np.random.default_rng(seed), problem.chain, np.zeros(2)
    count, n = 40, chain.n
    q = MIDDLE + rng.uniform(-0.3, 0.3, (count, n))
    g = scale[2] * 10.0 ** rng.uniform(-1.7, 0, (count, n))
    _, tip, R_b, _, o_b = seen(chain, q)
    e, axis = rng.standard_normal((2, count, 3))
    e *= scale[0] / np.linalg.norm(e, axis=1, keepdims=True)
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    omega = scale[1] * axis
    s = np.sin(scale[1]) * axis
    sizes = np.stack([np.linalg.norm(x, axis=1) for x in (tip, e, s)])
    theta = q @ chain.S[:, :n].T + chain.o
    linear, angular = problem._turned(g, theta, 0 * g, sizes)
    for _ in range(30):
        off = g * np.sign(rng.standard_normal(q.shape))
        _, _, R_1, _, o_1 = seen(chain, q + off)
        R = R_1 @ np.swapaxes(R_b, 1, 2)  # from the middle link at q to that at q + off
        o = o_1 - np.einsum("Kab,Kb->Ka", R, o_b)
        v = e + np.cross(tip + rng.uniform() * e, omega)
        w = np.einsum("Kab,Kb->Ka", R, omega)
        v = np.einsum("Kab,Kb->Ka", R, v) + np.cross(o, w)
        dv, dw = v - e - np.cross(tip, s), w - s
        ratios = (
            np.linalg.norm(dv, axis=1) / linear,
            np.linalg.norm(dw, axis=1) / angular,
        )
        worst = np.maximum(worst, [r.max() for r in ratios])
    return worst


@pytest.mark.parametrize("scale", SCALES)
def test_a_twist_seen_from_beside_q_ref_changes_as_bounded(
    plain: cells.CellProof, scale: tuple[float, float, float]
) -> None:
    linear, angular = turned_off(plain, 0, scale)
    assert linear <= 1 and angular <= 1
    assert linear > 0.3 and angular > 0.4


@pytest.mark.parametrize("mutant", CELLS)
def test_a_wrong_term_of_a_cell_s_bounds_is_noticed(
    mutant: str, plain: cells.CellProof, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = copy(plain)
    problem.__class__ = wrong(monkeypatch, "cells.py", *CELLS[mutant]).CellProof
    found = [turned_off(problem, 1, scale).max() for scale in SCALES]
    whole, problem = problem, copy(problem)
    problem.chain = plain.chain.seen_from(1, 0.0)  # where the middle link only turns
    found += [turned_off(problem, 1, scale).max() for scale in SCALES[1:3]]
    if max(found) <= 1:
        found += screws_off(whole, 8).values()
    assert max(found) > 1


@pytest.mark.parametrize("mutant", CHAIN)
def test_a_wrong_sign_in_a_chain_s_models_is_noticed(
    mutant: str, plain: cells.CellProof, monkeypatch: pytest.MonkeyPatch
) -> None:
    module = wrong(monkeypatch, "taylor_chain.py", *CHAIN[mutant])
    assert max(screws_off(plain, 4, module).values()) > 1


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


def test_both_kernels_give_the_same_enclosures(
    chart: Any, plain: cells.CellProof
) -> None:
    compiled = cells.CellProof(chart)
    if compiled._kernel is None:
        pytest.skip("there is no native library")
    rng, k = np.random.default_rng(3), 6
    U = rng.uniform(-0.9, 0.9, (21, k))
    h = np.array([0.5, 0.2, 0.05])[np.arange(21) % 3, None] * rng.uniform(
        0.3, 1, U.shape
    )
    (one, Q, reach), (two, Q_c, reach_c) = plain.enclosed(U, h), compiled.enclosed(U, h)
    good = one.leaf_margin > 0
    assert 0.3 < good.mean() < 1 and (good == (two.leaf_margin > 0)).all()
    np.testing.assert_allclose(Q_c, Q, atol=1e-12)
    np.testing.assert_allclose(reach_c[good], reach[good], rtol=1e-8, atol=1e-12)
    for name in ("leaf_margin", "sigma_min"):
        values = getattr(two, name)[good], getattr(one, name)[good]
        np.testing.assert_allclose(*values, rtol=1e-6)
    np.testing.assert_allclose(
        two.limit_margin[good], one.limit_margin[good], atol=1e-10
    )


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_wrong_term_in_c_is_noticed(tmp_path: Path) -> None:
    right = cells.CellProof(
        chart_of(cell_of(rotation=0.2, half_width=0.05), MIDDLE, 4, 256)
    )
    if right._kernel is None:
        pytest.skip("there is no native library")
    rng = np.random.default_rng(4)
    U = rng.uniform(-0.9, 0.9, (96, 6))
    h = np.array([0.4, 0.2, 0.05])[np.arange(96) % 3, None] * rng.uniform(
        0.3, 1, U.shape
    )
    bounds, _, reach = right.enclosed(U, h)
    for name, (file, piece, instead) in CELL_C.items():
        library = compiled(tmp_path, file, piece, instead)
        changed, _, other = cell_kernel.Kernel(right, library).bounds(U, h)
        same = np.allclose(reach, other, rtol=1e-5, atol=1e-7, equal_nan=True)
        same &= np.allclose(bounds.leaf_margin, changed.leaf_margin, rtol=1e-5)
        assert not same, name


def test_a_cell_is_proved_without_a_compiler_too(
    chart: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cells, "library", lambda: None)
    problem = cells.CellProof(chart)
    assert problem._kernel is None
    assert problem.bounds(np.zeros((1, 6)), np.full((1, 6), 0.01)).leaf_margin[0] > 0.9


def test_nothing_is_proved_with_a_wrong_distance_from_the_chart(chart: Any) -> None:
    """d* below the distance of F, or so large that F may not be the only solution within it."""
    Uc, half = np.zeros((2, 6)), np.full((2, 6), 0.01)
    for compiling in (True, False):
        problem = cells.CellProof(chart, compiling)
        assert (problem.bounds(Uc, half).leaf_margin > 0).all()
        for near in (1e-9, 0.2):
            problem.near = np.full(7, near)
            if problem._kernel is not None:
                problem._kernel = cell_kernel.Kernel(problem, cells.library())
            assert (problem.bounds(Uc, half).leaf_margin == 0).all()
