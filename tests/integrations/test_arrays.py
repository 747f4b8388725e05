"""F and G_r as functions of arrays: NumPy's numbers are C's, in every namespace."""

from __future__ import annotations

import os
import subprocess
import sys
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import array_api_strict as strict
import numpy as np
import pinocchio as pin
import pytest
from arms import Q_PANDA
from array_poses import function_of, matrices, random_targets, targets, turned
from cell_functions import CELLS, chart_of, panda
from sectors import WIDTHS

import repctl_pin as rp
from repctl_pin.model.joint_chain import along_z, joint_chain

NAMES = (*CELLS, *(f"sector, {name}" for name in WIDTHS))
CHECKS = Path(__file__).with_name("array_checks.py")


def deviation(F: rp.InverseFunction, Q: np.ndarray, wanted: np.ndarray) -> float:
    """Compare two results: the same rows are NaN, and the others solve to rounding."""
    assert np.array_equal(np.isnan(Q), np.isnan(wanted))
    good = ~np.isnan(Q).any(axis=1)
    assert good.sum() > len(Q) / 8
    return float(np.abs(Q - wanted)[good].max())


@pytest.mark.parametrize("name", NAMES)
def test_numpy_has_the_numbers_of_c_and_refuses_the_same_poses(name: str) -> None:
    """Of the leaves up to ±6, many are beyond a limit, or have no configuration."""
    F = function_of(name)
    for most in (1.5, 6.0):
        X, C = random_targets(F, 300, seed=58, most=most)
        Q = rp.arrays.inverse_function(F, np)(X, C)
        assert deviation(F, Q, F.batch(X, leaf=C, missing="nan")) < 1e-12


def correction(F: rp.InverseFunction, X: np.ndarray, C: np.ndarray, Q: np.ndarray) -> np.ndarray:
    """One more Newton step of F's equations; what is left of them is in extended precision."""
    task, chain = F.task, joint_chain(F.task)
    R, p = (each.astype(np.longdouble) for each in along_z(chain))
    q = Q.astype(np.longdouble)
    turns, at = np.broadcast_to(R[0], (len(q), 3, 3)), np.broadcast_to(p[0], (len(q), 3))
    for j, (link, step) in enumerate(zip(R[1:], p[1:], strict=True)):
        cos, sin = np.cos(q[:, j, None]), np.sin(q[:, j, None])
        x, y, z = np.moveaxis(turns, 2, 0)
        turned_on = np.stack([cos * x + sin * y, cos * y - sin * x, z], axis=2)
        turns, at = turned_on @ link, at + turned_on @ step
    away, goal = X[:, :3, 3] - at, X[:, :3, :3]
    if task.kind == "axis":
        aim = np.einsum("Kij,Ki->Kj", turns, goal[:, :, 2])
        turn = np.stack([-aim[:, 1], aim[:, 0]], axis=1)
    else:
        off = goal @ np.swapaxes(turns, 1, 2)
        turn = np.stack([off[:, i, j] - off[:, j, i] for i, j in ((2, 1), (0, 2), (1, 0))], 1) / 2
    u, shift = F.chart.cell._split(F.cell.coordinates(X[:, :3, 3], goal)[0])
    q_ref, n_ref = F.chart.reference(u)
    level = C - np.einsum("Knr,Kn->Kr", n_ref, q - q_ref - shift)
    J_V = np.concatenate([task.jacobians(Q), np.swapaxes(n_ref, 1, 2)], axis=1)
    left = np.concatenate([away, turn, level], axis=1).astype(float)
    return np.linalg.solve(J_V, left[:, :, None])[:, :, 0]


@pytest.mark.parametrize("name", ["poses", "tool axes", "sector, pose", "sector, axis"])
def test_numpy_and_c_solve_the_equations_to_rounding(name: str) -> None:
    """58: C held a tool axis that was off by up to 1e-12 rad to be exact."""
    F = function_of(name)
    X, C = random_targets(F, 2000, seed=58)
    Q = F.batch(X, leaf=C, missing="nan")
    good = ~np.isnan(Q[:, 0])
    X, C, Q = X[good], C[good], Q[good]
    assert len(Q) > 250
    assert np.abs(correction(F, X, C, Q)).max() < 1e-13
    assert np.abs(correction(F, X, C, rp.arrays.inverse_function(F, np)(X, C))).max() < 1e-13


