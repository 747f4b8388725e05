"""The function of a cell in JAX: the same numbers, its derivative, and what it refuses."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pinocchio as pin
import pytest
from cell_functions import function_of as box_function
from sectors import WIDTHS
from sectors import found as sector_design

import repctl_pin as rp
from repctl_pin.extensions.integrations.jax import inverse_function, pose_and_leaf

COUNT = 16


def function_of(name: str) -> rp.InverseFunction:
    kind, _, what = name.partition("sector, ")
    return sector_design(what).function if not kind else box_function(name)


@pytest.fixture(autouse=True, scope="module")
def doubles() -> Iterator[None]:
    with (jax if hasattr(jax, "enable_x64") else jax.experimental).enable_x64(True):
        yield


@pytest.fixture(scope="module")
def poses() -> rp.InverseFunction:
    return function_of("poses")


@cache
def many(name: str) -> Any:
    """x (16, 4, 4), c (16, 1) → q (16, 7); JAX compiles it once."""
    return jax.jit(jax.vmap(inverse_function(function_of(name))))


def targets(function: rp.InverseFunction, count: int = COUNT, share: float = 0.9) -> np.ndarray:
    p, R = function.cell.placements(share * function.cell.sample(count, seed=5))
    X = np.tile(np.eye(4), (count, 1, 1))
    X[:, :3, :3], X[:, :3, 3] = R, p
    return X


def turned(x: np.ndarray, twist: np.ndarray) -> np.ndarray:
    """Move a pose by a twist (v, ω) in base axes."""
    moved = x.copy()
    moved[:3, 3] += twist[:3]
    moved[:3, :3] = pin.exp3(twist[3:]) @ x[:3, :3]
    return moved


@pytest.mark.parametrize(
    "name",
    [
        "poses",
        "sector, xy",
        pytest.param("tool axes", marks=pytest.mark.slow),
        pytest.param("positions", marks=pytest.mark.slow),
        pytest.param("poses of one orientation", marks=pytest.mark.slow),
        *(
            pytest.param(f"sector, {name}", marks=pytest.mark.slow)
            for name in WIDTHS
            if name != "xy"
        ),
    ],
)
def test_the_numbers_are_pythons_and_the_way_back_is_its_inverse(name: str) -> None:
    function = function_of(name)
    X, leaf = targets(function), np.full(function.task.r, 0.05)
    C = np.tile(leaf, (COUNT, 1))
    C[0] = 0.0
    Q = many(name)(X, C)
    listed = [pin.SE3(x) for x in X]
    assert np.abs(Q[1:] - function.batch(listed, leaf=leaf)[1:]).max() < 1e-9
    assert np.abs(Q[0] - function(listed[0])).max() < 1e-9
    poses, leaves = jax.jit(jax.vmap(pose_and_leaf(function)))(Q)
    assert np.abs(leaves - C).max() < 1e-9
    at = [function.task.placement(q).homogeneous for q in np.asarray(Q)]
    assert np.abs(poses - np.array(at)).max() < 1e-12


def test_its_derivatives_are_those_of_finite_differences(poses: rp.InverseFunction) -> None:
    x, step = targets(poses)[0], 1e-5
    moved = [turned(x, sign * step * twist) for twist in np.eye(6) for sign in (1, -1)]
    X, C = np.array([*moved, x, x, x, x]), np.zeros((COUNT, 1))
    C[12:14, 0] = [step, -step]
    Q = many("poses")(X, C)
    by_x, by_c = jax.jit(jax.jacrev(inverse_function(poses), argnums=(0, 1)))(x, np.zeros(1))
    for i in range(6):
        dx = (X[2 * i] - X[2 * i + 1]) / (2 * step)
        column = np.einsum("nab,ab->n", by_x, dx)
        assert np.abs(column - (Q[2 * i] - Q[2 * i + 1]) / (2 * step)).max() < 1e-7
        assert np.abs(column - poses.jacobian(x)[:, i]).max() < 1e-6
    assert np.abs(by_c[:, 0] - (Q[12] - Q[13]) / (2 * step)).max() < 1e-7
    assert np.abs(poses.task.jacobian(np.asarray(Q[14])) @ by_c).max() < 1e-9


def test_it_is_nan_where_python_refuses(poses: rp.InverseFunction) -> None:
    x = targets(poses)[0]
    X, C = np.tile(x, (COUNT, 1, 1)), np.zeros((COUNT, 1))
    X[0, 0, 3] += 0.5
    X[1] = np.nan
    C[2] = 10.0
    Q = many("poses")(X, C)
    assert np.isnan(Q[:3]).all() and np.isfinite(Q[3:]).all()
    with pytest.raises(rp.InputError, match=r"homogeneous matrix \(4, 4\)"):
        inverse_function(poses)(np.eye(3))
    with pytest.raises(rp.InputError, match="a cell's function"):
        inverse_function(poses.chart)


def test_it_refuses_the_leaves_and_the_matrices_that_python_refuses(
    poses: rp.InverseFunction,
) -> None:
    """Issue 37, items 1 and 10: it returned joints beyond their limits on leaves other than c = 0,
    and joints for matrices that are no rotations or have a wrong last row."""
    F, rng = (rp.InverseFunction(poses.chart, keep_limits=False), np.random.default_rng(37))
    count = 256
    X, C = targets(poses, count), rng.uniform(-6, 6, (count, 1))
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
    Q = jax.jit(jax.vmap(inverse_function(F)))(X, C)

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


@pytest.mark.slow
def test_a_sector_all_the_way_round_and_its_derivative() -> None:
    """The derivative is Python's; across the symmetry joint 1 alone turns, and q is NaN beyond."""
    F = function_of("sector, pose")
    f, x, cell = inverse_function(F), targets(F, 1)[0], F.cell
    by_x = jax.jit(jax.jacfwd(f))(x)
    for i, column in enumerate(F.jacobian(x).T):
        ends = [turned(x, sign * 1e-6 * np.eye(6)[i]) for sign in (1, -1)]
        dx = (ends[0] - ends[1]) / 2e-6
        assert np.abs(np.einsum("nab,ab->n", by_x, dx) - column).max() < 1e-5
    low, high = F.task.lower[0] - f(x)[0], F.task.upper[0] - f(x)[0]
    for angle in np.linspace(max(low, -2.5), min(high, 2.5), 5)[1:-1]:
        turn = np.eye(4)
        turn[:3, :3] = pin.exp3(np.array([0, 0, angle]))
        assert np.allclose(f(turn @ x), f(x) + angle * np.eye(7)[0], atol=1e-12)
    out = x.copy()
    out[2, 3] += 2.1 * cell.widths[2]
    assert np.isnan(f(out)).all()


