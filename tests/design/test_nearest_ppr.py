"""Section IV of the paper, (39) to (60), from the general engine.

The oracles are the paper's closed forms, written out here once more, and quadrature of our own.
"""

from __future__ import annotations

import numpy as np
import pytest
from controls import some

import repctl_pin as rp
from repctl_pin import redundancy

PI = np.pi
BELOW_PI = [(-0.5, 0.5), (0.2, 1.0), (-3.0, -1.1)]
ABOVE_PI = [(-2.0, 2.0), (-1.0, 3.0), (0.5, 5.0)]


@pytest.fixture(scope="module")
def task() -> rp.Task:
    return rp.Robot.load("ppr").task("tool", "xy")


@pytest.fixture(scope="module")
def some_q() -> np.ndarray:
    return np.random.default_rng(3).uniform(-2, 2, (20, 3))


def printed_inverse(task: rp.Task, k: float) -> rp.CustomInverse:
    """(60) as it is printed; for k = ∞ its limit, w₁ = 0 and w₂ = −cos θ₃/√2."""

    def G(q: np.ndarray) -> np.ndarray:
        s, c = np.sin(q[2]), np.cos(q[2])
        J = np.array([[1, 0, -s], [0, 1, c]])  # (40)
        n = np.array([s, -c, 1.0])
        if np.isinf(k):
            difference = np.outer(n, [0.0, -c]) / 2
        else:
            difference = (k * c + s) / (2 * (k * k + 1)) * np.outer(n, [1.0, -k])
        return J.T @ np.linalg.inv(J @ J.T) + difference

    return rp.CustomInverse(task, G)


@pytest.mark.parametrize(
    ("a", "b"), [(0.2, 1.0), (-3.0, -1.1), (0.2, 2.9), (-1.0, 3.0), (0.5, 5.0)]
)
def test_the_optimal_k_of_56_lacks_a_sign_in_print(a: float, b: float) -> None:
    """Issue 37, item 21: (56) with −C₂ is the minimum of (51); as printed, it is not.

    Oracles: (51) by Gauss–Legendre quadrature over a grid of φ = atan k, and the formula (59).
    """
    C_1, C_2 = ((np.cos(2 * a) - np.cos(2 * b)) / 2, (np.sin(2 * a) - np.sin(2 * b)) / 2)

    def cost(k: np.ndarray) -> np.ndarray:
        x, weights = np.polynomial.legendre.leggauss(40)
        theta = (a + b) / 2 + (b - a) / 2 * x
        square = (np.sin(theta) + k[..., None] * np.cos(theta)) ** 2
        return (b - a) / 2 * (square / (2 * (k[..., None] ** 2 + 1))) @ weights

    grid = np.tan(np.linspace(-PI / 2, PI / 2, 2001)[1:-1])
    assert np.allclose(  # (52) to (55)
        cost(grid), (C_1 * grid + C_2) / (2 * (grid**2 + 1)) + (b - a - C_2) / 4, atol=1e-12
    )
    half = (a + b) / 2
    due = -np.tan(half) if b - a < PI else 1 / np.tan(half)  # (59)
    root = np.hypot(C_1, C_2)
    right, printed = (-C_2 - root) / C_1, (C_2 - root) / C_1
    assert np.isclose(right, due) and cost(np.array(right)) <= cost(grid).min() + 1e-12
    assert cost(np.array(printed)) > cost(np.array(right)) + 1e-3


def test_the_cost_over_a_full_turn_is_half_of_pi() -> None:
    """Issue 37, item 21: the paper has π/4; the mean of ½ sin² over 2π is ¼."""
    theta = np.linspace(0, 2 * PI, 1000, endpoint=False)
    for k in (-3.0, 0.0, 0.7):
        square = (np.sin(theta) + k * np.cos(theta)) ** 2 / (2 * (k * k + 1))
        assert np.isclose(2 * PI * square.mean(), PI / 2)


