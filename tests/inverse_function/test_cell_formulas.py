"""Formulas of a cell's design that no public name states alone: the cost and its derivatives, the
penalties, the searches for poses and postures. Only this file imports them."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations, pairwise

import numpy as np
import pytest
from arms import Q_PANDA
from cell_functions import cell_of, chart_of, middle, panda
from sectors import found as sector_design

import repctl_pin as rp
from repctl_pin.inverse_function.cell_evaluation import evaluate_cell
from repctl_pin.inverse_function.cost import Cost, Penalty, descend
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
        assert again.value.cost > 0.999 * costs[-1].value.cost


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


def test_poses_with_a_leaf_margin_below_a_twentieth_are_not_covered() -> None:
    """n_ref is turned out of the null space until σ_min(Nᵀ n̂_ref) is as given."""
    cell = cell_of(half_width=0.001)
    q = rp.solve_ik(cell.task, Q_PANDA, cell.placement)
    chart = chart_of(cell, q, 1, 32)
    row = cell.task.jacobian(q)[0] / np.linalg.norm(cell.task.jacobian(q)[0])
    for margin, covered in ((0.1, 1.0), (0.03, 0.0)):
        coefficients = chart.coefficients.copy()
        coefficients[:, :, 1:] *= margin
        coefficients[0, :, 1] += row
        tilted = replace(chart, coefficients=coefficients)
        j = evaluate_cell(rp.Pseudoinverse(cell.task), tilted, 64, 1, quick=True)
        assert j.coverage == covered
        assert {stop.cause for stop in j.failures} == (set() if covered else {"fold"})
        assert not covered or j.leaf_margin == pytest.approx(margin, rel=0.1)


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
