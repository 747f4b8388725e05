"""Fourier potentials: derivatives, which waves there are, and a design that goes far round."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

import repctl_pin as rp


@pytest.fixture(
    params=[{}, {"variables": [2]}, {"period": [2 * np.pi, 0.5, 3.0]}, {"cross": False}]
)
def potentials(request: pytest.FixtureRequest) -> rp.Fourier:
    return rp.Fourier(3, 2, **request.param)


def test_derivatives_agree_with_finite_differences(potentials: rp.Fourier) -> None:
    rng = np.random.default_rng(0)
    Q, e = rng.uniform(-2, 2, (5, 3)), 1e-6
    D = potentials.gradients(Q)
    A = rng.normal(size=(potentials.size, 2))
    h = potentials.weighted(A)
    for i, d in enumerate(np.eye(3)):
        slope = (potentials.values(Q + e * d) - potentials.values(Q - e * d)) / (2 * e)
        assert np.allclose(D[:, i], slope, atol=1e-6)
        for q in Q:
            bend = (h.gradient(q + e * d) - h.gradient(q - e * d)) / (2 * e)
            assert np.allclose(h.hessian(q)[:, i], bend, atol=1e-4, rtol=1e-6)
    assert np.allclose(h.gradients(Q), D @ A) and np.allclose(h.gradient(Q[0]), D[0] @ A)
    assert np.allclose([h.value(q) for q in Q], potentials.values(Q) @ A)


def test_every_wave_is_there_once() -> None:
    potentials = rp.Fourier(3, 2)
    waves = {k for k in product(range(-2, 3), repeat=3) if 1 <= sum(map(abs, k)) <= 2}
    assert potentials.size == len(waves)  # a sine and a cosine for each pair k, −k
    # orthonormal up to √2 over the torus: a full grid of 6 points a joint integrates them exactly
    grid = np.array(list(product(np.arange(6) * 2 * np.pi / 6, repeat=3)))
    H = potentials.values(grid)
    assert np.allclose(H.T @ H / len(grid), np.eye(potentials.size) / 2, atol=1e-12)
    assert rp.Fourier(3, 2, cross=False).size == 12 and rp.Fourier(3, 2, variables=[1]).size == 4
    assert (
        "sin(u_0)" in potentials.names
        and "cos(u_0 − u_2)" in potentials.names
        and "cos(2 u_1)" in potentials.names
    )


def test_potentials_return_after_a_period() -> None:
    potentials = rp.Fourier(2, 3, period=[2 * np.pi, 0.7])
    q = np.array([[0.3, 0.1]])
    assert np.allclose(
        potentials.values(q), potentials.values(q + np.array([2 * np.pi, -0.7])), atol=1e-12
    )


def test_a_joined_basis_on_the_ppr_arm() -> None:
    """d₁, d₂ and waves of θ₃: close to the best that a function of θ₃ alone can do over |θ₃| ≤ 0.5,
    0.0396322538."""
    task = rp.Robot.load("ppr").task(None, "xy")
    box = rp.Box(np.zeros(3), [1.0, 1.0, 0.5])
    potentials = rp.Polynomial(np.zeros(3), 1, variables=[0, 1]) + rp.Fourier(3, 3, variables=[2])
    design = rp.nearest_repeatable(rp.Pseudoinverse(task), potentials, box)
    assert design.converged
    assert 0.0396322538 - 2e-7 < design.cost < 0.03964


@pytest.mark.parametrize(
    "make, message",
    [
        (lambda: rp.Fourier(0, 1), "joints"),
        (lambda: rp.Fourier(3, 0), "order"),
        (lambda: rp.Fourier(3, 1.5), "order"),
        (lambda: rp.Fourier(3, 1, variables=[3]), "0 to 2"),
        (lambda: rp.Fourier(3, 1, period=-1), "period .* above 0"),
        (lambda: rp.Fourier(3, 1, period=[1.0, 2.0]), "period"),
        (lambda: rp.Fourier(30, 9), "use a lower order"),
    ],
)
def test_bad_input_gets_one_clear_line(make, message: str) -> None:
    with pytest.raises(rp.InputError, match=message) as error:
        make()
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("period", [5e-324, 1e-300, [6.0, 6.0, 1e-13]])
def test_a_period_below_the_rounding_of_a_joint_position_is_refused(period: object) -> None:
    with pytest.raises(rp.InputError, match="period of a Fourier basis must be at least 1e-12"):
        rp.Fourier(3, 1, period=period)
    with pytest.raises(rp.InputError, match="radius of a tube must be at least 1e-12"):
        rp.Tube([[0.3, 0.8, 0.8]], period)
