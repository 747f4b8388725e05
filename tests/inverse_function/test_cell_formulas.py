"""Formulas of a cell's design that no public name states alone: the cost and its derivatives, the
penalties, the searches for poses and postures. Only this file imports them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations, pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from arms import Q_PANDA, planar_task, planar_urdf
from cell_functions import cell_of, chart_of, middle, panda
from sectors import found as sector_design

import repctl_pin as rp
from repctl_pin.inverse_function.cell_evaluation import evaluate_cell
from repctl_pin.inverse_function.cell_fit import CellFit
from repctl_pin.inverse_function.cost import Cost, Penalty, descend, predicted_gain
from repctl_pin.inverse_function.margins import (
    CandidateFunction,
    Margin,
    distances_of,
    limits_of,
    lowest_distances,
    singular_values_of,
)
from repctl_pin.inverse_function.penalty import ActiveConstraint, PenaltyMethod
from repctl_pin.inverse_function.posture_search import (
    Candidate,
    chosen,
    judged,
    searched,
)


@pytest.mark.parametrize("kind", ["pose", "axis", "position"])
def test_gradient_of_the_cost_against_finite_differences(kind: str) -> None:
    """With the joint limits, the bodies and σ_min in it, each below what is asked for somewhere."""
    cell = cell_of(kind, 0.2 if kind != "position" else 0.0, 0.08)
    chart = chart_of(
        cell, rp.solve_ik(cell.task, Q_PANDA, cell.placement), degree=2, count=64
    )
    terms, edge = chart.monomials, 0.9 * cell.sample(8, 5)
    rng = np.random.default_rng(0)
    asked_for = [
        (limits_of(cell.task), 0.75),
        (distances_of(cell.task), 0.2),
        (singular_values_of(cell.task), 1.0),
    ]
    for parts, exact in [(asked_for[:1], 1e-5), (asked_for, 1e-3)]:
        kept = [
            Penalty(margin, edge, np.full(len(edge), asked)) for margin, asked in parts
        ]
        cost = Cost(
            rp.Pseudoinverse(cell.task), chart, terms, cell.sample(16), kept, weight=3.0
        )
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
            slope = (
                cost.value(a + 1e-5 * v).cost - cost.value(a - 1e-5 * v).cost
            ) / 2e-5
            assert gradient @ v.ravel() == pytest.approx(slope, rel=exact)
        assert np.linalg.eigvalsh(H).min() > -1e-9 * np.linalg.eigvalsh(H).max()


@pytest.mark.parametrize(("kind", "count"), [("pose", 40), ("position", 80)])
def test_the_matrix_of_the_cost_is_exact_where_the_cost_vanishes(
    kind: str, count: int
) -> None:
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
    mixed = (
        ends[1] - ends[-1]
    ) / 4  # vᵀ H w, in which the blocks of different labels meet
    assert mixed == pytest.approx(v.ravel() @ H @ w.ravel(), rel=1e-2)
    assert difference @ H @ difference == pytest.approx(ends[-1], rel=1e-4)
    assert predicted_gain(cost, v) == pytest.approx(1, rel=1e-2)


def test_a_penalty_counts_where_its_margin_is_missed() -> None:
    """Each kind with the mean over its own poses, times the weight. Where the margin is met, where
    there is no pose and where there is no weight, the cost and its derivatives are the same."""
    cell = cell_of()
    q = rp.solve_ik(cell.task, Q_PANDA, cell.placement)
    chart, limits = chart_of(cell, q, 1, 32), limits_of(cell.task)
    U, edge, desired = cell.sample(8), cell.sample(5, 5), rp.Pseudoinverse(cell.task)
    terms = chart.monomials
    a = 0.02 * np.random.default_rng(0).normal(size=(terms.size, 1))

    def of(*kept: Penalty, **weight: float) -> tuple:
        cost = Cost(desired, chart, terms, U, kept, **weight)
        value = cost.value(a)
        return value, *cost.model(value)

    missed = Penalty(limits, edge, np.linspace(0.5, 2.0, 5))
    met, nowhere = (
        Penalty(limits, edge, np.full(5, -9.0)),
        Penalty(limits, edge[:0], []),
    )
    free, gradient, H = of()
    for other in (of(met, nowhere, weight=3.0), of(missed, weight=0.0), of(missed)):
        assert other[0].cost == other[0].nearness == pytest.approx(free.cost, rel=1e-12)
        assert np.allclose(other[1], gradient, rtol=0, atol=1e-12 * abs(gradient).max())
        assert np.allclose(other[2], H, rtol=0, atol=1e-9 * abs(H).max())
    Q = CandidateFunction(chart, terms, a).at(edge).Q
    margins = np.minimum(Q - cell.task.lower, cell.task.upper - Q)
    short = np.maximum(0, np.linspace(0.5, 2.0, 5)[:, None] - margins)
    due = free.cost + 3.0 * (short**2).sum() / 5
    with_three = of(missed, nowhere, met, weight=3.0)[0]
    assert with_three.cost == pytest.approx(due, rel=1e-9)
    assert with_three.nearness == pytest.approx(free.cost, rel=1e-12)


def test_a_cost_is_infinite_where_the_function_is_missing_at_one_node(
    tmp_path: Path,
) -> None:
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
        found = CandidateFunction(chart, terms, a).at(U).found
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
        again = descend(
            Cost(desired, chart, terms, U), 0.1 * rng.normal(size=(terms.size, 1))
        )
        assert again.value.cost == pytest.approx(costs[-1].value.cost, rel=0.02)


def straight(
    G_d: rp.Pseudoinverse, cell: rp.Cell, q: np.ndarray, U: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Steps of G_d along ten points of the ray to each pose, and three at its end: the joints, the
    least limit margin on the way, and whether the pose is reached without a long step."""
    Q, least, good = [], [], []
    for u in U:
        here, low, there = q.copy(), np.inf, True
        for ahead in [*np.linspace(0.1, 1, 10), 1.0, 1.0, 1.0]:
            low = min(low, cell.task.limit_margin(here).min())
            step = G_d(here) @ cell.task.error(here, cell.at(ahead * u))
            there = there and np.abs(step).max() < 0.5
            here = here + step
        Q.append(here)
        least.append(low)
        good.append(there and np.abs(cell.task.error(here, cell.at(u))).max() < 1e-6)
    return np.array(Q), np.array(least), np.array(good)


