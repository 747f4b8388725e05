"""F and G_r as functions of JAX's arrays: compiled, mapped and differentiated."""

from __future__ import annotations

from collections.abc import Iterator

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from array_poses import COUNT, function_of, random_targets, targets, turned, ways
from sectors import WIDTHS

import repctl_pin as rp


@pytest.fixture(autouse=True, scope="module")
def doubles() -> Iterator[None]:
    with (jax if hasattr(jax, "enable_x64") else jax.experimental).enable_x64(True):
        yield


@pytest.fixture(scope="module")
def poses() -> rp.InverseFunction:
    return function_of("poses")


SLOW = [
    pytest.param(name, marks=pytest.mark.slow)
    for name in (
        "planar",
        "poses",
        "tool axes",
        "positions",
        *(f"sector, {each}" for each in WIDTHS),
    )
]


def test_jitted_numbers_are_those_of_numpy() -> None:
    F = function_of("planar")
    X, C = random_targets(F, COUNT)
    Q = rp.arrays.inverse_function(F, jnp)(X, C)
    wanted = rp.arrays.inverse_function(F, np)(X, C)
    good = ~np.isnan(wanted).any(axis=1)
    assert 4 < good.sum() < COUNT and np.array_equal(np.isnan(Q), np.isnan(wanted))
    assert np.abs(Q - wanted)[good].max() < 1e-12


@pytest.mark.parametrize("name", SLOW)
def test_jitted_numbers_and_derivatives_are_those_of_numpy(name: str) -> None:
    """One compilation serves the values, NaN, and ∂q/∂x and ∂q/∂c along random directions."""
    F, rng = function_of(name), np.random.default_rng(58)
    X, C = random_targets(F, COUNT)
    wanted = rp.arrays.inverse_function(F, np)(X, C)
    good = ~np.isnan(wanted).any(axis=1)
    assert 4 < good.sum() < COUNT
    way, dC = ways(F, rng), rng.normal(size=C.shape)
    dX = (way(1e-6) - way(-1e-6)) / 2e-6
    f = rp.arrays.inverse_function(F, jnp)
    Q, dQ = jax.jit(lambda *at: jax.jvp(f, at[:2], at[2:]))(X, C, dX, dC)
    assert np.array_equal(np.isnan(Q), np.isnan(wanted))
    assert np.abs(Q - wanted)[good].max() < 1e-12
    # The other way: a difference of F in C over the same directions
    ends = [F.batch(way(h), leaf=C + h * dC, missing="nan") for h in (1e-5, -1e-5)]
    slopes = (ends[0] - ends[1])[good] / 2e-5
    fine = ~np.isnan(slopes).any(axis=1)
    assert fine.sum() > 3
    assert np.abs(dQ[good][fine] - slopes[fine]).max() < 1e-5 * (1 + np.abs(slopes[fine]).max())


@pytest.mark.slow
def test_reverse_mode_a_map_and_the_jacobian(poses: rp.InverseFunction) -> None:
    x, f = targets(poses)[0], rp.arrays.inverse_function(poses, jnp)
    by_x, by_c = jax.jit(jax.jacrev(f, argnums=(0, 1)))(x, np.zeros(1))
    for i, column in enumerate(poses.jacobian(x).T):
        ends = [turned(x, sign * 1e-6 * np.eye(6)[i]) for sign in (1, -1)]
        assert np.abs(np.einsum("nab,ab->n", by_x, ends[0] - ends[1]) / 2e-6 - column).max() < 1e-9
    assert np.abs(poses.task.jacobian(np.asarray(f(x))) @ by_c).max() < 1e-12
    X = targets(poses)
    assert np.abs(jax.vmap(f)(X) - f(X)).max() < 1e-13


@pytest.mark.slow
def test_the_derivative_of_a_missing_pose_is_0(poses: rp.InverseFunction) -> None:
    X = targets(poses)[:2].copy()
    X[1, 0, 3] += 5.0
    f = rp.arrays.inverse_function(poses, jnp)
    slope = jax.jit(jax.grad(lambda X: jnp.nansum(f(X) ** 2)))(X)
    assert np.isfinite(slope).all() and np.abs(slope[0]).max() > 0.1 and not slope[1].any()


@pytest.mark.slow
def test_second_derivatives_are_of_the_function_not_of_the_iterations(
    poses: rp.InverseFunction,
) -> None:
    f, x, step = rp.arrays.inverse_function(poses, jnp), targets(poses)[0], 1e-4
    up = np.zeros((4, 4))
    up[2, 3] = 1.0

    def along(t: float) -> jax.Array:
        return f(x + t * up)

    second = jax.jit(jax.jacfwd(jax.jacfwd(along)))(0.0)
    differences = (along(step) - 2 * along(0.0) + along(-step)) / step**2
    assert np.abs(second - differences).max() < 1e-5


@pytest.mark.slow
@pytest.mark.parametrize("name", ["poses", "tool axes", "sector, pose", "sector, position"])
def test_the_law_and_the_way_back_in_jax(name: str) -> None:
    F = function_of(name)
    Q, Xdot = F.batch(targets(F)), np.random.default_rng(1).normal(size=(COUNT, F.task.m))
    qdot = rp.arrays.velocity(F.inverse, jnp)(Q, Xdot)
    assert np.abs(qdot - F.inverse.velocities(Q, Xdot)).max() < 1e-11
    x, c = rp.arrays.pose_and_leaf(F, jnp)(Q)
    assert np.abs(x - F.pose_and_leaf(Q)[0]).max() < 1e-13 and np.abs(c).max() < 1e-12
