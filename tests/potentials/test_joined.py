"""Fields joined, and potentials of some joints: the same functions as their parts'."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from controls import some

import repctl_pin as rp

CENTER, SCALE = np.array([0.3, -1.0, 2.0, 0.5]), np.array([0.4, 0.8, 0.1, 2.0])


@pytest.fixture
def joined() -> rp.Joined:
    line = rp.Polynomial(CENTER, 1, SCALE, variables=[0, 1])
    return (
        line
        + rp.Polynomial(CENTER, 4, SCALE, variables=[2, 3])
        + rp.Polynomial(CENTER, 7, SCALE, variables=[1])
    )


def some_q(count: int = 5) -> np.ndarray:
    return CENTER + SCALE * np.random.default_rng(0).uniform(-1.1, 1.1, (count, 4))


def test_joining_is_flat_and_keeps_the_order(joined: rp.Joined) -> None:
    assert [part.size for part in joined.parts] == [2, 14, 7] and joined.size == 23
    Q = some_q()
    for table in ("values", "gradients"):
        parts = [getattr(part, table)(Q) for part in joined.parts]
        assert np.array_equal(getattr(joined, table)(Q), np.concatenate(parts, axis=-1))
    other_way = joined.parts[0] + (joined.parts[1] + joined.parts[2])
    assert other_way.parts == joined.parts


def test_a_choice_is_the_weighted_sum_and_its_derivatives(joined: rp.Joined) -> None:
    A = np.random.default_rng(1).normal(size=(joined.size, 2))
    chosen, Q, e = joined.weighted(A), some_q(), 1e-6
    assert np.allclose(chosen.gradients(Q), joined.gradients(Q) @ A, rtol=1e-11, atol=1e-9)
    h = joined.values(Q) @ A
    assert np.allclose(
        [chosen.value(q) - chosen.value(Q[0]) for q in Q], h - h[0], rtol=1e-11, atol=1e-10
    )
    for q in Q:
        V = chosen.gradient(q)
        assert np.allclose(V, joined.gradients(q[None])[0] @ A, rtol=1e-11, atol=1e-9)
        for i, d in enumerate(np.eye(4)):
            assert np.allclose(
                V[i],
                (chosen.value(q + e * d) - chosen.value(q - e * d)) / (2 * e),
                rtol=1e-6,
                atol=1e-5,
            )


def test_a_choice_knows_its_curvature(joined: rp.Joined) -> None:
    A = np.random.default_rng(2).normal(size=(joined.size, 2))
    chosen, e = joined.weighted(A), 1e-6
    for q in some_q(2):
        C = chosen.hessian(q)
        for k, d in enumerate(np.eye(4)):
            slope = (chosen.gradient(q + e * d) - chosen.gradient(q - e * d)) / (2 * e)
            assert np.allclose(C[:, k], slope, rtol=1e-6, atol=1e-6 * np.abs(C).max())


def test_one_joint_alone_takes_a_high_degree() -> None:
    """Degree 20 of one joint is twenty numbers, however many joints the arm has."""
    potentials = rp.Polynomial(np.zeros(7), 20, 1.0, variables=[3])
    chosen = potentials.weighted(np.eye(20)[:, -1:])
    q = np.full(7, 0.9)
    x = np.polynomial.legendre.Legendre.basis(20)
    assert chosen.value(q)[0] == pytest.approx(np.sqrt(41) * x(0.9), rel=1e-8)
    assert chosen.gradient(q)[3, 0] == pytest.approx(np.sqrt(41) * x.deriv()(0.9), rel=1e-8)
    assert np.count_nonzero(chosen.gradient(q)) == 1


def test_a_repeatable_inverse_of_a_joined_field_is_repeatable() -> None:
    task = rp.Robot.load("ppr").task("tool", "xy")
    potentials = rp.Polynomial(np.zeros(3), 1, variables=[0, 1]) + rp.Polynomial(
        np.zeros(3), 3, variables=[2]
    )
    inverse = rp.RepeatableInverse(task, potentials.weighted([[0.1], [0.2], [-1.0], [0.1], [0.05]]))
    verdict = rp.is_repeatable(inverse, rp.Box(np.zeros(3), 0.4))
    assert verdict and verdict.exact and verdict.defect < 1e-12


@pytest.mark.parametrize(
    "make, message",
    [
        (lambda f: rp.Joined(), "at least one"),
        (lambda f: f + 3, "inherits from repctl_pin.potentials.PotentialBasis"),
        (lambda f: (f + f).weighted(np.zeros((3, 1))), "coefficients .*8, r"),
    ],
)
def test_bad_input_gets_one_clear_line(make, message: str) -> None:
    with pytest.raises(rp.InputError, match=message) as error:
        make(rp.Polynomial(CENTER, 1, SCALE))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("samples", some([32, 64], 32))
def test_nearly_dependent_potentials_on_few_nodes_still_give_an_inverse(samples: int) -> None:
    """Over a small box sines are close to cubics: the rounding of the Gauss–Newton matrix is then
    large."""
    task = rp.Robot.load("planar4r").task(kind="xy")
    q0 = task.reference
    potentials, box = rp.Polynomial(q0, 3, 0.2) + rp.Fourier(task.n, 1), rp.Box(q0, 0.2)
    design = rp.nearest_repeatable(
        rp.Pseudoinverse(task),
        potentials,
        box,
        options=rp.FitOptions(samples=samples, held_out=256),
    )
    plain = rp.nearest_repeatable(
        rp.Pseudoinverse(task),
        None,
        box,
        degree=1,
        options=rp.FitOptions(samples=256, held_out=256),
    )
    assert design.cost < plain.cost
    assert np.allclose(task.jacobian(q0) @ design.inverse(q0), np.eye(task.m), atol=1e-9)


@pytest.mark.slow
def test_the_leaf_margin_of_a_fit_with_few_nodes_is_that_of_all_corners() -> None:
    """Issue 37, item 22: no corner of Ω and no held-out node has a smaller one than is reported.

    A law for every seed, however few the nodes: the search begins at all of them.
    """
    task = rp.Robot.load("planar4r").task(kind="xy")
    box = rp.Box(task.reference, 0.4)
    potentials = rp.Polynomial(box.center, 3, 0.2) + rp.Fourier(task.n, 1)
    corners = box.center + 0.4 * np.array(list(product([-1, 1], repeat=task.n)))
    made = 0
    for seed in range(6):
        options = rp.FitOptions(samples=32, held_out=64, seed=seed)
        try:
            design = rp.nearest_repeatable(rp.Pseudoinverse(task), potentials, box, options=options)
        except rp.SingularityError:
            continue
        made += 1
        Q = np.vstack(
            [corners, design.leaf_margin_at]
            + [box.random(2, 32 * (seed + 1) + k) for k in range(32)]
        )
        V = design.inverse.potentials.gradients(Q)
        N = [rp.redundancy.nullspace(task.jacobian(q)) for q in Q]
        margins = [rp.redundancy.leaf_margin(n, v) for n, v in zip(N, V, strict=True)]
        assert np.isclose(min(margins), design.leaf_margin, rtol=1e-9)
    assert made >= 3
