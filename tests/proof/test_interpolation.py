"""The continuous function c near F, about which F is proved to be the only solution: an
interpolation on a grid, its distance from F's expansions on boxes, and a proof that needs it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from inside import cell_bounds
from scipy.interpolate import RegularGridInterpolator

import repctl_pin as rp


def corrections(k: int) -> cell_bounds._Correction:
    """A correction with random values at the nodes of a grid: (G + 1, …, G + 1, 2)."""
    lines = np.linspace(-1, 1, {1: 33, 2: 9, 3: 5}[k])
    values = np.random.default_rng(k).standard_normal((*[len(lines)] * k, 2))
    return cell_bounds._Correction(lines, values)


@pytest.mark.parametrize("k", [1, 2, 3])
def test_c_is_a_linear_interpolation(k: int) -> None:
    """Oracle: SciPy's interpolation."""
    one = corrections(k)
    U = np.random.default_rng(0).uniform(-1, 1, (500, k))
    U[:50] = np.sign(U[:50])
    right = RegularGridInterpolator([one.lines] * k, one.values)(U)
    np.testing.assert_allclose(one.at(U), right, atol=1e-12)
    assert (np.abs(one.at(U)) <= one.most).all() and one.most.max() == np.abs(one.values).max()


@pytest.mark.parametrize("k", [1, 2, 3])
def test_the_distance_from_c_is_bounded_and_tight(k: int) -> None:
    """Law: no point of 90 boxes of three sizes is farther from c, and the corners come close."""
    one, rng = corrections(k), np.random.default_rng(1)
    half = np.repeat([0.5, 0.1, 0.01], 30)[:, None] * rng.uniform(0.2, 1, (90, k))
    Uc = rng.uniform(half - 1, 1 - half)
    lines = one.lines[rng.integers(1, len(one.lines) - 1, Uc.shape)]
    Uc[::3] = np.clip(lines[::3] - half[::3], half[::3] - 1, 1 - half[::3])  # a side on a line
    start = rng.standard_normal((90, 2, 1 + k))
    bound, most = one.beside(Uc, half, start), np.zeros((90, 2))
    for i in range(90):
        t = rng.uniform(-1, 1, (400, k))
        t[::2] = np.where(rng.uniform(size=t.shape) < 0.5, np.sign(t), t)[::2]
        # the places of the grid's nodes in the box, where a part has its corners
        near = (one.lines[rng.integers(0, len(one.lines), (400, k))] - Uc[i]) / half[i]
        t = np.concatenate([t, np.where(np.abs(near) <= 1, near, np.sign(near))])
        value = start[i, :, 0] + t @ start[i, :, 1:].T - one.at(Uc[i] + half[i] * t)
        most[i] = np.abs(value).max(axis=0)
    assert (most <= bound).all()
    assert (most > 0.7 * bound).mean() > 0.9


def test_with_four_coordinates_and_more_c_is_the_chart_s_polynomial() -> None:
    one = cell_bounds._Correction(np.array([-1.0, 1.0]), np.zeros((2, 2, 2, 2, 3)))
    start = np.random.default_rng(0).standard_normal((5, 3, 5))
    Uc, half = np.zeros((5, 4)), np.full((5, 4), 0.3)
    np.testing.assert_allclose(one.beside(Uc, half, start), np.abs(start).sum(axis=2))
    assert str(one) == "q_ref"


@pytest.mark.slow
def test_a_function_far_from_its_chart_is_proved(monkeypatch: pytest.MonkeyPatch) -> None:
    """55: on ur10's table, F is 0.2 rad from q_ref, where two solutions are near each other.

    The last joint of an axis task is the null space, so other joints of q_ref can be changed, and F
    stays the same: only c makes this chart as good as the right one.
    """
    task = rp.Robot.load("ur10").task("tool0", "axis")
    q = np.array([0.219, -0.978, 2.707, -3.3, 1.5 * np.pi, 0.0])
    cell = rp.Sector(task, task.placement(q), radius=0.02, height=0.1)
    right = rp.nearest_inverse_function(
        rp.Pseudoinverse(task),
        cell,
        posture=q,
        degree=1,
        options=rp.FitOptions(samples=64, held_out=64),
    )
    chart = right.function.chart
    C = chart.coefficients.copy()
    C[0, :5, 0] += 0.15
    C[1:3, :5, 0] -= 0.05
    far = replace(right, function=rp.InverseFunction(replace(chart, coefficients=C)))
    U = chart.cell.sample(256)
    at = far.function.chart.solve(U)
    np.testing.assert_allclose(at.Q, chart.solve(U).Q, atol=1e-9)
    assert np.abs(at.Q - at.q_ref).max() > 0.15
    proof = rp.prove(far)
    assert proof and "interpolation on a grid of 33 × 33 poses" in proof.what, proof.reason
    assert 0 < rp.prove(right).sigma_min < 1.2 * proof.sigma_min
    monkeypatch.setattr(cell_bounds, "_INTERVALS", {})
    assert rp.prove(far).reason == "a box too small to halve is undecided"