@pytest.mark.parametrize("name", NAMES)
def test_pose_and_leaf_is_the_inverse_to_rounding(name: str) -> None:
    """58.2: (pose, leaf) → q → (pose, leaf), and q → (pose, leaf) → q."""
    F = function_of(name)
    f, back = rp.arrays.inverse_function(F, np), rp.arrays.pose_and_leaf(F, np)
    X, C = targets(F, 64), np.random.default_rng(1).uniform(-0.2, 0.2, (64, F.task.r))
    Q = f(X, C)
    good = ~np.isnan(Q[:, 0])
    X, C, Q = X[good], C[good], Q[good]
    x, c = back(Q)
    assert len(Q) > 32 and np.abs(c - C).max() < 1e-13
    assert np.abs(f(x, c) - Q).max() < 1e-13
    rows = [row for row in F.task.kind.rows.tolist() if row < 3]
    assert np.abs(x[:, rows, 3] - X[:, rows, 3]).max() < 1e-13
    assert np.abs(x - F.pose_and_leaf(Q)[0]).max() < 1e-15


@pytest.mark.parametrize("name", NAMES)
def test_the_law_is_the_controllers_and_the_derivative_of_f(name: str) -> None:
    F, rng = function_of(name), np.random.default_rng(2)
    X = targets(F, 32)
    Q, Xdot = F.batch(X, missing="nan"), rng.normal(size=(32, F.task.m))
    Q = np.where(np.isnan(Q), Q[~np.isnan(Q[:, 0])][0], Q)
    qdot = rp.arrays.velocity(F.inverse, np)(Q, Xdot)
    wanted = F.inverse.velocities(Q, Xdot)
    assert np.abs(qdot - wanted).max() < 1e-12 * np.abs(wanted).max()


@pytest.mark.parametrize("name", ["poses", "tool axes", "sector, pose", "sector, axis"])
def test_the_law_moves_the_pose_and_keeps_the_leaf(name: str) -> None:
    """Along q + h q̇ the pose moves by h ẋ and the level stays, off the leaf c = 0, too."""
    F, rng, h = function_of(name), np.random.default_rng(3), 1e-5
    Q, Xdot = F.batch(targets(F, 16), missing="nan"), rng.normal(size=(16, F.task.m))
    Q = Q[~np.isnan(Q[:, 0])] + rng.uniform(-0.01, 0.01, F.task.n)
    Xdot, back = Xdot[: len(Q)], rp.arrays.pose_and_leaf(F, np)
    qdot = rp.arrays.velocity(F.inverse, np)(Q, Xdot)
    (before, c), (after, d) = (back(Q + sign * h * qdot) for sign in (-1, 1))
    assert np.abs(after[:, :3, 3] - before[:, :3, 3] - 2 * h * Xdot[:, :3]).max() < 1e-12
    assert np.nanmax(np.abs(d - c)) < 1e-12


@pytest.mark.parametrize("name", ["poses", "tool axes", "sector, pose", "sector, xy"])
def test_the_strict_namespace_has_the_same_numbers(name: str) -> None:
    F = function_of(name)
    X, C = random_targets(F, 64)
    Q = rp.arrays.inverse_function(F, np)(X, C)
    ours = rp.arrays.inverse_function(F, strict)(strict.asarray(X), strict.asarray(C))
    assert deviation(F, np.asarray(ours), Q) < 1e-14
    Xdot = np.random.default_rng(1).normal(size=(64, F.task.m))
    qdot = rp.arrays.velocity(F.inverse, strict)(ours, strict.asarray(Xdot))
    wanted = rp.arrays.velocity(F.inverse, np)(Q, Xdot)
    assert np.array_equal(np.isnan(qdot), np.isnan(wanted))
    assert np.nanmax(np.abs(np.asarray(qdot) - wanted)) < 1e-12
    x, c = rp.arrays.pose_and_leaf(F, strict)(ours)
    assert np.nanmax(np.abs(np.asarray(c) - C)) < 1e-12 and x.shape == (64, 4, 4)