def test_the_last_term_of_47_has_the_half_of_50() -> None:
    """Issue 52, item 26.17: ‖w‖² by (44) as a polynomial of w₂; its minimum is (50) only with ½."""
    theta, w2 = np.linspace(-PI, PI, 41)[:, None], np.linspace(-3, 3, 61)
    for k in (-3.0, 0.0, 0.7, 25.0):
        s = np.sin(theta) + k * np.cos(theta)
        square = (k * w2 + s / np.sqrt(2)) ** 2 + w2**2
        terms = (k * k + 1) * w2**2 + np.sqrt(2) * k * s * w2
        assert np.allclose(square, terms + s**2 / 2, rtol=1e-12, atol=1e-12)
        least = -((np.sqrt(2) * k * s) ** 2) / (4 * (k * k + 1))  # of the terms, over w₂
        due = s**2 / (2 * (k * k + 1))  # (50)
        assert np.allclose(least + s**2 / 2, due, atol=1e-12)
        assert np.abs(least + s**2 - due).max() > 0.4  # as printed


class Family:
    """The same without a loop: J⁺ + n̂ wᵀ with w of (48), (49)."""

    def __init__(self, task: rp.Task, k: float) -> None:
        self.task, self.phi = task, np.arctan(k)

    def __call__(self, q: np.ndarray) -> np.ndarray:
        return self.batch(q[None])[0]

    def velocity(self, q: np.ndarray, xdot: np.ndarray) -> np.ndarray:
        return self(q) @ xdot

    def batch(self, Q: np.ndarray, J: np.ndarray | None = None) -> np.ndarray:
        t = Q[:, 2]
        n = np.stack([np.sin(t), -np.cos(t), np.ones_like(t)], -1) / np.sqrt(2)
        w = np.sin(t + self.phi)[:, None] / np.sqrt(2) * [np.cos(self.phi), -np.sin(self.phi)]
        return rp.Pseudoinverse(self.task).batch(Q, J) + n[:, :, None] * w[:, None, :]


def k_star(a: float, b: float) -> float:
    """k* of (59)."""
    return (
        -np.tan((a + b) / 2)
        if b - a < PI
        else 1 / np.tan((a + b) / 2)
        if abs(a + b) > 1e-12
        else np.inf
    )


def mean_cost(a: float, b: float, k: float) -> float:
    """C(k) of (52) to (55) by the length of the interval; its limit for k = ∞."""
    C1 = 0.5 * (np.cos(2 * a) - np.cos(2 * b))
    C2 = 0.5 * (np.sin(2 * a) - np.sin(2 * b))
    C3 = 0.25 * (b - a - C2)
    first = 0.0 if np.isinf(k) else (C1 * k + C2) / (2 * (k * k + 1))
    return (first + C3) / (b - a)


def true_cost(design: rp.Design, a: float, b: float) -> float:
    """Mean ‖G_r − J⁺‖² over θ₃ alone, by 200 Gauss–Legendre nodes that the engine never saw."""
    x, w = np.polynomial.legendre.leggauss(200)
    Q = np.zeros((200, 3))
    Q[:, 2] = (a + b) / 2 + (b - a) / 2 * x
    difference = design.inverse.batch(Q) - rp.Pseudoinverse(design.task).batch(Q)
    return float(w / 2 @ np.sum(difference**2, axis=(1, 2)))


def engine(task: rp.Task, a: float, b: float, degree: int, **options) -> rp.Design:
    center, half = [0.0, 0.0, (a + b) / 2], [1.0, 1.0, (b - a) / 2]
    potentials = rp.Polynomial(center, 1, half, variables=[0, 1]) + rp.Polynomial(
        center, degree, half, variables=[2]
    )
    return rp.nearest_repeatable(
        rp.Pseudoinverse(task), potentials, rp.Box(center, half), options=rp.FitOptions(**options)
    )


# ---- (39) to (43): the arm ----------------------------------------------------------------------


def test_kinematics_and_null_vector(task: rp.Task, some_q: np.ndarray) -> None:
    for q in some_q:
        s, c = np.sin(q[2]), np.cos(q[2])
        # (39)
        assert np.allclose(task.placement(q).translation, [q[0] + c, q[1] + s, 0], atol=1e-14)
        assert np.allclose(task.jacobian(q), [[1, 0, -s], [0, 1, c]], atol=1e-14)  # (40)
        n = redundancy.null_vector(task.jacobian(q))
        assert np.allclose(n / np.sqrt(2), np.array([s, -c, 1]) / np.sqrt(2), atol=1e-14)  # (41)