@pytest.mark.parametrize(("half_width", "whole"), [(0.1, True), (0.35, False)])
def test_a_posture_is_judged_by_the_way_to_the_corners(
    half_width: float, whole: bool
) -> None:
    """The share of the corners that are reached, the margin met there and the mean of G_d's own
    speed; all corners of an easy cell are reached."""
    cell, G_d = cell_of(half_width=half_width), rp.Pseudoinverse(panda())
    q = rp.solve_ik(cell.task, Q_PANDA, cell.placement)
    beside = rp.solve_ik(cell.task, q + 0.02, cell.placement)
    (_, candidate), U = judged(G_d, cell, np.array([beside, q])), cell.corners()
    Q, least, good = straight(G_d, cell, q, U)
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
def test_the_best_posture_is_chosen_in_this_order(
    first: tuple, second: tuple, best: int
) -> None:
    """Share of the corners, collisions, limit margin, joint speed, distance from the reference."""
    near, far = np.full(7, 0.1), np.full(7, 0.5)
    two = [
        Candidate(q, share, margin, body_distance, speed)
        for q, (share, body_distance, margin, speed) in ((near, first), (far, second))
    ]
    for candidates in (two, two[::-1]):
        assert chosen(candidates, np.zeros(7)) is two[best]


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
    assert margin(stops["fold"].u[0]) <= 0.05 and "folds back" in str(stops["fold"])
    if covered.any():
        assert 0.05 < j.leaf_margin <= margin(U[covered, 0]).min() * 1.02


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
    assert j.extra_speed == pytest.approx(
        np.sqrt(squares.mean() / due.mean()) - 1, rel=1e-6
    )
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
    ends = [
        np.stack(x, axis=1) for x in ((along, 1 + 0 * along), (1 + 0 * along, along))
    ]
    U = np.concatenate([w * end for end in ends for w in (1, -1)])
    Q = rp.InverseFunction(chart).batch(U)
    least = np.linalg.svd(task.jacobians(Q), compute_uv=False).min(axis=1)
    assert np.abs(U[least.argmin()]).min() < 0.99
    assert least.min() * 0.999 < j.smallest_singular_value <= least.min() + 1e-7


def test_a_guess_leaves_out_no_pose_that_the_free_functions_violate() -> None:
    """The penalty is a mean over its poses, so fewer of them would weigh the others more."""
    cell = cell_of(half_width=0.15)
    q = rp.solve_ik(cell.task, Q_PANDA, cell.placement)
    chart = chart_of(cell, q, count=64)
    low, terms = (chart_of(cell, q, degree).monomials for degree in (2, 3))
    desired, U = rp.Pseudoinverse(cell.task), cell.sample(64, 1)
    free = [
        descend(Cost(desired, chart, t, U), np.zeros((t.size, 1))) for t in (low, terms)
    ]
    functions = [
        CandidateFunction(chart, t, descent.a)
        for t, descent in zip((low, terms), free, strict=True)
    ]
    bound = np.quantile(functions[1].at(U).Q[:, 2], 0.7)
    margin = Margin("joint 3", lambda Q: bound + 0.1 - Q[:, 2:3], 0.1, 0.4, 128, 16, 24)

    def constraint() -> ActiveConstraint:
        return ActiveConstraint(
            margin, np.concatenate([cell.sample(128, 3), cell.corners()])
        )

    due = constraint()
    assert [due.short(one) for one in reversed(functions)] == [True, True]
    guess = None
    for _ in range(2):  # without a guess, and from a function that violates nothing
        kept = constraint()
        fit = PenaltyMethod(desired, chart, U, [kept], 5)
        weights: list[float] = []

        def tell(*_: object, fit=fit, weights=weights) -> None:
            weights.append(fit.weight)

        found = fit.kept(free, terms, tell, guess=guess)
        assert found.steps > free[-1].steps
        assert weights[0] == (100 if guess is None else 1000)
        assert all(b in (a, min(10 * a, 1e5)) for a, b in pairwise(weights))
        assert weights[1] == 10 * weights[0]  # ten times in each round, up to 1e5
        assert {*map(tuple, due.edge)} <= {*map(tuple, kept.edge)}
        assert (
            margin.least(CandidateFunction(chart, terms, found.a).at(U)) > 0.08
        ).all()
        guess = low.fit(U, terms.values(U) @ found.a)


