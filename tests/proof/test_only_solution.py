"""The distance d* within which F is proved to be the only solution: its largest value on a tiny box
against a computation in NumPy, the choice among nested distances, and wrong versions of each term.
"""

from __future__ import annotations

from copy import copy
from functools import cache
from typing import Any

import numpy as np
import pytest
from cell_functions import chart_of, panda
from inside import cell_bounds
from kernels import at, columns, kernels, remainders
from mutants import ONLY

import repctl_pin as rp

MIDDLE = np.array([0.0, -0.2345, 0.0, -2.415, 0.0, 2.18, 0.7853])
"""A configuration of the panda in the middle of a sector."""

AWAY, BESIDE = 0.002, 0.02
"""Distances, rad, of F and of c from q_ref in the middle of the sector."""


@cache
def problem() -> cell_bounds.CellProof:
    """A bent sector of two coordinates whose q_ref is not near F, and whose c is elsewhere."""
    task, shape = panda(), {"radius": ([0.5, 0.01, 0.01], [0.6, -0.01, 0.0, 0.005])}
    place = task.placement(MIDDLE)
    whole = rp.Sector(task, place, **shape, height=0.05, angle=0.1, spin=0.1)
    chart = chart_of(whole.without(whole.symmetries), rp.solve_ik(task, MIDDLE, whole.placement), 3)
    C, way = chart.coefficients.copy(), np.array([1, -1, 1, 1, -1, 1, -1.0])
    n_ref = C[0, :, 1]
    C[0, :, 0] -= AWAY * (way - n_ref * (n_ref @ way) / (n_ref @ n_ref))
    one = cell_bounds.CellProof(cell_bounds.Chart(chart.cell, chart.monomials, C))
    off = BESIDE * np.array([1, 1, -1, 1, -1, -1, 1.0])
    one._correction = cell_bounds._Correction(np.array([-1.0, 1.0]), np.tile(off, (2, 2, 1)))
    one.see_from(one.chain.seen_from(4, 0.5))
    return one


def levels(one: cell_bounds.CellProof, distances: Any) -> int:
    """Which of the nested distances (L, n) is proved on a tiny box around the middle; −1: none."""
    one = copy(one)
    one.distances = np.array(distances, float).reshape(-1, one.task.n)
    one.see_from(one.chain)
    Uc = np.zeros((1, one.cell.k))
    found = one.bounds_from(Uc, Uc + 1e-7, np.zeros((1, one.task.n, 1 + one.cell.k)))
    assert (found.leaf_margin[0] > 0) == (found.level[0] >= 0)
    return int(found.level[0])


def largest(one: cell_bounds.CellProof) -> float:
    """The largest d*, equal for all joints, that is proved on the tiny box."""
    low, high = 2 * AWAY + BESIDE, 0.3
    while high - low > 1e-5:
        middle = (low + high) / 2
        low, high = (middle, high) if levels(one, [middle] * one.task.n) == 0 else (low, middle)
    return low


@cache
def reached(d: float) -> np.ndarray:
    """The bound Y (n,) of ``|F − q_0|`` in C: the smallest d* of each joint, less ``|q_0 − c|``."""
    one, n = problem(), problem().task.n
    Y = np.zeros(n)
    for i in range(n):
        low, high = 0.0, d
        while high - low > 1e-5:
            middle = (low + high) / 2
            there = np.full(n, d)
            there[i] = middle
            low, high = (low, middle) if levels(one, there) == 0 else (middle, high)
        Y[i] = high - BESIDE
    return Y


def radius_of(one: cell_bounds.CellProof, d: float) -> float:
    """The spectral radius of ``D + |A| Λ`` for d*, in NumPy: below 1, F is the only solution."""
    library, chain, chart = kernels(), one.chain, one.chart
    U, n = np.zeros((1, one.cell.k)), one.task.n
    points = chart.solve(U)
    q_0, n_ref = points.q_ref[0], points.n_ref[0]
    Y, beside = reached(0.05), np.abs(one.center(points)[0] - q_0)
    assert (np.abs(points.Q[0] - q_0) <= Y).all() and (Y < 5 * AWAY).all()
    J, dJ = columns(library, chain, chain.S[:, :n] @ q_0 + chain.o)
    A = np.linalg.inv(np.vstack([J.T, n_ref.T]))
    near, reach = d + beside, d + beside + Y
    theta, eta = chain.S[:, :n] @ q_0 + chain.o, np.abs(chain.S[:, :n]) @ near
    linear, angular = remainders(library, chain, theta, eta)
    norms = np.stack([np.linalg.norm(A[:, part], axis=1) for part in (slice(3), slice(3, 6))], 1)
    D = norms[:, :1] * linear + norms[:, 1:] * angular
    mean = Y + reach / 2  # on the straight way to another solution
    D += np.einsum("jic,j->ic", np.abs(A[:, :6] @ np.swapaxes(dJ, 1, 2)), mean)
    made = one._cell
    assert library.two_solutions(cell_bounds.ctypes.byref(made), at(norms), at(reach), at(D))
    return float(np.abs(np.linalg.eigvals(D)).max())


@pytest.mark.slow
def test_the_largest_distance_is_that_of_numpy() -> None:
    d = largest(problem())
    assert d > 2 * BESIDE
    assert abs(radius_of(problem(), d) - 1) < 1e-3


def check_levels(one: cell_bounds.CellProof, d: float) -> bool:
    """Test which of nested distances is taken: the first that is proved, and none without F."""
    n, points = one.task.n, one.chart.solve(np.zeros((1, one.cell.k)))
    too_far, away = [[d + 0.01] * n, [d + 0.005] * n], one.away(points)[0]
    good = levels(one, [*too_far, [d - 1e-3] * n, [d - 2e-3] * n]) == 2
    good &= levels(one, [too_far[0], [d - 1e-3] * n]) == 1
    # F is farther from c than d* in one joint
    for i in range(n):
        short = np.full(n, d - 1e-3)
        short[i] = away[i] - 1e-4
        good &= levels(one, [*too_far, short]) == -1
    return good


def test_the_first_distance_that_is_proved_is_taken() -> None:
    assert check_levels(problem(), largest(problem()))


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("mutant", ONLY)
def test_a_wrong_distance_is_noticed(mutant: str) -> None:
    wrong, right = copy(problem()), largest(problem())
    wrong.use(kernels(*ONLY[mutant]))
    try:
        d = largest(wrong)
        same = abs(radius_of(problem(), d) - 1) < 1e-3 and check_levels(wrong, right)
    except AssertionError:
        same = False
    assert not same