def test_curl_of_the_null_vector(task: rp.Task, some_q: np.ndarray) -> None:
    def n(q: np.ndarray) -> np.ndarray:
        v = redundancy.null_vector(task.jacobian(q))
        return v / np.linalg.norm(v)

    e = 1e-5
    for q in some_q:
        # [k, i] = ∂n_i/∂q_k
        D = np.array([(n(q + e * d) - n(q - e * d)) / (2 * e) for d in np.eye(3)])
        curl = np.array([D[1, 2] - D[2, 1], D[2, 0] - D[0, 2], D[0, 1] - D[1, 0]])
        assert n(q) @ curl == pytest.approx(-0.5, abs=1e-9)  # (42)


def test_pseudoinverse_is_not_repeatable(task: rp.Task, some_q: np.ndarray) -> None:
    pseudoinverse = rp.Pseudoinverse(task)
    for q in some_q:
        assert np.linalg.norm(rp.bracket_defect(pseudoinverse, q)) == pytest.approx(
            1 / np.sqrt(8), rel=1e-12
        )
    assert not rp.is_repeatable(pseudoinverse, rp.Box(np.zeros(3), [1, 1, PI]))


# ---- (44) to (60): the family -------------------------------------------------------------------


@pytest.mark.parametrize("k", some([0.0, 1.0, -0.7, 25.0, np.inf], 1.0, np.inf))
def test_family_is_repeatable(task: rp.Task, k: float) -> None:
    verdict = rp.is_repeatable(printed_inverse(task, k), rp.Box(np.zeros(3), [1, 1, PI]))
    assert verdict and verdict.defect < 1e-7


@pytest.mark.parametrize("k", [0.0, 1.0, -0.7, 25.0, np.inf])
def test_family_is_what_the_paper_prints(task: rp.Task, some_q: np.ndarray, k: float) -> None:
    printed = printed_inverse(task, k).batch(some_q)
    assert np.allclose(Family(task, k).batch(some_q), printed, atol=1e-14)
    t = some_q[:, 2]
    difference = np.linalg.norm(printed - rp.Pseudoinverse(task).batch(some_q), 2, axis=(1, 2)) ** 2
    closed = (
        np.cos(t) ** 2 / 2 if np.isinf(k) else (np.sin(t) + k * np.cos(t)) ** 2 / (2 * (k * k + 1))
    )
    assert np.allclose(difference, closed, atol=1e-14)  # (50)
    if not np.isinf(k):
        n_hat = np.stack([np.sin(t), -np.cos(t), np.ones_like(t)], -1)[..., None] / np.sqrt(2)
        w = redundancy.null_component(printed, n_hat)[..., 0]
        # (44)
        assert np.allclose(
            w[:, 0], k * w[:, 1] + (np.sin(t) + k * np.cos(t)) / np.sqrt(2), atol=1e-13
        )
        assert np.allclose(w[:, 1], -k * w[:, 0], atol=1e-13)


# ---- the general engine -------------------------------------------------------------------------


@pytest.mark.parametrize("a, b", [BELOW_PI[2], pytest.param(*BELOW_PI[0], marks=pytest.mark.slow)])
def test_engine_finds_k_star_and_its_cost(task: rp.Task, a: float, b: float) -> None:
    k, C = k_star(a, b), mean_cost(a, b, k_star(a, b))
    excess = []
    for degree in (3, 5, 7):
        design = engine(task, a, b, degree, tolerance=1e-10)
        assert design.converged
        excess.append(true_cost(design, a, b) / C - 1)
        if degree == 5:
            ratio = design.coefficients[0, 0] / design.coefficients[1, 0]
            assert ratio == pytest.approx(k, rel=1e-4, abs=1e-4)
            assert abs(design.cost / C - 1) < 1e-4  # as it judges itself
            assert abs(excess[-1]) < 1e-4
    assert excess[0] > 10 * excess[1] > 100 * excess[2] > -1e-9 or excess[1] < 1e-7


def test_theorys_two_numbers(task: rp.Task) -> None:
    assert mean_cost(-0.5, 0.5, 0.0) == pytest.approx(0.0396322538, abs=5e-11)
    assert true_cost(engine(task, -0.5, 0.5, 3, tolerance=1e-10), -0.5, 0.5) == pytest.approx(
        0.0396327, abs=5e-8
    )