def test_postures_at_singularities_and_in_collision_are_left_out() -> None:
    xarm = rp.Robot.load("xarm7").task(
        "link_eef", "pose"
    )  # of its postures some are singular, in others links touch
    cell = rp.Cell(xarm, xarm.placement(xarm.reference), 0.03, 0.1)
    offered = searched(rp.Pseudoinverse(xarm), cell)
    q = offered[0].q
    assert 1 < len(offered) <= 4  # and no two of them are the same within the tolerance
    order = [
        (-c.share, c.body_distance < 0, -min(c.margin, 0.1), c.speed) for c in offered
    ]
    assert order[1:] == sorted(order[1:]) and order[0][:2] == min(order)[:2]
    for one, other in combinations(offered, 2):
        assert np.linalg.norm(one.q - other.q) > 0.3
    assert (
        np.abs(q - xarm.reference) <= np.pi
    ).all()  # not wound up: the joints turn by two pi
    s = np.linalg.svd(xarm.jacobian(q), compute_uv=False)
    assert rp.Bodies(xarm).nearest(q).distance > 0
    assert s[-1] > 0.01 * s[0] and np.abs(xarm.error(q, cell.placement)).max() < 1e-8


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


def test_the_lowest_body_distance_is_that_of_all() -> None:
    """Where hulls overlap, few bodies are tested, and the minimum is still that of all poses."""
    task = rp.Robot.load("xarm7").task("link_eef", "pose")
    rng, bodies = np.random.default_rng(0), rp.Bodies(task)
    for size in (0.1, 1.0):
        Q = task.reference + size * rng.normal(size=(40, task.n))
        exact = bodies.distances(Q)
        found, share = lowest_distances(bodies, Q)
        assert found.min() == exact.min()
        assert abs(share - (exact < 0).mean()) < 0.2
        assert (found >= exact - 1e-12).all() or exact.min() < 0
    # and of a configuration whose hulls overlap, in the middle of a cell, but no bodies
    q = np.array([-1.25, -0.15, 0.35, -0.1, -0.8, -0.87, 0.43])
    assert bodies.hull_distances(q[None])[0] < -0.005
    (one,) = judged(
        rp.Pseudoinverse(task), rp.Cell(task, task.placement(q), 1e-3), q[None]
    )
    assert one.share == 1 and one.body_distance >= 0


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


GOOD = {
    "coverage": 1.0,
    "limit_margin": 0.4 * 0.05,
    "limit_margin_worst": 0.0,
    "cost": 1.0,
}
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
        return replace(
            base, evaluation=replace(base.evaluation, turns=(turn,), **figures)
        )

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
def test_other_postures_are_tried_where_the_first_design_is_not_good(
    figures: dict,
) -> None:
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
def test_the_best_design_is_chosen_in_this_order(
    first: Any, second: Any, best: int
) -> None:
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


class Watched(rp.Cell):
    def sample(self, count: int, seed: int = 0) -> np.ndarray:
        drawn.append(super().sample(count, seed))
        return drawn[-1]


@pytest.mark.parametrize("half_angle", [0.1, (0.1, 0.1, 0)])
def test_a_fit_has_three_nodes_for_each_term(half_angle: Any) -> None:
    """Rounded up to a power of 2. Without a degree, as many as the highest degree with at most 260
    unknowns needs: degree 4 of six coordinates has 210 terms, degree 5 of five has 252."""
    cell = Watched(panda(), middle(), 3.0, half_angle)  # of which too little is reached
    q = rp.solve_ik(cell.task, Q_PANDA, cell.placement)
    drawn.clear()
    fit = fit_of(rp.Pseudoinverse(cell.task), degree="auto")
    assert isinstance(fit.design(cell, q), tuple)
    assert [len(U) for U in drawn] == [1024]


def test_a_quick_design_has_a_lower_degree_and_fewer_poses(tmp_path: Path) -> None:
    """And no pose on which a design is evaluated was among those of its fit."""
    task, q = planar_task([1.0, 0.9, 0.8], tmp_path), np.array([0.6, -1.2, 1.4])
    drawn.clear()
    cell, fit = Watched(task, task.placement(q), 0.2), fit_of(rp.Pseudoinverse(task))
    for quick, degree, samples, held_out in (
        (True, 2, 128, 512),
        (False, 3, 256, 600),
    ):
        design = fit.design(cell, q, quick=quick)
        assert isinstance(design, rp.CellDesign)
        assert [d for d, _ in design.degrees] == [degree]
        assert (design.samples, design.held_out) == (samples, held_out)
        (at,) = (
            i for i, U in enumerate(drawn) if len(U) == held_out and i == len(drawn) - 1
        )
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
