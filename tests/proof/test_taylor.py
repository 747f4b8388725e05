"""Taylor models: each bound holds, is attained where a single term is left out, and a wrong one is
noticed; and what is made of them for a cell holds in Arb's ball arithmetic."""

from __future__ import annotations

from dataclasses import replace
from types import ModuleType

import numpy as np
import pytest
from cell_functions import cell_of, chart_of
from mutants import TAYLOR, wrong
from second_order import monomials

from repctl_pin.extensions.proof import cells, chart_bounds, taylor

T = np.linspace(-1, 1, 201)[:, None]
MIDDLE = np.array([0.0, -0.2345, 0.0, -2.415, 0.0, 2.18, 0.7853])
"""A configuration of the panda in the middle of its cells."""


def power(
    module: ModuleType, degree: int, size: float, middle: float = 0.0, r: float = 0.0
):
    """The model of ``middle + size t^degree``, one variable, and of what differs from it by r."""
    P = np.zeros((1, 4))
    P[0, 0] = middle
    P[0, degree] += size
    return module.TaylorModel(1, P, np.array([r])), middle + size * T[
        :, 0
    ] ** degree + r


def off(model: object, true: np.ndarray) -> float:
    """The largest ratio of an actual difference to the bound."""
    values = monomials(T) @ model.P[0]
    return float(np.abs(true - values).max() / model.r[0])


def ratios(module: ModuleType) -> list[float]:
    """Ratios of products, sums and functions whose bounds are attained, or nearly so."""
    found = []
    for i in range(4):
        for j in range(4):
            a, f = power(module, i, 0.7)
            b, g = power(module, j, 0.3)
            if i + j > 3:
                found.append(off(a * b, f * g))
            a, f = power(module, i, 0.7, 0.0, 0.1)
            found.append(off(a * b, f * g))
            found.append(off(b * a, f * g))
            found.append(off(a + b, f + g))
            found.append(off(b + a, f + g))
            found.append(off(a - b, f - g))
            b, g = power(module, j, 0.3, 0.0, 0.2)
            found.append(off(a * b, f * g))
            found.append(off(a.scaled(-3.0), -3 * f))
    for middle in (0.0, 0.8, np.pi / 2, 3.0):
        a, f = power(module, 1, 0.05, middle)
        s, c = a.sine_cosine()
        found += [off(s, np.sin(f)), off(c, np.cos(f))]
    for middle, size in ((0.021, 0.02), (0.8, 0.3), (8.0, 1.5)):
        z, f = power(module, 1, size, middle)
        w = np.sqrt(f)
        for model, true in zip(
            z.exponential(),
            (np.cos(w), np.sin(w) / w, (1 - np.cos(w)) / f),
            strict=True,
        ):
            found.append(off(model, true))
    P = np.array([[[0.1, 0.2, 0.0, 0.0], [0.3, 0.0, 0.1, 0.0]]])
    x = module.TaylorModel(1, P, np.array([[0.1, 0.2]]))
    A = np.array([[[2.0, -1.0]]])
    y = x.combined(A)
    true = monomials(T) @ (A[0] @ P[0]).T
    found.append(float(np.abs(true[:, 0] + 0.4 - (monomials(T) @ y.P[0, 0])).max()))
    found[-1] /= float(y.r[0, 0])
    return found


def test_every_bound_of_a_taylor_model_is_attained() -> None:
    found = ratios(taylor)
    assert max(found) <= 1 + 1e-9
    assert np.sort(found)[len(found) // 10] > 0.5


@pytest.mark.parametrize("mutant", TAYLOR)
def test_a_wrong_taylor_model_is_noticed(
    mutant: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    module = wrong(monkeypatch, "taylor.py", *TAYLOR[mutant])
    assert max(ratios(module)) > 1 + 1e-6


@pytest.mark.parametrize("factor", [1.0, 0.9])
def test_a_chart_of_degree_4_leaves_out_what_is_bounded(factor: float) -> None:
    chart = chart_of(cell_of(), MIDDLE, 4)
    C = np.zeros_like(chart.coefficients)
    C[(chart.monomials.exponents == [3, 1, 0]).all(axis=1)] = 1.0
    chart, half = replace(chart, coefficients=C), np.array([[0.4, 0.5, 0.1]])
    parts = chart_bounds.Polynomials.of(chart)
    values = np.tensordot(monomials(half)[0], parts.parts[0, :, 0, 0], axes=1)
    rest = np.prod(half**parts.fourth, axis=1) @ parts.rest[:, 0, 0]
    q, _ = chart.reference(half)
    used = float(q[0, 0] - values) / (factor * rest)
    assert (used <= 1) == (factor == 1.0) and used > 0.99


@pytest.mark.parametrize("count", [6, pytest.param(200, marks=pytest.mark.slow)])
def test_a_cell_s_function_and_gradients_hold_in_ball_arithmetic(count: int) -> None:
    """A corner of random boxes of a cell of poses, down to the size of rounding."""
    pytest.importorskip("flint")
    from arb_closure import arb, function_in_balls

    chart = chart_of(cell_of(rotation=0.2, half_width=0.05), MIDDLE)
    problem = cells.CellProof(chart)
    rng, k = np.random.default_rng(0), 6
    Uc = rng.uniform(-0.7, 0.7, (count, k))
    h = 10.0 ** rng.uniform(-7, -1, (count, 1)) * rng.uniform(0.2, 1, (count, k))
    t = np.sign(rng.standard_normal((count, k)))
    V = np.full((count, 1, 7, 2 + k), np.nan)
    found = problem.bounds_from(Uc, h, problem.start(Uc, h), V)
    assert (found.leaf_margin > 0).all()
    starts = chart.solve(Uc + h * t, np.zeros((count, 1))).Q
    for i in range(count):
        u = [
            arb(float(a)) + arb(float(b)) * arb(float(c))
            for a, b, c in zip(Uc[i], h[i], t[i], strict=True)
        ]
        q, gradient = function_in_balls(problem, u, starts[i])
        for j in range(7):
            away = abs(q[j] - arb(float(found.Q[i, j])))
            assert away <= arb(float(found.reach[i, j]))
            off = gradient[j] - float_sum(V[i, 0, j, :-1], np.append(1.0, t[i]))
            assert abs(off) <= arb(float(V[i, 0, j, -1]))


def float_sum(P: np.ndarray, T: np.ndarray) -> object:
    from flint import arb

    return sum(
        (arb(float(c)) * arb(float(x)) for c, x in zip(P, T, strict=True)), arb(0)
    )