@pytest.mark.slow
def test_one_orientation_is_held() -> None:
    function = function_of("poses of one orientation")
    f, x = inverse_function(function), targets(function)[0]
    assert np.isfinite(f(x)).all()
    assert np.isnan(f(turned(x, 1e-3 * np.eye(6)[3]))).all()


@pytest.mark.slow
def test_second_derivatives_are_of_the_function_not_of_the_iterations(
    poses: rp.InverseFunction,
) -> None:
    x, step = targets(poses)[0], 1e-4
    up = np.zeros((4, 4))
    up[2, 3] = 1.0

    def along(t: float) -> Any:
        return inverse_function(poses)(x + t * up)

    second = jax.jit(jax.jacfwd(jax.jacfwd(along)))(0.0)
    differences = (along(step) - 2 * along(0.0) + along(-step)) / step**2
    assert np.abs(second - differences).max() < 1e-5


@pytest.mark.slow
def test_single_precision(poses: rp.InverseFunction) -> None:
    X = targets(poses)
    Q = jax.vmap(inverse_function(poses))(jnp.asarray(X, jnp.float32))
    assert Q.dtype == jnp.float32
    assert np.abs(Q - poses.batch([pin.SE3(x) for x in X])).max() < 1e-4


@pytest.mark.slow
def test_a_hundred_thousand_poses_in_one_call(poses: rp.InverseFunction) -> None:
    X = targets(poses, 100_000)
    Q = jax.jit(jax.vmap(inverse_function(poses)))(X)
    assert np.abs(Q[::1000] - poses.batch([pin.SE3(x) for x in X[::1000]])).max() < 1e-9


@pytest.mark.slow
def test_far_leaves_of_a_sector_are_refused_where_python_refuses() -> None:
    """Issue 20, item 10: JAX asked for a shorter last Newton step, and refused more."""
    task = rp.Robot.load("xarm7").task("link_eef", "pose")
    middle = task.placement(task.reference)
    sector = rp.Sector(task, middle, radius=0.05, height=0.05, angle="all")
    found = rp.nearest_inverse_function(
        rp.Pseudoinverse(task),
        sector,
        degree=2,
        options=rp.FitOptions(samples=128, held_out=64),
        incomplete="keep",
    )
    F, rng = found.function, np.random.default_rng(5)
    U = rng.uniform(-1, 1, (1500, F.cell.k))
    X, C = (np.array([F.cell.at(u).homogeneous for u in U]), rng.uniform(-6, 6, (1500, 1)))
    wanted = F.batch(X, leaf=C, missing="nan")
    Q = jax.vmap(inverse_function(F))(X, C)
    assert np.array_equal(np.isnan(Q), np.isnan(wanted))
    assert np.nanmax(np.abs(Q - wanted)) < 1e-11
