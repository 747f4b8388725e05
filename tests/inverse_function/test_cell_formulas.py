"""Formulas of a cell's design that no public name states alone: the cost and its derivatives, the
penalties, the searches for poses and postures. Only this file imports them."""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from itertools import combinations, pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from arms import Q_PANDA, chain_with_bodies, planar_task, planar_urdf
from cell_functions import cell_of, chart_of, middle, panda, reach
from sectors import found as sector_design

import repctl_pin as rp
from repctl_pin.extensions.cells.evaluate import margins, symmetric_coordinates
from repctl_pin.extensions.cells.evaluate.cell_evaluation import evaluate_cell
from repctl_pin.extensions.cells.fit.cell_fit import CellFit
from repctl_pin.extensions.cells.fit.cost import Cost, Penalty, descend, predicted_gain
from repctl_pin.extensions.cells.fit.penalty import ActiveConstraint, PenaltyMethod
from repctl_pin.extensions.cells.geometry import kinematics
from repctl_pin.extensions.cells.place.posture_search import Candidate, chosen, judged, searched

cell_fit = sys.modules[CellFit.__module__]
"""The module of fits, whose steps are tested one by one."""


@pytest.mark.parametrize("n, columns", [(1, 1), (7, 7), (9, 2)])
def test_linear_equations_are_solved_beside_singular_ones(n: int, columns: int) -> None:
    """The first pivot of one matrix is 0, which is no singularity; another has two equal rows."""
    rng = np.random.default_rng(n)
    A, b = rng.normal(size=(20, n, n)), rng.normal(size=(20, n, columns))
    if n > 1:
        A[3, 0, 0] = 0.0
    A[5, n - 1] = A[5, 0] if n > 1 else 0.0
    good = np.arange(20) != 5
    given = A.copy(), b.copy()
    x = kinematics.solved(A, b)
    assert np.isnan(x[5]).all() and np.array_equal(A, given[0]) and np.array_equal(b, given[1])
    np.testing.assert_allclose(x[good], np.linalg.solve(A[good], b[good]), rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(kinematics.solved(A, b[..., 0]), x[..., 0])


@pytest.mark.parametrize("kind", ["pose", "axis", "position"])
def test_gradient_of_the_cost_against_finite_differences(kind: str) -> None:
    """With the joint limits, the bodies and σ_min in it, each below what is asked for somewhere."""
    cell = cell_of(kind, 0.2 if kind != "position" else 0.0, 0.08)
    chart = chart_of(cell, rp.solve_ik(cell.task, Q_PANDA, cell.placement), degree=2, count=64)
    terms, edge = chart.monomials, 0.9 * cell.sample(8, 5)
    rng = np.random.default_rng(0)
    asked_for = [
        (margins.limits_of(cell.task), 0.75),
        (margins.distances_of(cell.task), 0.2),
        (margins.singular_values_of(cell.task), 1.0),
    ]
    for parts, exact in [(asked_for[:1], 1e-5), (asked_for, 1e-3)]:
        kept = [Penalty(margin, edge, np.full(len(edge), asked)) for margin, asked in parts]
        cost = Cost(rp.Pseudoinverse(cell.task), chart, terms, cell.sample(16), kept, weight=3.0)
        a = 0.03 * rng.normal(size=(terms.size, cell.task.r))
        value = cost.value(a)
        gradient, H = cost.model(value)
        E, G_d = (
            cell.twists(cost.U, value.points.R)[:16],
            rp.Pseudoinverse(cell.task).batch(value.points.Q[:16]),
        )
        wanted = G_d @ E @ cell.speeds(cost.U[:16])
        assert value.desired_square == pytest.approx(
            np.mean(np.sum(wanted**2, axis=(1, 2))), rel=1e-12
        )
        assert all(
            (part.margin.measure(value.points.Q[16:24]) < part.asked[:, None]).any()
            for part in kept
        )
        for _ in range(3):
            v = rng.normal(size=a.shape)
            slope = (cost.value(a + 1e-5 * v).cost - cost.value(a - 1e-5 * v).cost) / 2e-5
            assert gradient @ v.ravel() == pytest.approx(slope, rel=exact)
        assert np.linalg.eigvalsh(H).min() > -1e-9 * np.linalg.eigvalsh(H).max()


@pytest.mark.parametrize(("kind", "count"), [("pose", 40), ("position", 80)])
def test_the_matrix_of_the_cost_is_exact_where_the_cost_vanishes(kind: str, count: int) -> None:
    """If G_d is the derivative of the function itself, then the cost is ½ aᵀ H a near it, and a
    step of Gauss and Newton lowers it to 0."""
    cell = cell_of(kind, half_width=0.08)
    q = rp.solve_ik(cell.task, Q_PANDA, cell.placement)
    chart = chart_of(cell, q, 2, 64)
    terms = chart_of(cell, q, 1, 64).monomials
    desired = rp.InverseFunction(chart).inverse
    cost = Cost(desired, chart, terms, cell.sample(count))
    zero, rng = np.zeros((terms.size, cell.task.r)), np.random.default_rng(0)
    value = cost.value(zero)
    assert value.cost < 1e-18
    _, H = cost.model(value)
    v, w = 3e-4 * rng.normal(size=(2, *zero.shape))
    ends = {i: sum(cost.value(s * (v + i * w)).cost for s in (1, -1)) for i in (1, -1)}
    sum_, difference = ((v + i * w).ravel() for i in (1, -1))
    assert ends[1] == pytest.approx(sum_ @ H @ sum_, rel=1e-4)
    mixed = (ends[1] - ends[-1]) / 4  # vᵀ H w, in which the blocks of different labels meet
    assert mixed == pytest.approx(v.ravel() @ H @ w.ravel(), rel=1e-2)
    assert difference @ H @ difference == pytest.approx(ends[-1], rel=1e-4)
    assert predicted_gain(cost, v) == pytest.approx(1, rel=1e-2)


def test_a_penalty_counts_where_its_margin_is_missed() -> None:
    """Each kind with the mean over its own poses, times the weight. Where the margin is met, where
    there is no pose and where there is no weight, the cost and its derivatives are the same."""
    cell = cell_of()
    q = rp.solve_ik(cell.task, Q_PANDA, cell.placement)
    chart, limits = chart_of(cell, q, 1, 32), margins.limits_of(cell.task)
    U, edge, desired = cell.sample(8), cell.sample(5, 5), rp.Pseudoinverse(cell.task)
    terms = chart.monomials
    a = 0.02 * np.random.default_rng(0).normal(size=(terms.size, 1))

    def of(*kept: Penalty, **weight: float) -> tuple:
        cost = Cost(desired, chart, terms, U, kept, **weight)
        value = cost.value(a)
        return value, *cost.model(value)

    missed = Penalty(limits, edge, np.linspace(0.5, 2.0, 5))
    met, nowhere = (Penalty(limits, edge, np.full(5, -9.0)), Penalty(limits, edge[:0], []))
    free, gradient, H = of()
    for other in (of(met, nowhere, weight=3.0), of(missed, weight=0.0), of(missed)):
        assert other[0].cost == other[0].nearness == pytest.approx(free.cost, rel=1e-12)
        assert np.allclose(other[1], gradient, rtol=0, atol=1e-12 * abs(gradient).max())
        assert np.allclose(other[2], H, rtol=0, atol=1e-9 * abs(H).max())
    Q = margins.CandidateFunction(chart, terms, a).at(edge).Q
    kept = np.minimum(Q - cell.task.lower, cell.task.upper - Q)
    short = np.maximum(0, np.linspace(0.5, 2.0, 5)[:, None] - kept)
    due = free.cost + 3.0 * (short**2).sum() / 5
    with_three = of(missed, nowhere, met, weight=3.0)[0]
    assert with_three.cost == pytest.approx(due, rel=1e-9)
    assert with_three.nearness == pytest.approx(free.cost, rel=1e-12)


def test_a_cost_is_infinite_where_the_function_is_missing_at_one_node(tmp_path: Path) -> None:
    """Labels that grow along the cell until no configuration has them; at 0 again, the cost is
    what it was, although the search for the nodes began at the other configurations."""
    task = planar_task([1.0, 0.9, 0.8], tmp_path)
    q = np.array([0.6, -1.2, 1.4])
    cell = rp.Cell(task, task.placement(q), 0.2)
    chart = chart_of(cell, q, 2, 32)
    terms, U = chart_of(cell, q, 1, 32).monomials, cell.sample(16)
    cost = Cost(rp.Pseudoinverse(task), chart, terms, U)
    zero = np.zeros((3, 1))
    once, missing, costs = cost.value(zero).cost, [], []
    for size in np.linspace(0, 6, 25):
        a = zero + size * (terms.exponents[:, :1] == 1)
        found = margins.CandidateFunction(chart, terms, a).at(U).found
        missing.append(1 - found.mean())
        costs.append(cost.value(a).cost)
        assert np.isfinite(costs[-1]) == found.all()
        assert np.isinf(predicted_gain(cost, a)) == (not found.all())
        assert cost.value(zero).cost == pytest.approx(once, rel=1e-6)
    assert any(0 < share < 1 for share in missing)


def test_a_coefficient_that_no_node_shows_stays_as_it_is() -> None:
    """The square of a coordinate that is 0 at all nodes is 0 there, and so is its slope."""
    cell = cell_of(half_width=0.15)
    q = rp.solve_ik(cell.task, Q_PANDA, cell.placement)
    chart = chart_of(cell, q, 2, 32)
    U = cell.sample(32) * [0, 1, 1]
    cost = Cost(rp.Pseudoinverse(cell.task), chart, chart.monomials, U)
    a = np.full((chart.monomials.size, 1), 0.01)
    found = descend(cost, a)
    unseen = chart.monomials.exponents[:, 0] == 2
    assert found.steps > 1 and found.value.nearness < cost.value(a).nearness - 1e-9
    assert (np.abs(found.a - a)[unseen] < 1e-9).all() and unseen.sum() == 1


@pytest.mark.slow
def test_no_section_beats_the_optimum_and_more_terms_help() -> None:
    cell = rp.Cell(panda(), middle(), (0.15, 0.3, 0.2))
    q = rp.solve_ik(cell.task, Q_PANDA, cell.placement)
    chart, desired, U = chart_of(cell, q), rp.Pseudoinverse(cell.task), cell.sample(128)
    costs = []
    for degree in (0, 1, 2, 3):
        terms = chart_of(cell, q, degree).monomials
        costs.append(descend(Cost(desired, chart, terms, U), np.zeros((terms.size, 1))))
    assert all(b.value.cost < a.value.cost * 1.0001 for a, b in pairwise(costs))
    assert costs[-1].value.cost < 0.8 * costs[0].value.cost
    rng = np.random.default_rng(1)
    for _ in range(3):  # a random start elsewhere comes to the same
        again = descend(Cost(desired, chart, terms, U), 0.1 * rng.normal(size=(terms.size, 1)))
        assert again.value.cost == pytest.approx(costs[-1].value.cost, rel=0.02)


def straight(
    G_d: rp.Pseudoinverse, cell: rp.Cell, q: np.ndarray, U: np.ndarray, steps: int = 10
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Steps of G_d along points of the ray to each pose, and three at its end, until the arm is
    almost singular or a step is long: the joints, the least limit margin on the way, and the share
    of the ray."""
    Q, least, reached = [], [], []
    for u in U:
        here, low, share = q.copy(), np.inf, 0.0
        for ahead in [*np.arange(1, steps + 1) / steps, 1.0, 1.0, 1.0]:
            low = min(low, cell.task.limit_margin(here).min())
            s = np.linalg.svd(cell.task.jacobian(here), compute_uv=False)
            step = G_d(here) @ cell.task.error(here, cell.at(ahead * u))
            if s[-1] < 0.01 * s[0] or np.abs(step).max() > 0.5:
                break
            here, share = here + step, ahead
        if np.abs(cell.task.error(here, cell.at(u))).max() > 1e-6:
            share = min(share, 1 - 1 / steps)
        Q.append(here)
        least.append(low)
        reached.append(share)
    return np.array(Q), np.array(least), np.array(reached)


@pytest.mark.parametrize(("half_width", "whole"), [(0.1, True), (0.35, False)])
def test_a_posture_is_judged_by_the_way_to_the_corners(half_width: float, whole: bool) -> None:
    """The share of the corners that are reached, the margin met there and the mean of G_d's own
    speed; all corners of an easy cell are reached."""
    cell, G_d = cell_of(half_width=half_width), rp.Pseudoinverse(panda())
    q = rp.solve_ik(cell.task, Q_PANDA, cell.placement)
    beside = rp.solve_ik(cell.task, q + 0.02, cell.placement)
    (_, candidate), U = judged(G_d, cell, np.array([beside, q])), cell.corners()
    Q, least, reached = straight(G_d, cell, q, U)
    good = reached == 1
    assert candidate.share == good.mean() and good.any() and good.all() == whole
    assert candidate.margin == pytest.approx(least[good].min(), abs=1e-9)
    assert candidate.margin > 0 or not whole
    Q, U = Q[good], U[good]
    R = np.array([cell.task.placement(one).rotation for one in Q])
    squares = [((G_d(one) @ E @ cell.speeds(u[None])[0]) ** 2).sum() for one, E, u in
               zip(Q, cell.twists(U, R), U, strict=True)]  # fmt: skip
    assert candidate.speed == pytest.approx(np.mean(squares), rel=1e-9)
    if whole:
        nearest = rp.Bodies(cell.task).distances(np.concatenate([q[None], Q])).min()
        assert candidate.body_distance == pytest.approx(nearest, abs=1e-9)


@pytest.mark.parametrize(
    ("first", "second", "best"),
    [
        ((0.9, 0.1, 0.1, 1.0), (1.0, -0.1, 0.0, 9.0), 1),  # most corners
        ((1, -0.01, 0.5, 1.0), (1, 0.0, 0.05, 9.0), 1),  # no collision
        ((1, -0.10, 0.5, 1.0), (1, -0.05, 0.1, 1.0), 1),  # the smaller collision
        ((1, -0.06, 0.1, 1.0), (1, -0.05, 0.1, 1.5), 0),  # as small: the quicker
        ((1, 0.1, 0.05, 1.0), (1, 0.1, 0.08, 9.0), 1),  # the larger limit margin
        ((1, 0.1, 0.10, 1.0), (1, 0.1, 0.50, 1.3), 0),  # of enough: the quicker
        ((1, 0.1, 0.09, 1.3), (1, 0.1, 0.10, 1.0), 1),
        ((1, 0.1, 0.09, 1.1), (1, 0.1, 0.10, 1.0), 0),  # as quick: the nearer
    ],
)
def test_the_best_posture_is_chosen_in_this_order(first: tuple, second: tuple, best: int) -> None:
    """Share of the corners, collisions, limit margin, joint speed, distance from the reference."""
    reference = np.full(7, 2.0)
    near, far = reference + 0.1, reference - 0.5
    two = [
        Candidate(q, share, margin, body_distance, speed)
        for q, (share, body_distance, margin, speed) in ((near, first), (far, second))
    ]
    for candidates in (two, two[::-1]):
        assert chosen(candidates, reference) is two[best]


@pytest.mark.parametrize(
    ("constant", "slope"), [(0.07, 0.0), (0.03, 0.0), (0.1, 0.3), (-0.2, 0.12)]
)
def test_poses_with_a_leaf_margin_below_a_twentieth_are_not_covered(
    constant: float, slope: float
) -> None:
    """n_ref is turned out of the null space until σ_min(Nᵀ n̂_ref) is as given: linear in a
    coordinate, through 0, where the function folds. The other side of the fold is not covered."""
    cell = cell_of(half_width=0.001)
    q = rp.solve_ik(cell.task, Q_PANDA, cell.placement)
    chart = chart_of(cell, q, 1, 32)
    row = cell.task.jacobian(q)[0] / np.linalg.norm(cell.task.jacobian(q)[0])
    along = chart.monomials.exponents[:, 0] == 1
    coefficients = chart.coefficients.copy()
    coefficients[:, :, 1] = slope * along[:, None] * chart.coefficients[0, :, 1]
    coefficients[0, :, 1] = row + constant * chart.coefficients[0, :, 1]
    tilted = replace(chart, coefficients=coefficients)
    j = evaluate_cell(rp.Pseudoinverse(cell.task), tilted, 64, 1, quick=True)

    def margin(u: np.ndarray) -> np.ndarray:
        """Sign as in the middle; ‖n_ref‖ is next to 1."""
        return np.sign(constant) * (constant + slope * u)

    U = cell.sample(64, 1)
    covered = margin(U[:, 0]) > 0.05
    assert j.coverage == covered.mean()
    if covered.all():
        assert not j.failures
        return
    every = margin(np.concatenate([U, cell.corners()])[:, 0]) > 0.05
    stops = {stop.cause: stop for stop in j.failures}
    assert sum(stop.share for stop in stops.values()) == pytest.approx(1 - every.mean())
    assert margin(stops["fold"].u[0]) <= 0.05 and "the function folds" in str(stops["fold"])
    if covered.any():
        whole = evaluate_cell(rp.Pseudoinverse(cell.task), tilted, 64, 1, quick=False)
        assert 0.9 < whole.leaf_margin <= 1  # of V, which is not turned as n_ref is


def test_the_share_of_a_required_body_distance_counts_all_nearer_poses() -> None:
    """Bodies that come nearer than is required, without a collision, fail as well."""
    task = rp.Robot.load("xarm7").task("link_eef", "pose")
    q = np.array([0.0, -0.5, 0.3, 1.0, 0.2, 1.2, 0.0])
    cell, G_d = rp.Cell(task, task.placement(q), 0.05), rp.Pseudoinverse(task)
    chart = chart_of(cell, q, 1, 32)
    U = np.concatenate([cell.sample(64, 1), cell.corners()])
    distances = rp.Bodies(task).distances(rp.InverseFunction(chart).batch(U))
    required = float(np.median(distances))
    assert distances.min() > 0
    j = evaluate_cell(G_d, chart, 64, 1, quick=True, required=required)
    (stop,) = (stop for stop in j.failures if stop.cause == "collision")
    assert stop.share == pytest.approx((distances < required).mean()) and "come to" in stop.what


def test_extra_speeds_are_relative_to_the_desired_inverse(tmp_path: Path) -> None:
    """Below 0 everywhere relative to an inverse with far more joint speed than J⁺. The figures are
    means over the covered poses; a limit that the third joint exceeds at some has their share."""
    task = planar_task([1.0, 0.9, 0.8], tmp_path)
    q = np.array([0.6, -1.2, 1.4])
    free = chart_of(rp.Cell(task, task.placement(q), 0.2), q, 4, 64)
    U = np.concatenate([free.cell.sample(64, 1), free.cell.corners()])
    third = rp.InverseFunction(free).batch(U)[:, 2]
    bound = float(np.quantile(third, 0.8))
    text = (tmp_path / "planar3.urdf").read_text().split('name="theta3"')
    text[1] = text[1].replace('upper="7.0"', f'upper="{bound}"', 1)
    (tmp_path / "bound.urdf").write_text('name="theta3"'.join(text))
    task = rp.Robot.load(tmp_path / "bound.urdf").task("tool", "xy")
    chart = replace(free, cell=rp.Cell(task, free.cell.placement, 0.2))
    G_d, F = rp.WeightedInverse(task, [9, 1, 0.1]), rp.InverseFunction(chart)
    j = evaluate_cell(G_d, chart, 64, 1, quick=False)
    (stop,) = j.failures
    inside = third <= bound
    assert stop.cause == "limit" and stop.share == pytest.approx(1 - inside.mean())
    assert j.coverage == pytest.approx(inside[:64].mean()) and 0.5 < j.coverage < 1
    Q = F.batch(U[:64][inside[:64]])
    own, wanted = F.inverse.batch(Q), G_d.batch(Q)
    squares, due = ((X**2).sum(axis=(1, 2)) for X in (own, wanted))
    assert j.cost == pytest.approx(((own - wanted) ** 2).sum(axis=(1, 2)).mean())
    extra = np.sqrt(squares / due) - 1
    assert j.extra_speed == pytest.approx(np.sqrt(squares.mean() / due.mean()) - 1, rel=1e-6)
    assert extra.max() - 1e-9 <= j.extra_speed_worst < 0
    assert j.limit_margin_worst < 0 and not j.everywhere
    assert j.limit_margin == pytest.approx(bound - third[:64].max(), abs=1e-9)


def test_the_smallest_singular_value_is_searched_for_on_its_own(tmp_path: Path) -> None:
    """Without joint limits and joint speeds to search for, from few poses: on an edge of the cell,
    as low as at any node of a grid along it."""
    text = planar_urdf([1.0, 0.9, 0.8]).replace('"revolute"', '"continuous"')
    (tmp_path / "endless.urdf").write_text(text, encoding="utf-8")
    task = rp.Robot.load(tmp_path / "endless.urdf").task("tool", "xy")
    cell = rp.Cell(task, [1.43, 0.0, 0.0], (0.46, 0.55))
    q = rp.solve_ik(task, [0.93, 0.41, -0.85], cell.placement)
    chart = chart_of(cell, q, 4, 64)
    j = evaluate_cell(rp.Pseudoinverse(task), chart, 64, 1, quick=True)
    along = np.linspace(-1, 1, 201)
    ends = [np.stack(x, axis=1) for x in ((along, 1 + 0 * along), (1 + 0 * along, along))]
    U = np.concatenate([w * end for end in ends for w in (1, -1)])
    Q = rp.InverseFunction(chart).batch(U)
    least = np.linalg.svd(task.jacobians(Q), compute_uv=False).min(axis=1)
    assert np.abs(U[least.argmin()]).min() < 0.99
    assert least.min() * 0.999 < j.smallest_singular_value <= least.min() + 1e-7


@pytest.mark.slow
def test_a_guess_leaves_out_no_pose_that_the_free_functions_violate() -> None:
    """The penalty is a mean over its poses, so fewer of them would weigh the others more."""
    cell = cell_of(half_width=0.15)
    q = rp.solve_ik(cell.task, Q_PANDA, cell.placement)
    chart = chart_of(cell, q, count=64)
    low, terms = (chart_of(cell, q, degree).monomials for degree in (2, 3))
    desired, U = rp.Pseudoinverse(cell.task), cell.sample(64, 1)
    free = [descend(Cost(desired, chart, t, U), np.zeros((t.size, 1))) for t in (low, terms)]
    functions = [
        margins.CandidateFunction(chart, t, descent.a)
        for t, descent in zip((low, terms), free, strict=True)
    ]
    bound = np.quantile(functions[1].at(U).Q[:, 2], 0.7)
    margin = margins.Margin("joint 3", lambda Q: bound + 0.1 - Q[:, 2:3], 0.1, 0.4, 128, 16, 24)

    def constraint() -> ActiveConstraint:
        return ActiveConstraint(margin, np.concatenate([cell.sample(128, 3), cell.corners()]))

    due = constraint()
    assert [due.short(one) for one in reversed(functions)] == [True, True]
    easy = ActiveConstraint(replace(margin, measure=lambda Q: 9 - Q[:, 2:3]), due.U)
    for constraints, rounds in (([due], 0), ([easy], 20)):
        unchanged = PenaltyMethod(desired, chart, U, constraints, rounds)
        assert unchanged.kept(free, terms, print) is free[-1]
    guess, costs = None, []
    for _ in range(2):  # without a guess, and from a function that violates nothing
        kept = constraint()
        fit = PenaltyMethod(desired, chart, U, [kept], 20)
        weights: list[float] = []
        told: dict[str, list[float]] = {}

        def tell(what: str, share: float, fit=fit, weights=weights, told=told) -> None:
            weights.append(fit.weight)
            told.setdefault(what, []).append(share)

        found = fit.kept(free, terms, tell, guess=guess)
        assert found.steps > free[-1].steps
        assert [*told] == ["joint 3, degree 2", "joint 3, degree 3"]
        for shares in told.values():  # no round once nothing changes any more
            assert shares[0] == 0.5 and len(shares) < 12 and max(shares) < 1
            assert shares == sorted({*shares})
        assert weights[0] == (100 if guess is None else 1000)
        assert all(b in (a, min(10 * a, 1e5)) for a, b in pairwise(weights))
        assert guess is not None or weights[-1] < 1e5  # no margin was short any more
        assert weights[1] == 10 * weights[0]  # ten times in each round, up to 1e5
        assert {*map(tuple, due.edge)} <= {*map(tuple, kept.edge)}
        assert (margin.least(margins.CandidateFunction(chart, terms, found.a).at(U)) > 0.08).all()
        guess = low.fit(U, terms.values(U) @ found.a)
        costs.append(found.value.cost)
    fit = PenaltyMethod(desired, chart, U, [constraint()], 20)
    again = fit.kept(free[1:], terms, lambda *_: None)  # degree 2 is fitted anew
    assert again.value.cost == pytest.approx(costs[0], rel=1e-3)


@pytest.mark.slow
def test_postures_at_singularities_and_in_collision_are_left_out() -> None:
    # of its postures some are singular, in others links touch
    xarm = rp.Robot.load("xarm7").task("link_eef", "pose")
    cell = rp.Cell(xarm, xarm.placement(xarm.reference), 0.03, 0.1)
    offered = searched(rp.Pseudoinverse(xarm), cell)
    q = offered[0].q
    assert 1 < len(offered) <= 4  # and no two of them are the same within the tolerance
    order = [(-c.share, c.body_distance < 0, -min(c.margin, 0.1), c.speed) for c in offered]
    assert order[1:] == sorted(order[1:]) and order[0][:2] == min(order)[:2]
    for one, other in combinations(offered, 2):
        assert np.linalg.norm(one.q - other.q) > 0.3
    assert (np.abs(q - xarm.reference) <= np.pi).all()  # not wound up: the joints turn by two pi
    s = np.linalg.svd(xarm.jacobian(q), compute_uv=False)
    assert rp.Bodies(xarm).nearest(q).distance > 0
    assert s[-1] > 0.01 * s[0] and np.abs(xarm.error(q, cell.placement)).max() < 1e-8


@pytest.mark.parametrize(
    ("lengths", "q", "half_width", "range_"),
    [
        ((1.0, 0.9, 0.8), (0.6, -1.2, 1.4), 0.1, 7.0),
        pytest.param((1.0, 0.9, 0.8), (0.3, 1.5, 1.4), 0.6, 7.0, marks=pytest.mark.slow),
        ((0.5, 0.4, 0.3), (0.2, 0.8, 0.8), 0.02, 1.25),
    ],
)
def test_the_posture_of_a_search_is_the_best_of_all(
    lengths: tuple[float, ...],
    q: tuple[float, ...],
    half_width: float,
    range_: float,
    tmp_path: Path,
) -> None:
    """All configurations of the middle, by the law of cosines for the last two links at each θ₁.
    The next one is the fastest of the others, or that with the largest limit margin below 0.1."""
    (tmp_path / "arm.urdf").write_text(planar_urdf(lengths, range_=range_))
    task = rp.Robot.load(tmp_path / "arm.urdf").task("tool", "xy")
    cell, G_d = rp.Cell(task, task.placement(q), half_width), rp.Pseudoinverse(task)
    l1, l2, l3 = lengths
    first = np.tile(np.linspace(-np.pi, np.pi, 721), 2)
    knee = l1 * np.stack([np.cos(first), np.sin(first)])
    x, y = cell.placement.translation[:2, None] - knee
    cosine = (x**2 + y**2 - l2**2 - l3**2) / (2 * l2 * l3)
    third = np.repeat([1, -1], 721) * np.arccos(np.clip(cosine, -1, 1))
    way = np.arctan2(y, x) - np.arctan2(l3 * np.sin(third), l2 + l3 * np.cos(third))
    second = (way - first + np.pi) % (2 * np.pi) - np.pi
    Q = np.stack([first, second, third], axis=1)[np.abs(cosine) < 0.99]
    every = judged(G_d, cell, Q[task.limit_margin(Q).min(axis=1) > 0])
    best = chosen(every, task.reference)
    found, second_best, *_ = searched(G_d, cell)
    assert np.abs(found.q - best.q).max() < 0.035 and found.share == best.share == 1
    others = [c for c in every if c.share == 1 and np.linalg.norm(c.q - found.q) > 0.3]
    room = [min(0.1, c.margin) for c in others]
    fast = [c.speed for c, margin in zip(others, room, strict=True) if margin > max(room) - 0.01]
    assert second_best.share == 1 and second_best.margin > max(room) - 0.01
    assert second_best.speed < 1.02 * min(fast)


def test_a_posture_that_collides_at_a_corner_comes_after_all_that_do_not(tmp_path: Path) -> None:
    """A post that the first link of the fastest postures touches at a corner only."""
    text = planar_urdf([1.0, 0.8, 0.3], range_=3.0)
    for i, length in enumerate((1.0, 0.8, 0.3), 1):
        box = f'<box size="{0.96 * length} 0.01 0.01"/></geometry></collision></link>'
        link = f'<link name="link{i}"><collision><origin xyz="{length / 2} 0 0"/><geometry>'
        text = text.replace(f'<link name="link{i}"/>', link + box)
    (tmp_path / "arm.urdf").write_text(text, encoding="utf-8")
    place = f'<origin xyz="{0.93 * np.cos(1.2)} {0.93 * np.sin(1.2)} 0"/>'
    (tmp_path / "post.urdf").write_text(
        f'<robot name="post"><link name="post"><collision>{place}<geometry>'
        '<box size="0.01 0.01 0.05"/></geometry></collision></link></robot>'
    )
    around = tmp_path / "post.urdf"
    task = rp.Robot.load(tmp_path / "arm.urdf", surroundings=around).task("tool", "xy")
    fast = np.array([1.12, -1.56, -0.63])
    cell, G_d = rp.Cell(task, task.placement(fast), 0.12), rp.Pseudoinverse(task)
    offered, (colliding,) = searched(G_d, cell), judged(G_d, cell, fast[None])
    assert colliding.body_distance < 0 <= min(c.body_distance for c in offered)
    assert colliding.share == 1 and colliding.speed < offered[-1].speed
    assert rp.Bodies(task).distances(fast[None]) > 0


def test_a_posture_is_unwound_only_inside_the_limits(tmp_path: Path) -> None:
    """The first joint may turn from −7 to 0.5 rad: the pose at 2 rad is reached at 2 − 2π rad, and
    that at −6.5 rad at 2π − 6.5 rad."""
    text = planar_urdf([0.5, 0.4, 0.3]).split('lower="-7.0" upper="7.0"')
    hand = 'lower="0.7" upper="0.9"'
    text = text[0] + 'lower="-7" upper="0.5"' + text[1] + hand + text[2] + hand + text[3]
    (tmp_path / "arm.urdf").write_text(text, encoding="utf-8")
    task = rp.Robot.load(tmp_path / "arm.urdf").task("tool", "xy")
    for first, due in ((2.0, 2 - 2 * np.pi), (-6.5, 2 * np.pi - 6.5)):
        cell = rp.Cell(task, task.placement([first, 0.8, 0.8]), 0.01)
        offered = searched(rp.Pseudoinverse(task), cell)
        for one in offered:
            assert abs(one.q[0] - due) < 0.3 and task.limit_margin(one.q).min() > 0
            assert np.abs(task.error(one.q, cell.placement)).max() < 1e-9


class Watched(rp.Pseudoinverse):
    """J⁺, and the configurations at which each batch of it was evaluated."""

    seen: list[np.ndarray]

    def batch(self, Q: Any, *rest: Any, **options: Any) -> np.ndarray:
        self.__dict__.setdefault("seen", []).append(np.array(Q))
        return super().batch(Q, *rest, **options)


@pytest.mark.parametrize(("range_", "count"), [(7.0, {24}), (1.1, {*range(3, 24)})])
def test_the_postures_that_are_judged_are_far_from_each_other(
    range_: float, count: set[int], tmp_path: Path
) -> None:
    """At most 24, each as far as possible from those before it, and by 0.05 rad at least. Four of
    those that are 0.3 rad apart are offered."""
    (tmp_path / "arm.urdf").write_text(planar_urdf([0.5, 0.4, 0.3], range_=range_))
    task = rp.Robot.load(tmp_path / "arm.urdf").task("tool", "xy")
    cell = rp.Cell(task, task.placement([0.2, 0.8, 0.8]), 0.02)
    G_d = Watched(task)
    offered = [one.q for one in searched(G_d, cell)]
    assert len(offered) == 4 or range_ < 7
    assert all(np.linalg.norm(a - b) > 0.3 for a, b in combinations(offered, 2))
    Q = G_d.seen[0][:: len(cell.corners())]
    away = np.linalg.norm(Q[:, None] - Q, axis=2)
    assert len(Q) in count and len(Q) == len(np.unique(Q, axis=0))
    for i in range(1, len(Q)):
        nearest = away[i:, :i].min(axis=1)
        assert nearest[0] == nearest.max() >= 0.05


@pytest.mark.slow
def test_the_gradient_of_the_cost_counts_the_removed_coordinates() -> None:
    design = sector_design("pose")
    chart = design.function.chart
    terms = chart_of(chart.cell, design.posture, 1, 32).monomials
    cost = Cost(design.desired, chart, terms, chart.cell.sample(8))
    a = 0.02 * np.random.default_rng(0).normal(size=(terms.size, 1))
    gradient, _ = cost.model(cost.value(a))
    d = np.random.default_rng(1).normal(size=a.shape)
    ends = [cost.value(a + w * 1e-5 * d).cost for w in (1, -1)]
    assert np.isclose((ends[0] - ends[1]) / 2e-5, gradient @ d.ravel(), rtol=1e-5)


@pytest.mark.parametrize(("range_", "whole"), [(3.0, 6.0), (3.5, 2 * np.pi)])
def test_the_range_of_the_angle_where_a_pose_is_covered(
    range_: float, whole: float, tmp_path: Path
) -> None:
    """That of the first joint, at most a full turn; none where the others are beyond their limits
    or the arm is too short; and none of a cell whose angle no joint turns."""
    text = planar_urdf([0.5, 0.4, 0.3], range_=range_).split("<limit ")
    text[2] = text[2].replace(f'"{-range_}"', '"0.7"')
    (tmp_path / "arm.urdf").write_text("<limit ".join(text), encoding="utf-8")
    task, q = rp.Robot.load(tmp_path / "arm.urdf").task("tool", "xy"), np.full(3, 0.8)
    near, far = (rp.Sector(task, task.placement(q), radius=r) for r in (0.02, 0.6))
    chart = chart_of(near.without(near.symmetries), q, 1, 32)
    chart = replace(chart, cell=far.without(far.symmetries))
    U = np.linspace(-1, 1, 41)[:, None]
    at = chart.solve(U, np.zeros((41, 1)))
    covered = at.found & (task.limit_margin(at.Q)[:, 1:].min(axis=1) >= 0)
    assert 5 < covered.sum() < at.found.sum() < 40
    found = symmetric_coordinates.turn_at(chart, U)
    assert np.allclose(found, np.where(covered, whole, np.nan), equal_nan=True)
    assert symmetric_coordinates.turn_at(replace(chart, cell=far), U) is None
    cell = rp.Cell(task, task.placement(q), 0.02)
    assert symmetric_coordinates.turn_at(chart_of(cell, q, 1, 32), U) is None


def test_the_lowest_body_distance_is_that_of_all() -> None:
    """Where hulls overlap, few bodies are tested, and the minimum is still that of all poses."""
    task = rp.Robot.load("xarm7").task("link_eef", "pose")
    rng, bodies = np.random.default_rng(0), rp.Bodies(task)
    for size in (0.1, 1.0):
        Q = task.reference + size * rng.normal(size=(40, task.n))
        exact = bodies.distances(Q)
        found, share = margins.lowest_distances(bodies, Q)
        assert found.min() == exact.min()
        assert abs(share - (exact < 0).mean()) < 0.2
        assert (found <= exact + 1e-12)[exact >= 0].all()
    # and of configurations whose hulls overlap, in the middle of a cell, but no bodies
    q = np.array([-1.25, -0.15, 0.35, -0.1, -0.8, -0.87, 0.43])
    both = np.array([q + 0.02, q])
    assert bodies.hull_distances(both).max() < -0.003
    cell, G_d = rp.Cell(task, task.placement(q), 0.02), rp.Pseudoinverse(task)
    for one, at in zip(judged(G_d, cell, both), both, strict=True):
        ends, _, _ = straight(G_d, cell, at, cell.corners())
        exact = bodies.distances(np.concatenate([at[None], ends]))
        assert (bodies.hull_distances(ends) < 0).any() and np.ptp(exact) > 1e-3
        assert one.share == 1 and one.body_distance == pytest.approx(exact.min(), abs=1e-9)


def test_the_starts_of_a_pair_of_bodies_differ_in_joints_that_move_it() -> None:
    """Three starts that differed only in the spin were all on one side of the base, and the
    minimum on the other side, 0.2 mm smaller, was missed on a sector of the panda."""
    task = rp.Robot.load("panda").task("panda_hand_tcp", "pose")
    bodies, U = rp.Bodies(task), np.random.default_rng(0).uniform(-1, 1, (600, task.n))
    half = (task.upper - task.lower) / 2
    at = SimpleNamespace(U=U, Q=task.lower + half * (1 + U))
    starts, pairs = margins._starts_by_pair(bodies, at, 0.2)
    assert len(starts) > 20
    for (u, pair), (v, other) in combinations(zip(starts, pairs, strict=True), 2):
        if pair != other:
            continue
        away = np.flatnonzero(np.abs(u - v) > 0.29)
        mixed = np.tile(u, (len(away) + 1, 1))
        mixed[np.arange(len(away)), away] = v[away]
        found = bodies._of_pairs(task.lower + half * (1 + mixed), np.full(len(mixed), pair))
        assert np.abs(found[:-1] - found[-1]).max() > 1e-9


def test_the_nearest_bodies_are_found_with_every_seed() -> None:
    """Of the last three, the search ended up to 0.26 mm above the least distance, at a corner."""
    task = rp.Robot.load("ur5").task(None, "axis")
    q = [-0.29651, 3.342783, -1.820465, -3.093114, 4.712389, 3.684518]
    sector = rp.Sector(task, task.placement(q), radius=0.1, height=0.15, angle="all")
    few = rp.FitOptions(samples=64, held_out=64)
    chart = rp.nearest_inverse_function(
        rp.Pseudoinverse(task), sector, posture=q, degree=1, options=few
    ).function.chart
    whole = margins.CandidateFunction.zero(symmetric_coordinates.expanded(chart))
    found = [whole.at(margins.nearest_by_pair(whole, seed, 0.005)).Q for seed in (0, 8, 11, 28)]
    least = [rp.Bodies(task).distances(Q).min() for Q in found]
    assert 0 < min(least) and np.ptp(least) < 5e-5


def test_postures_in_collision_are_judged_only_where_all_collide() -> None:
    task = rp.Robot.load("xarm7").task("link_eef", "pose")
    Q = task.reference + np.random.default_rng(0).normal(size=(12, task.n))
    apart = rp.Bodies(task).distances(Q)
    assert {*(apart < 0)} == {False, True}
    cell, G_d = rp.Cell(task, task.placement(Q[0]), 1e-3), rp.Pseudoinverse(task)
    for some, kept in ((apart < 1, apart >= 0), (apart < 0, apart < 0)):
        candidates = judged(G_d, cell, Q[some])
        assert np.array_equal([c.q for c in candidates], Q[kept])
        alone = [c.share == 0 for c in candidates]  # no corner is reached from there
        distances = np.array([c.body_distance for c in candidates])
        assert np.allclose(distances[alone], apart[kept][alone]) and sum(alone) > 1


# ---- searches for small and for large margins ----------------------------------------------------


def wrist(folder: Path) -> Any:
    """The chart of an arm whose last joint turns the tool on the spot: the label is its angle,
    from 0.4 rad on."""
    task, q = planar_task([0.5, 0.4, 0.0], folder), np.array([0.3, 0.9, 0.4])
    chart = chart_of(rp.Cell(task, task.placement(q), 0.05), q)
    way = np.sign(chart.coefficients[0, 2, 1])
    return replace(chart, coefficients=chart.coefficients * [1, way])


def function_of_label(chart: Any, label: Any) -> margins.CandidateFunction:
    """The function of a chart with a label that is a polynomial in u."""
    U = chart.cell.sample(64)
    return margins.CandidateFunction(
        chart, chart.monomials, chart.monomials.fit(U, label(U)[:, None])
    )


def margin_of(
    measure: Any, required: float = 0.0, slack: float = 0.0, violators: int = 9
) -> margins.Margin:
    return margins.Margin("", measure, required, slack, 99, 6, violators)


def test_the_largest_margin_of_a_self_motion(tmp_path: Path) -> None:
    """Within 0.7 rad either way, or 2.4 if asked for, by steps of 0.06 and then finer ones; only
    for poses with less than enough."""
    chart = wrist(tmp_path)
    U, s = chart.cell.sample(64), np.linspace(-0.65, 0.65, 64)
    at = chart.solve(U, s[:, None])
    for options, farthest in (({}, 0.72), ({"far": True}, 2.4)):
        for way in (1, -1):
            rising = margin_of(lambda Q, way=way: way * Q[:, 2:])
            gain = rising.attainable(chart, at, **options) - way * (0.4 + s)
            assert (farthest < gain).all() and (gain < farthest + 0.06).all()
    hill = margin_of(lambda Q: -np.abs(Q[:, 2:] - 0.4))
    assert np.allclose(hill.least(at), -np.abs(s))
    assert (hill.attainable(chart, at) > -5e-4).all()
    own = hill.least(at)
    enough = own[10]
    found = hill.attainable(chart, at, enough=enough)
    assert np.array_equal(found[own >= enough], own[own >= enough])
    assert (found >= enough).all() and (own < enough).sum() > 10


def test_the_search_for_a_small_margin_ends_at_the_smallest(tmp_path: Path) -> None:
    """The margin is the tool's distance from a point, so that the smallest one in the cell is at
    the point of the cell nearest to it."""
    chart = wrist(tmp_path)
    cell, candidate = chart.cell, margins.CandidateFunction.zero(chart)
    starts = np.concatenate([cell.sample(4), [[1.0, 1.0], [-1.0, -1.0]]])
    for nearest, point in (
        ([0.3, -0.6], [0.3, -0.6]),
        ([1.0, 0.2], [90.0, 0.2]),
        ([-0.4, -1.0], [-0.4, -90.0]),
        ([-1.0, 1.0], [-5.0, 2.0]),
    ):
        place = cell.placement.translation[:2] + cell.half_width * point

        def distance(Q: np.ndarray, place: np.ndarray = place) -> np.ndarray:
            turns = np.cumsum(Q, axis=1)[:, :2]
            tool = np.stack([np.cos(turns), np.sin(turns)], axis=1) @ [0.5, 0.4]
            return np.linalg.norm(tool - place, axis=1)[:, None]

        visited = margins.searched(candidate, (margin_of(distance), starts))
        assert np.array_equal(visited[:6], starts) and np.abs(visited).max() <= 1
        assert np.allclose(visited[-6:], [nearest] * 6, atol=0.01)
        values = margin_of(distance).least(candidate.at(visited))
        assert values[-6:].max() <= values.min() + 1e-3


def test_searches_for_several_quantities_visit_the_poses_of_each(tmp_path: Path) -> None:
    """They step together, each with its own quantity; final poses are last, in the same order."""
    chart = wrist(tmp_path)
    candidate, starts = margins.CandidateFunction.zero(chart), chart.cell.sample(8)
    tip = margin_of(lambda Q: 4 - Q[:, 2:])
    quantities = [tip, margins.LeafMargin(chart), margins.limits_of(chart.cell)]
    alone = [margins.searched(candidate, (each, starts)) for each in quantities]
    found = margins.searched(candidate, *((each, starts) for each in quantities))
    ends = np.concatenate([visited[-8:] for visited in alone])
    assert np.allclose(found[-len(ends) :], ends, atol=1e-9)
    every = np.concatenate(alone)
    assert len(found) == len(every)
    assert np.abs(found[:, None] - every[None]).max(axis=2).min(axis=0).max() < 1e-9


def test_a_search_computes_each_slope_once_and_ends_at_its_shortest_step(tmp_path: Path) -> None:
    """After a step that was rejected, the slope at the same pose was computed again."""
    chart = wrist(tmp_path)
    candidate, starts = margins.CandidateFunction.zero(chart), chart.cell.sample(8)
    seen: list[np.ndarray] = []

    class Seen(margins.Margin):
        def slope(self, candidate: margins.CandidateFunction, at: Any) -> np.ndarray:
            seen.append(at.U)
            return super().slope(candidate, at)

    target = candidate.at(np.array([[0.3, -0.4]])).Q
    how = {"required": 0.0, "slack": 0.0, "watched": 8, "starts": 8, "violators": 8}
    curved = Seen("curved", lambda Q: ((Q - target) ** 2).sum(axis=1, keepdims=True), **how)
    margins.searched(candidate, (curved, starts))
    poses, fine = np.concatenate(seen), len(seen)
    assert len(poses) > 8 and len(np.unique(poses, axis=0)) == len(poses)
    seen.clear()
    margins.searched(candidate, (curved, starts), shortest=0.025)
    assert len(seen) < fine


def test_the_search_for_a_small_margin_does_not_jump(tmp_path: Path) -> None:
    """The last joint turns by 4 rad for each unit of u, and by less than 1 rad in each step."""
    chart = wrist(tmp_path)
    steep = function_of_label(chart, lambda U: 4 * U[:, 0])
    start = np.array([[-0.9, 0.2]])
    visited = margins.searched(steep, (margin_of(lambda Q: 9 - Q[:, 2:]), start))
    steps = np.diff(steep.at(visited).Q[:, 2])
    assert visited[-1, 0] == 1 and 0.5 < steps.max() < 1


def test_the_slope_of_a_margin_is_that_of_its_smallest_part(tmp_path: Path) -> None:
    """Against finite differences; a part without a limit has none."""
    chart = wrist(tmp_path)
    a = np.random.default_rng(0).normal(size=(10, 1))
    candidate = margins.CandidateFunction(chart, chart.monomials, a)

    def measure(Q: np.ndarray) -> np.ndarray:
        return np.stack([np.sin(Q[:, 2]), np.full(len(Q), np.inf), Q[:, 0] * Q[:, 2]], 1)

    U, margin = 0.9 * chart.cell.sample(16), margin_of(measure)
    at = candidate.at(U)
    lowest = measure(at.Q).argmin(axis=1)
    slope = margin.slope(candidate, at)
    assert {*lowest} == {0, 2}
    for k in range(2):
        step = 1e-6 * np.eye(2)[k]
        ends = [margin.least(candidate.at(U + w * step)) for w in (1, -1)]
        assert np.allclose(slope[:, k], (ends[0] - ends[1]) / 2e-6, atol=1e-5)
    free = margin.slopes(at.Q, candidate.derivative(at))[:, 1]
    assert (free == 0).all()


class Stand:
    """Bodies whose distances and whose hulls' are given: the first column of Q, and the second."""

    def __init__(self) -> None:
        self.tested: list[float] = []

    def hull_distances(self, Q: np.ndarray) -> np.ndarray:
        return Q[:, 1].copy()

    def _hull_bounds(self, Q: np.ndarray) -> np.ndarray:
        return Q[:, 1] - np.arange(len(Q)) % 3

    def _nearer(self, Q: np.ndarray, distance: float) -> np.ndarray:
        return np.asarray(Q[:, 1] < distance)

    def distances(self, Q: np.ndarray) -> np.ndarray:
        self.tested += Q[:, 1].tolist()
        return Q[:, 0].copy()


@pytest.mark.parametrize("overlaps", [0, 1, 20, 32, 200])
@pytest.mark.parametrize("collide", [0.0, 0.02, 0.3, 1.0])
def test_few_of_the_overlapping_hulls_are_tested(overlaps: int, collide: float) -> None:
    """Until no other hulls overlap as deeply as the deepest collision, and a sample of 32."""
    rng = np.random.default_rng(overlaps)
    hulls = np.r_[rng.uniform(0.1, 0.2, 40), -rng.permutation(overlaps) - 1.0]
    deep = (rng.uniform(size=hulls.shape) < collide) & (hulls < 0)
    exact = np.where(deep, hulls / 2, np.maximum(hulls, 0.0))
    stand, Q = Stand(), np.stack([exact, hulls], axis=1)
    found, share = margins.lowest_distances(stand, Q)
    assert found.min() == exact.min()
    tested, overlap = np.isin(hulls, stand.tested), hulls < 0
    assert not tested[~overlap].any() and (found[overlap & ~tested] == 0).all()
    assert np.array_equal(found[tested], exact[tested])
    assert (found[~overlap] <= exact[~overlap]).all() and (found[~overlap] > 0).all()
    assert len(stand.tested) == tested.sum() <= 32 + (hulls < exact.min()).sum() + 8
    if overlaps <= 32:
        assert tested.sum() == overlaps
        assert share == pytest.approx((exact < 0).mean(), rel=1e-12)
    assert abs(share - (exact < 0).mean()) < 0.15
    near, below = margins.lowest_distances(Stand(), Q, required=0.15)  # type: ignore[arg-type]
    due = (exact < 0.15).mean()
    assert 0 < due < 1 and below == pytest.approx(due, rel=1e-12)
    apart = hulls >= 0
    assert near.min() == exact.min() and np.array_equal((near < 0.15)[apart], (exact < 0.15)[apart])
    quick = Stand()
    found, _ = margins.lowest_distances(quick, Q, quick=True)
    assert sorted(quick.tested) == sorted(hulls)[: min(8, overlaps)]


def test_no_deeper_collision_is_left_out() -> None:
    """One of 41 overlaps collides as deeply as its hulls do, the next deeper one a little less."""
    hulls = -np.arange(41.0, 0.0, -1.0)
    for i in range(41):
        exact = np.full(41, 0.05)
        exact[i - 1], exact[i] = hulls[i] + 0.5, hulls[i]
        found, _ = margins.lowest_distances(Stand(), np.stack([exact, hulls], axis=1))  # type: ignore[arg-type]
        assert found.min() == hulls[i]


def test_the_margins_of_a_task_are_those_of_its_limits_and_its_jacobian() -> None:
    task, rng = panda(), np.random.default_rng(0)
    Q = rng.uniform(task.lower, task.upper, (8, task.n))
    room = np.minimum(Q - task.lower, task.upper - Q)
    singular = np.linalg.svd(task.jacobians(Q), compute_uv=False)
    hulls = rp.Bodies(task).hull_distances(Q)
    for make, due in (
        (margins.limits_of, room),
        (margins.singular_values_of, singular[:, -1:]),
        (margins.distances_of, hulls[:, None]),
    ):
        margin = make(task)
        assert np.allclose(margin.measure(Q), due, rtol=0, atol=1e-12)
        assert margin.measure(Q).shape == due.shape and margin.required == 0


def test_the_rounds_end_where_nothing_can_be_met(tmp_path: Path) -> None:
    """The label is to be in a narrow corridor around a parabola, in which no plane is: the weight
    is raised to 1e5, until neither poses nor coefficients change any more."""
    chart = wrist(tmp_path)
    cell = chart.cell
    middle, wide = cell.placement.translation[:2], cell.half_width[:2]

    def measure(Q: np.ndarray) -> np.ndarray:
        turns = np.cumsum(Q, axis=1)[:, :2]
        tool = np.stack([np.cos(turns), np.sin(turns)], axis=1) @ [0.5, 0.4]
        away = Q[:, 2] - 0.4 - 0.5 * (((tool - middle) / wide) ** 2).sum(axis=1)
        return np.stack([away + 0.2, 0.2 - away], axis=1)

    G_d, U = rp.Pseudoinverse(cell.task), cell.sample(32)
    terms = chart_of(cell, np.array([0.3, 0.9, 0.4]), 1, 32).monomials
    free = descend(Cost(G_d, chart, terms, U), np.zeros((terms.size, 1)))
    constraint = ActiveConstraint(margin_of(measure, 0.1), cell.sample(32, 1))
    method = PenaltyMethod(G_d, chart, U, [constraint], 30)
    weights: list[float] = []
    found = method.kept([free], terms, lambda *_: weights.append(method.weight))
    assert weights[:4] == [100, 1e3, 1e4, 1e5] and {*weights[4:]} == {1e5}
    assert len(weights) < 30 and found.steps > free.steps + len(weights)
    edge, last = constraint.edge, margins.CandidateFunction(chart, terms, found.a)
    assert constraint.short(last) and np.array_equal(constraint.edge, edge)
    kept = [constraint.penalty(last)]
    again = descend(Cost(G_d, chart, terms, U, kept, weight=1e5), found.a)
    assert again.value.cost > 0.999 * again.start


# ---- null spaces and rays ------------------------------------------------------------------------


@pytest.mark.parametrize(("m", "n"), [(2, 3), (3, 4), (6, 7), (3, 5)])
def test_null_spaces_near_given_ones_are_exact(m: int, n: int) -> None:
    """By J's own factors, near singularities and far from them, and beside bases that are almost
    orthogonal to the null space."""
    rng, count = np.random.default_rng(m), 200
    U, V = (np.linalg.qr(rng.normal(size=(count, k, k)))[0] for k in (m, n))
    s = -np.sort(-(10.0 ** rng.uniform(-1, 1, (count, m))), axis=1)
    s[:, m // 2 :] *= 10.0 ** -np.linspace(0, 4, count)[:, None]
    J = U * s[:, None] @ np.swapaxes(V[:, :, :m], 1, 2)
    turn, angle = (rng.normal(size=(count, m, n - m)), rng.permutation(np.linspace(0, 1.57, count)))
    turn /= np.linalg.norm(turn, axis=1, keepdims=True)
    mixed = V[:, :, m:] @ (np.eye(n - m) + 0.4 * rng.uniform(-1, 1, (count, n - m, n - m)))
    near = np.cos(angle)[:, None, None] * mixed
    near = near + np.sin(angle)[:, None, None] * V[:, :, :m] @ turn
    N, found = kinematics.null_bases(J, near), kinematics.singular_values(J)
    assert np.allclose(
        N @ np.swapaxes(N, 1, 2), V[:, :, m:] @ np.swapaxes(V[:, :, m:], 1, 2), atol=1e-9
    )
    assert np.allclose(np.swapaxes(N, 1, 2) @ N, np.eye(n - m), atol=1e-12)
    assert np.allclose(found, s, rtol=0, atol=1e-11 * s[:, :1])
    onto = np.swapaxes(near, 1, 2) @ N  # of all bases, N is the nearest
    assert np.allclose(onto, np.swapaxes(onto, 1, 2), atol=1e-9)
    assert np.linalg.eigvalsh(onto).min() > 0
    for ratio in (0.5, 0.01, 1e-5, 1e-12):
        assert np.array_equal(kinematics.regular(J, ratio), s[:, -1] > ratio * s[:, 0])
    J[::2, -1] = J[::2, :-1].sum(axis=1)  # of lower rank
    assert np.array_equal(kinematics.regular(J, 1e-12), np.arange(count) % 2 == 1)


def test_rays_are_followed_until_they_stop(tmp_path: Path) -> None:
    """Beyond the reach of the arm and across its base, by steps of their own: how far, the limit
    margin on the way, the last joints, and the null vector there."""
    task, q = planar_task([1.0, 0.9, 0.8], tmp_path), np.array([0.6, -1.2, 1.4])
    cell, G_d = rp.Cell(task, task.placement(q), 1.2), rp.Pseudoinverse(task)
    U = np.concatenate([cell.sample(28), cell.corners()])
    for options, steps in (({}, 16), ({"steps": 40}, 40)):
        ends = reach.rays(G_d, cell, q, U, **options)
        Q, least, reached = straight(G_d, cell, q, U, steps)
        assert 0.2 < (reached == 1).mean() < 0.9 and len({*reached}) > 4
        assert np.allclose(ends.reached, reached, rtol=0, atol=1e-12)
        assert np.allclose(ends.Q, Q, rtol=0, atol=1e-6)
        assert np.allclose(ends.least, least, rtol=0, atol=1e-6)
        whole = reached == 1
        null = np.swapaxes(task.jacobians(Q)[whole] @ ends.N[whole], 1, 2)
        assert np.abs(null).max() < 1e-3 and np.array_equal(ends.U, U)


def test_a_step_of_newtons_method_is_limited(tmp_path: Path) -> None:
    """No joint moves by more than 0.3 rad in one of them."""
    chart = wrist(tmp_path)
    U = chart.cell.sample(8)
    here = chart.solve(U, np.zeros((8, 1)))
    one = chart.solve(U, np.ones((8, 1)), here.Q, iterations=1)
    assert np.allclose(one.Q[:, 2] - here.Q[:, 2], 0.3) and not one.found.any()


# ---- penalties -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("slack", "least", "due"),
    [(0.4, 0.7, False), (0.4, 0.5, True), (0.0, 0.95, False), (0.0, 0.85, True)],
)
def test_a_margin_falls_short_beyond_its_slack(
    slack: float, least: float, due: bool, tmp_path: Path
) -> None:
    """The smallest margin of the cell is at a corner, which the search finds."""
    chart, required = wrist(tmp_path), 0.1
    label = function_of_label(chart, lambda U: least * required + 0.08 * (2 - U.sum(axis=1)))
    margin = margin_of(lambda Q: Q[:, 2:] - 0.4, required, slack)
    U = 0.5 * chart.cell.sample(64)
    constraint = ActiveConstraint(margin, U)
    assert margin.least(label.at(U)).min() > required
    assert constraint.short(label) is due
    assert len(constraint.U) > len(U) and np.array_equal(constraint.U[: len(U)], U)
    new = constraint.U[len(U) :]
    assert np.allclose(20 * new, np.rint(20 * new)) and [1, 1] in new.tolist()
    assert len(np.unique(new, axis=0)) == len(new)
    assert (len(constraint.edge) > 0) is due


@pytest.mark.parametrize("kind", ["limits", "bodies", "singularities"])
def test_limits_may_be_missed_by_more_than_other_margins(kind: str, tmp_path: Path) -> None:
    """Two fifths of the required margin, and a quarter, where self-motion has more than that."""
    if kind == "limits":
        task, q, slack = planar_task([0.5, 0.4, 0.0], tmp_path), [0.3, 0.9, 6.4], 0.4
    elif kind == "bodies":
        task = rp.Robot.load(chain_with_bodies(tmp_path)).task("tip", "xy")
        q, slack = [1.48, -1.35, -2.24], 0.25
    else:
        task, q, slack = planar_task([1.0, 0.9, 0.8], tmp_path), [0.3, 0.25, 2.6], 0.25
    make = {"limits": margins.limits_of, "bodies": margins.distances_of}.get(
        kind, margins.singular_values_of
    )
    chart = chart_of(rp.Cell(task, task.placement(q), 1e-3), np.array(q), 1, 16)
    function, U = margins.CandidateFunction.zero(chart), chart.cell.corners()
    least = make(task).least(function.at(U)).min()
    for missed, due in ((slack - 0.05, False), (slack + 0.05, True)):
        margin = make(task, least / (1 - missed))
        assert ActiveConstraint(margin, U).short(function) is due


@pytest.mark.parametrize("near", [(0.09, 0.02), (0.099, 0.09), (0.05, -0.3)])
def test_margins_that_cannot_matter_are_not_searched_for(
    near: tuple[float, float], tmp_path: Path
) -> None:
    """Oracle: what is asked for at every pose. On one side, at most 0.05 is attained."""
    chart, required = wrist(tmp_path), 0.1
    U = chart.cell.sample(64)
    label = function_of_label(chart, lambda U: near[0] + (near[1] - near[0]) * U[:, 0] ** 2)
    at = label.at(U)
    short = U[:, 0] < -0.5

    def measure(Q: np.ndarray) -> np.ndarray:
        x = 0.5 * np.cos(Q[:, 0]) + 0.4 * np.cos(Q[:, 0] + Q[:, 1])
        left = x < np.quantile(chart.cell.placements(U[short])[0][:, 0], 0.5)
        return np.minimum(Q[:, 2] - 0.4, np.where(left, 0.05, 0.5))[:, None]

    margin = margin_of(measure, required, 0.4, violators=8)
    order = np.argsort(margin.least(at))
    at, least = margins.rows_of(at, order), margin.least(at)[order]
    kept = least < required
    at, least = margins.rows_of(at, kept), least[kept]
    constraint = ActiveConstraint(margin, U)
    every = constraint._asked(chart, at)
    asked, missed = constraint._shortage(chart, at, least)
    assert np.array_equal(asked, every[: len(asked)])
    assert np.array_equal(missed, (every - least)[: len(asked)])
    too_short = constraint._too_short(every - least, every)
    assert too_short.any() == constraint._too_short(missed, asked).any()
    if too_short.any():
        assert np.array_equal(np.sort(missed)[-8:], np.sort(every - least)[-8:])


def test_poses_far_above_the_required_margin_are_not_searched(tmp_path: Path) -> None:
    chart = wrist(tmp_path)
    label = function_of_label(chart, lambda U: 0.25 + 0 * U[:, 0])
    for required, due in ((0.13, True), (0.12, False)):
        margin = margin_of(lambda Q: Q[:, 2:] - 0.4, required)
        constraint = ActiveConstraint(margin, chart.cell.sample(16) / 3)
        assert not constraint.short(label)
        assert (len(constraint.U) > 16) is due


def test_the_worst_poses_are_penalised_by_what_they_can_attain(tmp_path: Path) -> None:
    """The margin is the label, and on one side of the cell at most 0.8 of the required one, of
    which a tenth less is asked for."""
    chart, required = wrist(tmp_path), 0.1
    cell = chart.cell
    middle = cell.placement.translation[0]

    def measure(Q: np.ndarray) -> np.ndarray:
        x = 0.5 * np.cos(Q[:, 0]) + 0.4 * np.cos(Q[:, 0] + Q[:, 1])
        most = np.where(x < middle, 0.08, 0.5)
        return np.minimum(Q[:, 2] - 0.4, most)[:, None]

    margin = margin_of(measure, required, violators=30)
    constraint = ActiveConstraint(margin, np.round(0.9 * cell.sample(64), 3))
    for way in (1.0, -1.0):
        label = function_of_label(chart, lambda U, way=way: 0.02 * way * U[:, 0])
        before = constraint.edge.tolist()
        assert constraint.short(label)
        asked, least = (
            np.where(U[:, 0] < 0, 0.9 * 0.08, required) for U in (constraint.edge, constraint.U)
        )
        assert np.allclose(constraint.asked, asked, rtol=1e-3)
        short = least - 0.02 * way * constraint.U[:, 0]
        edge, every = constraint.edge.tolist(), constraint.U.tolist()
        bound = np.sort(short)[-30]
        assert all(u in edge for u, s in zip(every, short, strict=True) if s > bound + 1e-4)
        assert all(u in edge for u in before) and len(edge) <= len(before) + 30
        fresh = [short[every.index(u)] for u in edge if u not in before]
        assert min(fresh) > bound - 1e-4
    wide = replace(chart, cell=rp.Cell(cell.task, cell.placement, 0.3))
    partly = margins.CandidateFunction(wide, label.terms, label.a)
    there = partly.at(constraint.edge).found
    for function, kept in ((label, slice(None)), (partly, there)):
        penalty = constraint.penalty(function)
        assert np.array_equal(penalty.U, constraint.edge[kept])
        assert np.array_equal(penalty.asked, constraint.asked[kept])
    assert 0 < there.sum() < len(there)


def test_the_weight_of_the_penalties_ends_at_its_largest(tmp_path: Path) -> None:
    """It is multiplied by 10 in each round but the first, up to 1e5 in the last, from 100 on."""
    chart = wrist(tmp_path)
    G_d, U = rp.Pseudoinverse(chart.cell.task), chart.cell.sample(16)
    weights = [PenaltyMethod(G_d, chart, U, [], i).weight for i in range(1, 7)]
    assert weights == pytest.approx([1e5, 1e4, 1e3, 100, 100, 100], rel=1e-12)


# ---- the choice among designs --------------------------------------------------------------------


def fit_of(desired: rp.Inverse, **change: Any) -> CellFit:
    options = {"degree": 3, "limit_margin": 0.05, "body_distance": 0.0, "seed": 0}
    options |= {"sigma_min": 0.0, "samples": None, "held_out": 600, "keep": False}
    return CellFit(desired, **options | change)


@dataclass(frozen=True)
class Staged(CellFit):
    """A fit whose designs are given: a quick and a full one from each posture."""

    designs: tuple = ()

    def design(self, cell: Any, q: Any, *, quick: bool = False, guess: Any = ()) -> Any:
        of_quick, full = self.designs[int(q[0])]
        self.report(f"{'quick' if quick else 'full'} {int(q[0])}", 0.5)
        if guess:
            assert guess is of_quick and not quick
            self.report("with a guess", 0.5)
        return of_quick if quick else full


GOOD = {"coverage": 1.0, "limit_margin": 0.4 * 0.05, "limit_margin_worst": 0.0, "cost": 1.0}
GOOD |= {"body_distance": 0.0, "extra_speed": 0.0199, "failures": ()}


def staged(
    *designs: Any, postures: tuple = (), angle: str | float = "all"
) -> tuple[int, Any, list[str]]:
    """The posture that is chosen, its design, and what was told: of designs with good figures but
    for the given ones, which are those of the quick designs, too, unless two are given."""
    base = sector_design("one orientation" if angle == "all" else "another axis")

    def made(figures: Any) -> Any:
        if not isinstance(figures, dict):
            return figures
        figures = GOOD | figures
        reach = 2 * np.pi * figures.pop("around", 0.9)
        (turn,) = base.evaluation.turns
        turn = replace(turn, reach=reach, joint_range=7.0)
        return replace(base, evaluation=replace(base.evaluation, turns=(turn,), **figures))

    table = [tuple(made(x) for x in (one if isinstance(one, list) else [one, one]))
             for one in designs]  # fmt: skip
    told: list[str] = []
    fit = Staged(
        **vars(fit_of(base.desired)) | {"report": lambda what, _: told.append(what)},
        designs=tuple(table),
    )
    good = {"share": 1.0, "margin": 0.0, "body_distance": 0.0, "speed": 1.0}
    given = [*postures, *[{}] * (len(designs) - len(postures))]
    q, found = fit.best(
        base.cell, [Candidate(np.full(7, i), **good | p) for i, p in enumerate(given)]
    )
    assert any(found is one for one in table[int(q[0])])
    return int(q[0]), found, told


@pytest.mark.parametrize(
    "figures",
    [
        {"coverage": 0.99},
        {"limit_margin_worst": -0.01},
        {"limit_margin": 0.019},
        {"extra_speed": 0.03},
        {"extra_speed": 0.02},
        {"around": 0.85},
    ],
)
def test_other_postures_are_tried_where_the_first_design_is_not_good(figures: dict) -> None:
    """Good is: covered everywhere, 0.4 of the limit margin, 2 % joint speed, and 0.9 of the way
    round; or next to nothing covered, for which another posture is no help."""
    compared = ["posture 1 of 2", "posture 2 of 2", "full 1", "with a guess"]
    better = {"cost": 0.5, "extra_speed": 0.01}
    assert staged({}, better)[::2] == (0, ["full 0"])
    which, _, told = staged(figures, better)
    assert which == 1 and told == ["full 0", *compared]
    assert staged(figures)[::2] == (0, ["full 0"])  # there is no other posture
    assert staged(figures | {"coverage": 0.89}, {})[::2] == (0, ["full 0"])
    assert staged({"coverage": 0.9}, {})[0] == 1
    assert staged((), {})[::2] == (0, ["full 0"])  # reasons for failure
    worse = {"coverage": 0.5}  # the quick design promised more
    which, found, told = staged(figures, [better, worse])
    assert which == 0 and told[-1] == "with a guess" and found.coverage > 0.5


@pytest.mark.parametrize(
    ("first", "second", "best"),
    [
        ({"coverage": 0.95}, {"coverage": 0.96, "limit_margin_worst": -1.0}, 1),
        ({"limit_margin_worst": -0.1}, {"body_distance": -0.1}, 1),
        ({"body_distance": -0.1}, {"limit_margin": 0.0}, 1),
        ({"limit_margin": 0.018}, {"limit_margin": 0.019, "around": 0.2}, 1),
        ({"limit_margin": 0.03}, {"limit_margin": 0.05, "cost": 1.1}, 0),
        ({"around": 0.5}, {"around": 0.6, "cost": 9.0}, 1),
        ({"around": 0.5}, {"around": 0.52, "cost": 1.1}, 0),
        ({"around": 0.5}, {"around": 0.52, "cost": 0.9}, 1),
        ({"cost": 1.0}, {"cost": 0.9}, 1),
        ({"cost": 0.9}, {"cost": 1.0}, 0),
        ({"coverage": 0.95}, (), 0),
        ({"coverage": 0.95}, {"coverage": 0.0}, 0),
    ],
)
def test_the_best_design_is_chosen_in_this_order(first: Any, second: Any, best: int) -> None:
    """Coverage of held-out poses, of all, collisions, 0.4 of the limit margin that was asked for,
    the way round to 5 %, and the cost."""
    dear = {"extra_speed": 0.5}
    first, second = (dear | x if isinstance(x, dict) else x for x in (first, second))
    which, _, told = staged(first, second)
    assert which == best and "posture 2 of 2" in told
    if isinstance(second, dict) and second["extra_speed"] and "coverage" not in second:
        assert staged(second, first)[0] == 1 - best


def test_a_first_posture_beyond_the_limits_has_a_quick_design_first() -> None:
    """And if collisions are the only fault, only postures without them are compared."""
    beyond = ({"margin": -0.01},)
    low, high = {"cost": 0.5}, {"cost": 2.0}
    assert staged(low, postures=beyond)[::2] == (0, ["full 0"])
    which, _, told = staged([high, low], [low, high], postures=beyond)
    assert which == 0 and told == ["quick 0", "full 0", "with a guess"]
    dear = {"extra_speed": 0.5}
    which, _, told = staged([high | dear, low], [low | dear, high], postures=beyond)
    both = ["posture 1 of 2", "posture 2 of 2"]
    assert which == 1 and told == ["quick 0", *both, "full 1", "with a guess"]
    which, _, told = staged([low | dear, low], [high | dear, high], postures=beyond)
    assert which == 0 and told == ["quick 0", *both, "full 0", "with a guess"]
    colliding = {"body_distance": -0.01}
    others = ({}, {}, {"body_distance": -0.01}, {"share": 0.9})
    which, _, told = staged(colliding, high, low, low, postures=others)
    assert which == 1 and told[1:3] == both and "full 1" in told
    which, _, told = staged(colliding | dear, high, low, low, postures=others)
    assert which == 2 and "posture 4 of 4" in told


drawn: list[np.ndarray] = []
"""Poses that a watched cell was asked for."""


class WatchedCell(rp.Cell):
    def sample(self, count: int, seed: int = 0) -> np.ndarray:
        drawn.append(super().sample(count, seed))
        return drawn[-1]


@pytest.mark.parametrize(
    ("kind", "half_angle", "count"),
    [("pose", 0.1, 1024), ("pose", (0.1, 0.1, 0), 1024), ("axis", 0.1, 512)],
)
def test_a_fit_has_three_nodes_for_each_term(kind: str, half_angle: Any, count: int) -> None:
    """Rounded up to a power of 2. Without a degree, as many as the highest degree with at most 260
    unknowns needs: degree 4 of six coordinates has 210 terms, degree 5 of five has 252; for r = 2,
    degree 4 of five has 2 · 126 unknowns."""
    cell = WatchedCell(panda(kind), middle(kind), 3.0, half_angle)  # of which too little is reached
    q = rp.solve_ik(cell.task, Q_PANDA, cell.placement)
    drawn.clear()
    fit = fit_of(rp.Pseudoinverse(cell.task), degree="auto")
    assert isinstance(fit.design(cell, q), tuple)
    assert [len(U) for U in drawn] == [count]


def test_a_cost_has_at_least_256_nodes_and_three_for_each_term() -> None:
    """As many as the fit has, if these are fewer."""
    terms, U = [cell_fit.Monomials(6, degree) for degree in (1, 3, 4)], np.zeros((4096, 6))
    assert [len(cell_fit._nodes(U, each)) for each in terms] == [256, 256, 1024]
    assert len(cell_fit._nodes(U[:100], terms[0])) == 100


def test_the_first_chart_has_the_degree_at_which_its_directions_follow(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """In cells of two coordinates; elsewhere, or if none up to 14 does, it is the usual one."""
    task, q = planar_task([1.0, 0.9, 0.8], tmp_path), np.array([0.6, -1.2, 1.4])
    flat, solid = WatchedCell(task, task.placement(q), 0.1), cell_of("position")
    follows, tried = cell_fit._follows, []

    def degree_of(cell: rp.Cell, q: np.ndarray, enough: int) -> int:
        tried.clear()
        monkeypatch.setattr(
            cell_fit,
            "_follows",
            lambda chart, *_: tried.append(chart.monomials.degree) or tried[-1] >= enough,
        )
        fit = fit_of(rp.Pseudoinverse(cell.task))
        ends = cell_fit.rays(fit.desired, cell, q, cell.sample(128))
        return int(fit._first_chart(cell, q, ends, quick=True).monomials.degree)

    assert degree_of(flat, q, 4) == 4 and degree_of(flat, q, 6) == 6
    assert degree_of(flat, q, 99) == 4 and max(tried) == 14
    assert len(drawn[-1]) == 512  # a quarter of the poses of a full design
    assert degree_of(solid, rp.solve_ik(solid.task, Q_PANDA, solid.placement), 6) == 4
    # the cosine of the angle must exceed 0.4 at every pose
    chart, U = chart_of(flat, q, degree=4, count=64), flat.sample(16)
    N = kinematics.null_bases(chart.solve(U).J, chart.reference(U)[1])
    n_ref, across = N[3], np.linalg.svd(N[3])[0][:, 1:2]
    for cosine, result in ((1.0, True), (0.45, True), (0.35, False), (0.0, False)):
        N[3] = cosine * n_ref + np.sqrt(1 - cosine**2) * across
        assert follows(chart, U, N) is result


def test_the_last_chart_has_at_most_as_many_terms_as_allowed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Three coordinates have 56 terms of degree 5, and 84 of degree 6."""
    cell = cell_of("position")
    q = rp.solve_ik(cell.task, Q_PANDA, cell.placement)
    counts, dense = [], rp.Cell._dense_at_edges
    monkeypatch.setattr(
        rp.Cell, "_dense_at_edges", lambda *given: counts.append(given[1]) or dense(*given)
    )
    monkeypatch.setattr(cell_fit, "_MOST_TERMS", 60)
    monkeypatch.setattr(cell_fit, "_CLOSE", 0.0)
    chart = chart_of(cell, q, degree=4, count=128)
    terms = cell_fit.Monomials(3, 2)
    none = SimpleNamespace(a=np.zeros((terms.size, cell.task.r)))
    for quick, degree in ((False, 5), (True, 4)):
        last = cell_fit._recharted(cell, chart, none, terms, quick)
        assert last.monomials.degree == degree
    assert max(counts) == 256  # three for each term: directions of degree 4 are not steep


def test_poses_that_rays_miss_are_tried_from_the_ends_of_the_longest(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """From eight of them."""
    tried: list[tuple[Any, ...]] = []
    monkeypatch.setattr(cell_fit, "unreached", lambda *given: tried.append(given) or [])
    monkeypatch.setattr(cell_fit, "rays", lambda *given: stopped(given[-1]))
    cell = cell_of("position")

    def stopped(U: np.ndarray) -> Any:
        reached = np.linspace(1.0, 0.0, len(U))
        Q = Q_PANDA - 0.01 * (1 - reached[:, None])
        return cell_fit.Rays(U, Q, np.zeros((len(U), 7, 4)), reached, reached)

    assert fit_of(rp.Pseudoinverse(cell.task), samples=64).design(cell, Q_PANDA) == ()
    ((_, U, near, _),) = tried
    assert len(U) == 64 + len(cell.corners()) - 1
    assert np.allclose(near, Q_PANDA - 0.01 * np.arange(8)[:, None] / len(U), rtol=0, atol=1e-12)


def test_a_quick_design_has_a_lower_degree_and_fewer_poses(tmp_path: Path) -> None:
    """And no pose on which a design is evaluated was among those of its fit."""
    task, q = planar_task([1.0, 0.9, 0.8], tmp_path), np.array([0.6, -1.2, 1.4])
    drawn.clear()
    cell, fit = (WatchedCell(task, task.placement(q), 0.2), fit_of(rp.Pseudoinverse(task)))
    for quick, degree, samples, held_out in ((True, 2, 128, 512), (False, 3, 256, 600)):
        design = fit.design(cell, q, quick=quick)
        assert isinstance(design, rp.CellDesign)
        assert [d for d, _ in design.degrees] == [degree]
        assert (design.samples, design.held_out) == (samples, held_out)
        (at,) = (i for i, U in enumerate(drawn) if len(U) == held_out and i == len(drawn) - 1)
        others = np.concatenate(drawn[:at])
        assert not {*map(tuple, drawn[at])} & {*map(tuple, others)}
        drawn.clear()
    asked = fit_of(rp.Pseudoinverse(task), body_distance=0.1, sigma_min=0.3)
    for one, required in ((fit, {"joint limits": 0.05}),
                          (asked, {"joint limits": 0.05, "bodies": 0.1,
                                   "singularities": 0.3})):  # fmt: skip
        full, quick_ = (one.margins(cell, quick=quick) for quick in (False, True))
        assert {m.name: m.required for m in full} == required
        assert {m.name: m.required for m in quick_} == required
        assert quick_[0].starts < full[0].starts
        assert quick_[0].violators < full[0].violators


@pytest.mark.slow
def test_twenty_random_starts_find_nothing_better() -> None:
    cell = rp.Cell(panda(), middle(), (0.1, 0.15, 0.1), 0.3)
    desired, rng = rp.Pseudoinverse(panda()), np.random.default_rng(0)
    q = rp.solve_ik(panda(), Q_PANDA, middle())
    chart = chart_of(cell, q, 2, 512)
    cost = Cost(desired, chart, chart.monomials, cell.sample(512))
    zero = np.zeros((chart.monomials.size, 1))
    best, ended = descend(cost, zero).value.cost, []
    for _ in range(20):
        ended.append(descend(cost, 0.15 * rng.normal(size=zero.shape)).value.cost)
    finite = np.array(ended)[np.isfinite(ended)]
    print(best, np.sort(finite))
    assert len(finite) >= 15 and finite.min() > 0.99 * best


def test_bodies_are_sought_beside_every_corner() -> None:
    """A sector whose bodies met in 4 % of the spin, at one corner of radius and height alone, was
    called free of collisions. Every plane of two coordinates through every corner has poses."""
    task = panda()
    cell = rp.Cell(task, task.placement(Q_PANDA), 0.1, (0.1, 0.0, 0.0))
    count, k = 64, cell.k
    U = margins.with_edges(cell, count, 0, np.random.default_rng(0))
    corners = cell.corners()
    between = U[count : -len(corners)]
    assert np.array_equal(U[-len(corners) :], corners)
    inside = np.abs(between) < 1
    assert k == 4 and (inside.sum(axis=1) == 2).all()
    kinds = {tuple(np.where(row, 0, np.sign(u))) for row, u in zip(inside, between, strict=True)}
    assert len(kinds) == 6 * 4
    wide = np.abs(between[inside]) < 0.5
    assert 0.4 < wide.mean() < 0.6
