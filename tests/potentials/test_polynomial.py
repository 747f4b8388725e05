"""Polynomial potentials: gradients, orthonormality, restriction, and the dense form."""

from __future__ import annotations

import math

import numpy as np
import pytest

import repctl_pin as rp

CENTER, SCALE = np.array([0.3, -1.0, 2.0, 0.5]), np.array([0.4, 0.8, 0.1, 2.0])


@pytest.fixture(params=[1, 2, 3, 4])
def potentials(request: pytest.FixtureRequest) -> rp.Polynomial:
    return rp.Polynomial(CENTER, request.param, SCALE)


def some_q(count: int = 6) -> np.ndarray:
    return CENTER + SCALE * np.random.default_rng(0).uniform(-1.2, 1.2, (count, 4))


def test_all_monomials_up_to_the_degree_are_there(potentials: rp.Polynomial) -> None:
    assert potentials.size == math.comb(4 + potentials.degree, 4) - 1
    Q = some_q(200)
    u = (Q - CENTER) / SCALE
    rng = np.random.default_rng(1)
    power = rng.multinomial(potentials.degree, np.ones(4) / 4)
    basis = np.column_stack([np.ones(200), potentials.values(Q)])
    residual = np.linalg.lstsq(basis, np.prod(u**power, axis=1))[1]
    assert residual.size == 1 and residual[0] < 1e-20


def test_gradients_agree_with_finite_differences(potentials: rp.Polynomial) -> None:
    Q, e = some_q(), 1e-6
    D = potentials.gradients(Q)
    for i, d in enumerate(np.eye(4)):
        slope = (potentials.values(Q + e * d) - potentials.values(Q - e * d)) / (2 * e)
        assert np.allclose(D[:, i], slope, rtol=1e-7, atol=1e-6)


def test_basis_is_orthonormal_on_its_box(potentials: rp.Polynomial) -> None:
    x, w = np.polynomial.legendre.leggauss(6)
    U = np.stack(np.meshgrid(x, x, x, x, indexing="ij"), -1).reshape(-1, 4)
    W = np.prod(np.stack(np.meshgrid(w, w, w, w, indexing="ij"), -1).reshape(-1, 4) / 2, axis=1)
    H = potentials.values(CENTER + SCALE * U)
    assert np.allclose(H.T @ (W[:, None] * H), np.eye(potentials.size), atol=1e-12)


def test_restriction_to_variables(potentials: rp.Polynomial) -> None:
    part = rp.Polynomial(CENTER, potentials.degree, SCALE, variables=[2])
    assert part.size == potentials.degree
    D = part.gradients(some_q())
    assert np.abs(D[:, [0, 1, 3]]).max() == 0 and np.abs(D[:, 2]).min() > 0


def test_weighted_sum_is_the_sum_of_the_basis(potentials: rp.Polynomial) -> None:
    A = np.random.default_rng(2).normal(size=(potentials.size, 3))
    chosen = potentials.weighted(A)
    Q = some_q()
    constant = chosen.value(CENTER) - (potentials.values(CENTER[None]) @ A)[0]
    for q in Q:
        assert np.allclose(
            chosen.gradient(q), potentials.gradients(q[None])[0] @ A, rtol=1e-11, atol=1e-10
        )
        assert np.allclose(
            chosen.value(q) - constant, potentials.values(q[None])[0] @ A, rtol=1e-11, atol=1e-11
        )
    assert np.allclose(chosen.gradients(Q), potentials.gradients(Q) @ A, rtol=1e-11, atol=1e-10)


@pytest.mark.parametrize(
    "make, message",
    [
        (lambda: rp.Polynomial([0.0, np.nan], 2), "finite"),
        (lambda: rp.Polynomial([0.0, 1.0], 0), "degree"),
        (lambda: rp.Polynomial([0.0, 1.0], 2.5), "degree"),
        (lambda: rp.Polynomial([0.0, 1.0], 2, -1.0), "scale .* above 0"),
        (lambda: rp.Polynomial([0.0, 1.0], 2, [1.0, 1.0, 1.0]), "scale"),
        (lambda: rp.Polynomial([0.0, 1.0], 2, variables=[2]), "0 to 1"),
        (lambda: rp.Polynomial(np.zeros(30), 6), "use a lower degree"),
    ],
)
def test_bad_input_gets_one_clear_line(make, message: str) -> None:
    with pytest.raises(rp.InputError, match=message) as error:
        make()
    assert "\n" not in str(error.value)


def test_too_many_potentials_are_counted_in_the_refusal() -> None:
    """C(7 + 9, 9) − 1: the constant is no potential."""
    with pytest.raises(rp.InputError, match="degree 9 in 7 joints have 11439 potentials"):
        rp.Polynomial(np.zeros(7), 9)
