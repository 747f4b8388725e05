"""Newton, Levenberg–Marquardt and descent in a box, on problems whose solutions are known."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest

from repctl_pin.solvers import (
    Damping,
    Point,
    Step,
    StepLengths,
    descend_in_box,
    levenberg_marquardt,
    newton,
    newton_rows,
    solve_block_tridiagonal,
)

RNG = np.random.default_rng(3)


def cubic(Q: np.ndarray, goal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A system with one solution: x + x³ / 3 of a rotated x; its value and its Jacobian."""
    T = np.array([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])
    Y = Q @ T.T
    return Y + Y**3 / 3 - goal, (1 + Y**2)[..., :, None] * T


def newton_step(q: np.ndarray, goal: np.ndarray) -> np.ndarray:
    F, J = cubic(q, goal)
    return -np.linalg.solve(J, F)


@pytest.mark.parametrize("longest", [0.05, 0.3, 10.0])
def test_both_forms_of_newton_find_the_solution(longest: float) -> None:
    goals = RNG.normal(size=(20, 3))
    options = {"longest": longest, "tolerance": 1e-12, "iterations": 200}

    def steps(Q: np.ndarray, rows: np.ndarray) -> np.ndarray:
        F, J = cubic(Q, goals[rows])
        return -np.linalg.solve(J, F[..., None])[..., 0]

    start = RNG.normal(size=(20, 3))
    before = start.copy()
    Q, size = newton_rows(steps, start, **options)
    assert (size < 1e-12).all() and np.abs(cubic(Q, goals)[0]).max() < 1e-12
    assert np.array_equal(start, before)
    for k, goal in enumerate(goals):
        q = newton(lambda q, goal=goal: newton_step(q, goal), start[k], **options)
        assert q is not None and np.abs(q - Q[k]).max() < 1e-12


def test_no_step_of_newton_is_longer_than_allowed() -> None:
    visited = [np.zeros(3)]

    def step(q: np.ndarray) -> np.ndarray:
        visited.append(q.copy())
        return newton_step(q, np.full(3, 40.0))

    assert newton(step, np.zeros(3), longest=0.1, tolerance=1e-9, iterations=200) is not None
    assert np.abs(np.diff(visited, axis=0)).max() <= 0.1 + 1e-12


def test_newton_gives_up_where_it_cannot_go_on() -> None:
    nothing = np.full(3, np.nan)
    options = {"longest": 0.3, "tolerance": 1e-12, "iterations": 20}
    assert newton(lambda q: nothing, np.zeros(3), **options) is None
    assert newton(lambda q: np.ones(3), np.zeros(3), **options) is None  # does not converge
    Q, size = newton_rows(
        lambda Q, rows: np.where(rows[:, None] == 0, np.nan, -Q), np.ones((2, 3)), **options
    )
    assert np.isinf(size[0]) and np.array_equal(Q[0], np.ones(3)) and np.abs(Q[1]).max() < 1e-12


def test_newton_near_a_start_refuses_long_steps_and_slow_ones() -> None:
    options = {"longest": 0.3, "tolerance": 1e-12, "iterations": 50, "contraction": 0.7}
    goal = cubic(np.full(3, 0.1), np.zeros(3))[0]
    near = newton(lambda q: newton_step(q, goal), np.zeros(3), **options)
    assert near is not None and np.abs(near - 0.1).max() < 1e-12
    assert newton(lambda q: newton_step(q, goal), np.full(3, 2.0), **options) is None
    assert newton(lambda q: -0.2 * q, np.ones(3), **options) is None
    assert newton(lambda q: -0.5 * q, np.full(3, 0.5), **options) is not None


def test_newton_with_a_residual_never_raises_it() -> None:
    """|arctan q| has steps that overshoot beyond |q| = 1.39; the line search halves them."""
    left = []

    def residual(q: np.ndarray) -> float:
        return float(np.abs(np.arctan(q)).max())

    def step(q: np.ndarray) -> np.ndarray:
        left.append(residual(q))
        return -np.arctan(q) * (1 + q**2)

    start = np.array([3.0])
    options = {"longest": 1e9, "tolerance": 1e-12, "iterations": 60}
    assert np.abs(newton(step, start, residual=residual, **options)).max() < 1e-12
    assert (np.diff(left) < 0).all()
    stuck = newton(lambda q: np.ones(1), start, residual=residual, **options)
    assert np.array_equal(stuck, start)


@dataclass
class Rosenbrock:
    """``(1 − x)² + 100 (y − x²)²``: a curved valley with its minimum, 0, at (1, 1)."""

    wall: float = np.inf
    evaluated: list[np.ndarray] = field(default_factory=list)

    def residual(self, x: np.ndarray) -> np.ndarray:
        return np.array([1 - x[0], 10 * (x[1] - x[0] ** 2)])

    def merit(self, x: np.ndarray) -> float:
        return float(np.sum(self.residual(x) ** 2)) if x[0] < self.wall else np.inf

    def evaluate(self, x: np.ndarray) -> Point[None]:
        self.evaluated.append(x)
        cost = float(np.sum(self.residual(x) ** 2))
        return Point(cost, cost, bool(x[0] < self.wall), None, x)

    def model(self, at: Point[None]) -> tuple[np.ndarray, np.ndarray]:
        J = np.array([[-1.0, 0.0], [-20 * at.x[0], 10.0]])
        return J.T @ self.residual(at.x), J.T @ J

    def step(self, model: tuple[np.ndarray, np.ndarray], damping: float) -> Step:
        g, H = model
        H = H + damping * np.diag(np.diag(H))
        dx = -np.linalg.solve(H, g)
        return Step(dx, float(-2 * g @ dx - dx @ H @ dx), damping)