def test_leading_axes_are_kept_and_broadcast() -> None:
    F = function_of("poses")
    f, X = rp.arrays.inverse_function(F, np), targets(F, 6).reshape(2, 3, 4, 4)
    C = np.array([0.0, 0.05])[:, None, None]
    Q = f(X, C)
    assert Q.shape == (2, 3, 7) and f(X[0, 0]).shape == (7,)
    assert f(X[:0]).shape == (0, 3, 7)
    assert np.abs(Q[1, 2] - F(X[1, 2], leaf=[0.05])).max() < 1e-12
    levels = f(X[0, 0], np.linspace(-0.1, 0.1, 5)[:, None])
    assert levels.shape == (5, 7) and np.abs(levels[2] - Q[0, 0]).max() < 1e-14
    assert rp.arrays.velocity(F.inverse, np)(Q[0, 0], np.eye(6)).shape == (6, 7)
    x, c = rp.arrays.pose_and_leaf(F, np)(Q)
    assert x.shape == (2, 3, 4, 4) and c.shape == (2, 3, 1)


def test_it_is_nan_where_f_refuses() -> None:
    """37.1, 37.10: no joints beyond limits, and none for matrices that are no rigid transforms."""
    whole = function_of("poses")
    F, rng, count = (
        rp.InverseFunction(whole.chart, keep_limits=False),
        np.random.default_rng(37),
        256,
    )
    X, C = targets(F, count), rng.uniform(-6, 6, (count, 1))
    C[::4] = 0.0
    C[128:] = 0.0
    for k in range(128, count):
        off = rng.choice([1, -1]) * 10 ** rng.uniform(-8, -1)
        i, j = rng.integers(4, size=2)
        if i < 3 and j == 3:
            X[k, :3, :3] *= 1 + off
        elif i < 3 and k % 2:
            X[k, i, :3] = X[k, i - 1, :3]  # two equal rows
        else:
            X[k, i, j] += off
    X[128, :3, 2] *= -1  # reflected
    X[129], X[130], X[131] = np.nan, np.inf, 1e200
    C[132:136, 0] = np.nan, np.inf, 1e300, 1e8
    Q = rp.arrays.inverse_function(F, np)(X, C)

    def refused(x: np.ndarray, c: np.ndarray) -> bool:
        try:
            F.batch(x[None], leaf=c)
        except rp.InputError:
            return True
        return False

    wanted = np.array([refused(x, c) for x, c in zip(X, C, strict=True)])
    assert np.array_equal(np.isnan(Q).all(axis=1), wanted)
    assert np.array_equal(np.isfinite(Q).all(axis=1), ~wanted)
    assert 20 < wanted[:128].sum() < 100 and 40 < wanted[128:].sum() < 120


def test_the_edge_of_a_cell_and_one_orientation() -> None:
    F = function_of("poses of one orientation")
    f, x, k = rp.arrays.inverse_function(F, np), F.cell.at(np.zeros(3)).homogeneous, F.cell.k
    edge = [1 - 1e-6, 1.0, 1 + 1e-10, 1 + 1e-8, 1 + 1e-6]
    X = matrices(
        F, np.array([sign * e * np.eye(k)[i] for i in range(k) for sign in (1, -1) for e in edge])
    )
    assert deviation(F, f(X), F.batch(X, missing="nan")) < 1e-12
    assert np.isnan(f(turned(x, 1e-3 * np.eye(6)[3]))).all() and np.isfinite(f(x)).all()
    q = F(x)
    G_r = rp.arrays.velocity(F.inverse, np)
    assert np.isfinite(G_r(q, np.ones(6))).all()
    beyond = np.where(np.arange(7) == 0, F.task.upper + 0.01, q)
    assert np.isnan(G_r(np.stack([beyond, q + 0.5]), np.ones(6))).all()