@pytest.mark.parametrize("a, b", [pytest.param(-2.0, 2.0, marks=pytest.mark.slow), (0.0, 2 * PI)])
def test_engine_is_honest_where_the_best_leaf_is_out_of_its_reach(
    task: rp.Task, a: float, b: float
) -> None:
    """The cost it reports is the true one, lies above C(k*), and still falls with the degree; or it
    refuses."""
    costs = []
    for degree in (3, 5, 7):
        try:
            design = engine(task, a, b, degree)
        except rp.SingularityError as error:
            assert "theta3 = " in str(error)
            continue
        costs.append(design.cost)
        assert abs(design.cost - true_cost(design, a, b)) < max(
            8 * design.cost_error, 1e-4 * design.cost
        )
        assert design.cost > 1.2 * mean_cost(a, b, 0.0 if b - a == 2 * PI else k_star(a, b))
    assert len(costs) < 3 or costs[0] > 1.01 * costs[1] > 1.005 * costs[2]


def test_products_of_joints_reach_the_leaf(task: rp.Task) -> None:
    """exp(d₁/2) tan(θ₃/2) exp(cos(θ₃)/2) is smooth on [−2, 2] and has θ₃ = 0 for a leaf: k = ∞ is
    in reach."""
    half = [1.0, 1.0, 2.0]
    potentials = rp.Polynomial(np.zeros(3), 6, half, variables=[0, 2])
    design = rp.nearest_repeatable(rp.Pseudoinverse(task), potentials, rp.Box(np.zeros(3), half))
    C = mean_cost(-2, 2, np.inf)
    assert design.cost == pytest.approx(C, rel=1e-2) and design.cost > C * (1 - 1e-4)
    # θ₃ = 0 is (nearly) kept
    assert np.linalg.norm(design.inverse(np.zeros(3)).T @ [0, 0, 1]) < 1e-2


@pytest.mark.slow
def test_all_joints_do_better(task: rp.Task) -> None:
    desired = rp.Pseudoinverse(task)
    design = rp.nearest_repeatable(
        desired, rp.Polynomial(np.zeros(3), 4, 1.0), rp.Box(np.zeros(3), 1.0)
    )
    assert mean_cost(-1, 1, 0.0) == pytest.approx(0.13634, abs=5e-6)
    assert design.converged and design.cost <= 0.0187
    g = np.linspace(-1, 1, 41)
    Q = np.stack(np.meshgrid(g, g, g, indexing="ij"), -1).reshape(-1, 3)
    J = task.jacobians(Q)
    n = redundancy.null_vector(J)[..., None] / np.sqrt(2)
    V = design.inverse.potentials.gradients(Q)
    side = np.einsum("kir,kir->k", n, V)
    assert (side * side[0] > 0).all()  # det(n̂ᵀ V) keeps its sign
    assert (
        redundancy.leaf_margin(n, V).min() > 0.9
        and design.leaf_margin <= redundancy.leaf_margin(n, V).min() + 5e-3
    )


@pytest.mark.slow
def test_the_engine_says_whether_its_potentials_are_rich_enough(task: rp.Task) -> None:
    """Short intervals settle at C(k*); on longer ones no smooth potential of this form is best, and
    it shows."""

    def designs(b: float, degrees: tuple[int, ...]) -> list:
        found = []
        for degree in degrees:
            half = [1.0, 1.0, b]
            potentials = rp.Polynomial(np.zeros(3), 1, half, variables=[0, 1])
            potentials = potentials + rp.Polynomial(np.zeros(3), degree, half, variables=[2])
            box = rp.Box(np.zeros(3), half)
            options = rp.FitOptions(samples=1000, held_out=1024)
            desired = rp.Pseudoinverse(task)
            found.append(rp.nearest_repeatable(desired, potentials, box, options=options))
        return found

    def settled(low: rp.Design, high: rp.Design) -> bool:
        return abs(high.cost - low.cost) < 1e-4 * high.cost

    assert settled(*designs(0.8, (5, 7)))
    assert not settled(*designs(2.0, (5, 7)))