LINE_SEARCH = Damping(
    first=1e-4, smallest=1e-9, largest=1.0, negligible=0.0, good=0.5, fair=0.2, sufficient=1e-4,
    halvings=20,
)  # fmt: skip


@pytest.mark.parametrize("rules", [Damping(), LINE_SEARCH])
def test_levenberg_marquardt_follows_a_curved_valley(rules: Damping) -> None:
    problem, costs = Rosenbrock(), []
    found = levenberg_marquardt(
        problem,
        np.array([-1.2, 1.0]),
        rules,
        steps=200,
        tolerance=1e-9,
        enough=1e-24,
        report=lambda step, cost: costs.append(cost),
    )
    assert found.converged and np.abs(found.at.x - 1).max() < 1e-10
    assert costs[0] == found.start and (np.diff(costs) <= 0).all()


@pytest.mark.parametrize("rules", [Damping(), LINE_SEARCH])
def test_levenberg_marquardt_stays_where_steps_may_end(rules: Damping) -> None:
    found = levenberg_marquardt(
        Rosenbrock(wall=0.5), np.array([-1.2, 1.0]), rules, steps=200, tolerance=1e-9
    )
    assert -1.2 < found.at.x[0] < 0.5 and found.at.cost < found.start


def test_levenberg_marquardt_ends_where_no_step_is_left_or_the_start_is_none() -> None:
    class Wall(Rosenbrock):
        def evaluate(self, x: np.ndarray) -> Point[None]:
            point = super().evaluate(x)
            return point if len(self.evaluated) == 1 else Point(np.inf, np.inf, False, None, x)

        def merit(self, x: np.ndarray) -> float:
            return np.inf

    for rules in (Damping(), LINE_SEARCH):
        start = np.array([-1.2, 1.0])
        found = levenberg_marquardt(Wall(), start, rules, steps=200, tolerance=1e-9)
        assert not found.converged and found.steps == 0 and np.array_equal(found.at.x, start)
    nothing = levenberg_marquardt(
        Rosenbrock(), np.array([np.inf, 0.0]), Damping(), steps=9, tolerance=0.0
    )
    assert nothing.steps == 0 and not nothing.converged


LENGTHS = StepLengths(first=0.2, longest=0.5, shortest=1e-9, longer=1.5, shorter=3.0, steps=400)


@pytest.mark.parametrize("target", [[0.3, -0.4, 0.1], [2.0, -0.4, -5.0]])
def test_descent_in_a_box_ends_at_the_nearest_point_of_the_box(target: list[float]) -> None:
    goal = np.array(target)
    x = RNG.uniform(-1, 1, size=(12, 3))
    value = np.sum((x - goal) ** 2, axis=1)

    def trial(rows: np.ndarray, lengths: np.ndarray) -> np.ndarray:
        way = goal - x[rows]
        size = np.maximum(np.linalg.norm(way, axis=1), 1e-300)
        return np.clip(x[rows] + (lengths / size)[:, None] * way, -1, 1)

    def evaluate(rows: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        assert len(rows) == len(points) and np.abs(points).max() <= 1
        return np.sum((points - goal) ** 2, axis=1), np.ones(len(rows), bool)

    descend_in_box(x, value, trial, evaluate, LENGTHS)
    assert np.abs(x - np.clip(goal, -1, 1)).max() < 1e-4
    assert np.allclose(value, np.sum((x - goal) ** 2, axis=1))


def test_descent_in_a_box_keeps_to_allowed_points_and_stops_when_it_is_enough() -> None:
    x = np.array([[0.9], [0.8]])
    value, moved = x[:, 0].copy(), []
    descend_in_box(
        x,
        value,
        lambda rows, lengths: x[rows] - lengths[:, None],
        lambda rows, points: (points[:, 0], rows == 1),
        LENGTHS,
        enough=0.4,
        accepted=lambda rows, better: moved.append(rows[better]),
    )
    assert x[0, 0] == 0.9 and 0.0 < x[1, 0] <= 0.4
    assert all(1 in rows and 0 not in rows for rows in moved)


def test_a_descent_that_cannot_leave_its_corner_ends_at_once() -> None:
    x, tried = np.array([[1.0], [0.5]]), []

    def trial(rows: np.ndarray, lengths: np.ndarray) -> np.ndarray:
        tried.append(rows)
        return np.minimum(x[rows] + lengths[:, None], 1.0)

    descend_in_box(
        x, -x[:, 0], trial, lambda rows, points: (-points[:, 0], np.ones(len(rows), bool)), LENGTHS
    )
    assert sum(0 in rows for rows in tried) == 1 and (x == 1.0).all() and len(tried) < 6


@pytest.mark.parametrize("cyclic", [False, True])
@pytest.mark.parametrize("K, r", [(3, 1), (4, 2), (7, 3), (8, 1)])
def test_block_tridiagonal_systems(K: int, r: int, cyclic: bool) -> None:
    rng = np.random.default_rng(K)
    U, b = rng.normal(size=(K, r, r)), rng.normal(size=(K, r))
    S = rng.normal(size=(K, r, r))
    D = S + np.swapaxes(S, 1, 2) + 20 * np.eye(r)
    dense = np.zeros((K, r, K, r))
    for k in range(K):
        dense[k, :, k] += D[k]
        if cyclic or k < K - 1:
            dense[k, :, (k + 1) % K] += U[k]
            dense[(k + 1) % K, :, k] += U[k].T
    a = solve_block_tridiagonal(D, U, b, cyclic=cyclic)
    assert np.allclose(np.tensordot(dense, a, 2), b, atol=1e-12)
    with pytest.raises(np.linalg.LinAlgError):
        solve_block_tridiagonal(-D, U, b, cyclic=cyclic)