def test_single_precision_has_its_own_bound() -> None:
    """Measured over all kinds of cells: at most 2e-5 rad; where float64 is NaN, it is, too, but
    within 1e-5 of an edge or a limit."""
    F = function_of("poses")
    X, C = random_targets(F, 300)
    wanted = F.batch(X, leaf=C, missing="nan")
    Q = rp.arrays.inverse_function(F, np)(X.astype(np.float32), C.astype(np.float32))
    assert Q.dtype == np.float32 and deviation(F, Q, wanted) < 5e-5
    good = ~np.isnan(wanted[:, 0])
    Xdot = np.ones((good.sum(), 6), np.float32)
    qdot = rp.arrays.velocity(F.inverse, np)(Q[good], Xdot)
    exact = F.inverse.velocities(wanted[good], Xdot)
    assert qdot.dtype == np.float32
    assert np.nanmax(np.abs(qdot - exact)) < 1e-3 * np.abs(exact).max()


def test_a_pose_relative_to_a_workpiece_that_moves() -> None:
    """``robot.task(…, on=)``: the chain runs through the workpiece's own joints."""
    robot = rp.Robot.load(Path(__file__).parents[2] / "examples" / "weld_cell.urdf")
    task = robot.task("torch", "axis", on="workpiece")
    q = task.reference
    cell = rp.Cell(task, task.placement(q), 0.03)
    F = rp.InverseFunction(chart_of(cell, q, degree=2, count=64))
    X, C = random_targets(F, 100, most=0.2)
    assert (
        deviation(F, rp.arrays.inverse_function(F, np)(X, C), F.batch(X, leaf=C, missing="nan"))
        < 1e-11
    )


@pytest.mark.parametrize("kind", ["polynomials", "Fourier series", "both"])
def test_the_law_of_a_design(kind: str) -> None:
    task, rng = panda(), np.random.default_rng(4)
    polynomials = rp.Polynomial(Q_PANDA, 3, 0.4, variables=[0, 2, 5])
    waves = rp.Fourier(7, 2, variables=[1, 2])
    basis = {"polynomials": polynomials, "Fourier series": waves, "both": polynomials + waves}[kind]
    inverse = rp.RepeatableInverse(task, basis.weighted(rng.normal(size=(basis.size, 1))))
    Q, Xdot = Q_PANDA + rng.uniform(-0.3, 0.3, (100, 7)), rng.normal(size=(100, 6))
    wanted = inverse.velocities(Q, Xdot)
    qdot = rp.arrays.velocity(inverse, np)(Q, Xdot)
    assert np.abs((qdot - wanted) / np.abs(wanted).max(axis=1)[:, None]).max() < 1e-10


def test_what_it_does_not_take_is_refused_in_one_line() -> None:
    F = function_of("poses")
    f, X = rp.arrays.inverse_function(F, np), targets(F, 3)
    law = rp.arrays.velocity(F.inverse, np)
    tool = F.with_tool(pin.SE3.Identity())
    refused: list[tuple[Any, str]] = [
        (lambda: f(np.eye(3)), r"x must be an array \(\.\.\., 4, 4\); got shape \(3, 3\)"),
        (lambda: f(X, np.zeros((3, 2))), r"leaf must be an array \(\.\.\., 1\)"),
        (lambda: f(X, np.zeros((2, 1))), "leading axes"),
        (lambda: f(np.eye(4, dtype=int)), "x must be float32 or float64; got int64"),
        (lambda: f(X.astype(np.float16)), "got float16"),
        (lambda: f(X.astype(complex)), "got complex128"),
        (lambda: f("pose"), "x must be"),
        (lambda: f([[1.0], [1.0, 2.0]]), "x must be an array of numbers"),
        (lambda: law(np.zeros(6), np.zeros(6)), r"q must be an array \(\.\.\., 7\)"),
        (lambda: law(np.zeros(7), np.zeros(5)), r"xdot must be an array \(\.\.\., 6\)"),
        (lambda: rp.arrays.inverse_function(F.chart, np), "a cell's function"),
        (lambda: rp.arrays.inverse_function(tool, np), "a cell's function"),
        (lambda: rp.arrays.pose_and_leaf(F.chart, np), "a cell's function"),
        (lambda: rp.arrays.inverse_function(F, os), "xp must be a namespace of arrays"),
        (lambda: rp.arrays.inverse_function(F, "numpy"), "xp must be a namespace of arrays"),
        (lambda: rp.arrays.velocity(F, np), "a repeatable inverse"),
        (lambda: rp.arrays.velocity(tool.inverse, np), "functions in Python"),
    ]
    for call, words in refused:
        with pytest.raises(rp.InputError, match=words) as caught:
            call()
        assert "\n" not in str(caught.value)


