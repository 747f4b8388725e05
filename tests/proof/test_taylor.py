"""Taylor models: each bound holds, is attained where a single term is left out, and a wrong one is
noticed; and what is made of them for a cell holds in Arb's ball arithmetic."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass, replace

import numpy as np
import pytest
from cell_functions import cell_of, chart_of
from inside import cell_bounds, taylor
from kernels import at, kernels
from mutants import TAYLOR
from second_order import monomials

T = np.linspace(-1, 1, 201)
MIDDLE = np.array([0.0, -0.2345, 0.0, -2.415, 0.0, 2.18, 0.7853])
"""A configuration of the panda in the middle of its cells."""


ADD, PRODUCT, SINE_COSINE, EXPONENTIAL, POWER, SCALE, SUM = range(7)


@dataclass
class Model:
    """A Taylor model of one variable in C: four coefficients and a bound; and the true function's
    values at T."""

    library: ctypes.CDLL
    x: np.ndarray
    true: np.ndarray

    def operate(self, what: int, other: Model, s: float = 1.0) -> list[np.ndarray]:
        space = taylor.space_of(1)
        out = np.zeros((4, 5))
        arrays = at(self.x), at(other.x), at(out)
        self.library.operate(ctypes.byref(space), what, ctypes.c_double(s), *arrays)
        return list(out)

    def off(self, what: int, *true: np.ndarray, s: float = 1.0, y: Model | None = None):
        """The largest ratios of actual differences of results to their bounds."""
        return [
            off(found, one)
            for found, one in zip(self.operate(what, y or self, s), true, strict=False)
        ]


def off(model: np.ndarray, true: np.ndarray) -> float:
    return float(np.abs(true - monomials(T) @ model[:4]).max() / model[4])


def power(
    library: ctypes.CDLL, degree: int, size: float, middle: float = 0.0, r: float = 0.0
) -> Model:
    """The model of ``middle + size t^degree``, and of what differs from it by r."""
    x = np.array([middle, 0.0, 0.0, 0.0, r])
    x[degree] += size
    return Model(library, x, middle + size * T**degree + r)


def ratios(library: ctypes.CDLL) -> list[float]:
    """Ratios of products, sums and functions whose bounds are attained, or nearly so."""
    found: list[float] = []
    for i in range(4):
        for j in range(4):
            a, b = power(library, i, 0.7), power(library, j, 0.3)
            if i + j > 3:
                found += a.off(PRODUCT, a.true * b.true, y=b)
            a = power(library, i, 0.7, 0.0, 0.1)
            found += a.off(PRODUCT, a.true * b.true, y=b)
            found += b.off(PRODUCT, a.true * b.true, y=a)
            found += a.off(ADD, a.true + b.true, y=b)
            found += b.off(ADD, a.true + b.true, y=a)
            found += a.off(ADD, a.true - b.true, y=b, s=-1.0)
            b = power(library, j, 0.3, 0.0, 0.2)
            found += a.off(PRODUCT, a.true * b.true, y=b)
            found += a.off(SCALE, -3 * a.true, s=-3.0)
            b = replace(b, true=b.true - 0.4)  # what differs by r the other way
            found += a.off(SUM, 2 * a.true - b.true + 0.5 * a.true, y=b, s=0.5)
    for middle in (0.0, 0.8, np.pi / 2, 3.0):
        a = power(library, 1, 0.05, middle)
        found += a.off(SINE_COSINE, np.sin(a.true), np.cos(a.true))
    for middle, size in ((0.021, 0.02), (0.8, 0.3), (8.0, 1.5)):
        z = power(library, 1, size, middle)
        w = np.sqrt(z.true)
        s = np.sin(w) / w
        found += z.off(EXPONENTIAL, np.cos(w), s, (1 - np.cos(w)) / w**2, (1 - s) / w**2)
    rng = np.random.default_rng(0)
    for s in (0.5, -0.5, -1.0):
        for middle in rng.uniform(0.1, 3, 20):
            x = power(library, 1, middle * rng.uniform(0.03, 0.95), middle)
            found += x.off(POWER, x.true**s, s=s)
    return found


def test_every_bound_of_a_taylor_model_is_attained() -> None:
    found = ratios(kernels())
    assert max(found) <= 1 + 1e-6
    assert np.median(found) > 0.9
    x = power(kernels(), 1, 1.1, 1.0)
    assert x.operate(POWER, x, -1.0)[0][[0, 4]].tolist() == [1.0, np.inf]


@pytest.mark.slow
@pytest.mark.parametrize(
    "mutant", [pytest.param(m, marks=[pytest.mark.slow] if i else []) for i, m in enumerate(TAYLOR)]
)
def test_a_wrong_taylor_model_is_noticed(mutant: str) -> None:
    assert max(ratios(kernels("taylor.h", *TAYLOR[mutant]))) > 1 + 1e-5


@pytest.mark.parametrize("factor", [1.0, 0.9])
def test_a_chart_of_degree_4_leaves_out_what_is_bounded(factor: float) -> None:
    chart = chart_of(cell_of(), MIDDLE, 4)
    C = np.zeros_like(chart.coefficients)
    C[(chart.monomials.exponents == [3, 1, 0]).all(axis=1)] = 1.0
    chart, half = replace(chart, coefficients=C), np.array([[0.4, 0.5, 0.1]])
    parts = cell_bounds._Polynomials.of(chart)
    cubic = chart.monomials.values(half)[0, : parts.parts.shape[1]]
    values = cubic @ parts.parts[0, :, 0, 0]
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
    problem = cell_bounds.CellProof(chart)
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

    return sum((arb(float(c)) * arb(float(x)) for c, x in zip(P, T, strict=True)), arb(0))