# ---- other packages: in a process of their own, because JAX's threads do not survive forks


def run(*options: str, quick: bool = False) -> None:
    if find_spec("jax") is None:
        pytest.skip("there is no JAX on this machine")
    command = [sys.executable, "-m", "pytest", "-n", "0", "-p", "no:cacheprovider", *options]
    flags = {"XLA_FLAGS": "--xla_backend_optimization_level=0"} if quick else {}
    done = subprocess.run(
        [*command, str(CHECKS)], capture_output=True, text=True, check=False, env=os.environ | flags
    )
    assert done.returncode == 0, done.stdout[-4000:]


@pytest.mark.slow
def test_jax() -> None:
    run(quick=True)


@pytest.mark.slow
def test_jax_with_every_kind_and_mode() -> None:
    run("-m", "slow")


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_torch_has_the_same_numbers_and_the_derivative(name: str) -> None:
    """∂q/∂x by autograd is that of F; the missing poses have the derivative 0."""
    torch = pytest.importorskip("torch")
    F = function_of(name)
    X, C = random_targets(F, 64)
    f = rp.arrays.inverse_function(F, torch)
    x = torch.asarray(X, dtype=torch.float64).requires_grad_()
    q = f(x, torch.asarray(C))
    Q = rp.arrays.inverse_function(F, np)(X, C)
    assert deviation(F, q.detach().numpy(), Q) < 1e-13
    weights = np.random.default_rng(1).normal(size=F.task.n)
    torch.nansum(q * torch.asarray(weights)).backward()
    good = ~np.isnan(Q[:, 0])
    slope = x.grad.numpy()
    assert not slope[~good].any()
    for k in np.flatnonzero(good)[:8]:
        step = 1e-6 * np.eye(3)
        wanted = weights @ F.jacobian(X[k], leaf=C[k])
        rows = [row for row in F.task.kind.rows.tolist() if row < 3]
        assert np.abs(slope[k, rows, 3] - wanted[: len(rows)]).max() < 1e-10
        if F.task.kind == "pose":
            turns = [
                turned(X[k], np.r_[0, 0, 0, w]) - turned(X[k], -np.r_[0, 0, 0, w]) for w in step
            ]
            by = [np.sum(slope[k] * each) / 2e-6 for each in turns]
            assert np.abs(by - wanted[3:]).max() < 1e-8


@pytest.mark.slow
@pytest.mark.parametrize("name", ["planar", "sector, axis"])
def test_torch_maps_f_and_compiles_it_in_one_graph(name: str) -> None:
    """58: a model that contains F, its derivative, and the way back, with fullgraph=True."""
    torch = pytest.importorskip("torch")
    F = function_of(name)
    X, C = map(torch.asarray, random_targets(F, 32))
    f, back = rp.arrays.inverse_function(F, torch), rp.arrays.pose_and_leaf(F, torch)
    law = rp.arrays.velocity(F.inverse, torch)
    whole = partial(torch.compile, fullgraph=True, backend="aot_eager")

    def same(one: Any, other: Any) -> bool:
        return bool(torch.allclose(one, other, rtol=0, atol=1e-13, equal_nan=True))

    Q = f(X, C)
    assert 4 < torch.isnan(Q[:, 0]).sum() < 28 and same(torch.func.vmap(f)(X, C), Q)
    assert same(whole(lambda x, c: f(x, leaf=c))(X, C), Q) and same(whole(f)(X), f(X))
    for one, other in zip(whole(back)(Q), back(Q), strict=True):
        assert same(one, other) and same(torch.func.vmap(back)(Q)[len(one.shape) == 2], one)
    ones = torch.ones(F.task.m, dtype=torch.float64)
    assert same(whole(law)(Q, ones), law(Q, ones))

    def loss(x: Any, c: Any) -> Any:
        return torch.nansum(torch.sin(f(x, c)))

    slopes = []
    for function in (loss, whole(loss)):
        given = X.clone().requires_grad_(), C.clone().requires_grad_()
        function(*given).backward()
        slopes.append([each.grad for each in given])
    assert all(map(same, *slopes)) and slopes[0][0].abs().max() > 0.1
