"""Section IV of the paper, (39) to (60), from the general engine and from a search over the family
(60).

The oracles are the paper's closed forms, written out here once more, and quadrature of our own.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from arms import planar_task

import repctl_pin as rp
from repctl_pin import redundancy
from repctl_pin.design import cost_has_converged, nearest_in_family

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
    C_1, C_2 = (
        (np.cos(2 * a) - np.cos(2 * b)) / 2,
        (np.sin(2 * a) - np.sin(2 * b)) / 2,
    )

    def cost(k: np.ndarray) -> np.ndarray:
        x, weights = np.polynomial.legendre.leggauss(40)
        theta = (a + b) / 2 + (b - a) / 2 * x
        square = (np.sin(theta) + k[..., None] * np.cos(theta)) ** 2
        return (b - a) / 2 * (square / (2 * (k[..., None] ** 2 + 1))) @ weights

    grid = np.tan(np.linspace(-PI / 2, PI / 2, 2001)[1:-1])
    assert np.allclose(  # (52) to (55)
        cost(grid),
        (C_1 * grid + C_2) / (2 * (grid**2 + 1)) + (b - a - C_2) / 4,
        atol=1e-12,
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
        w = (
            np.sin(t + self.phi)[:, None]
            / np.sqrt(2)
            * [np.cos(self.phi), -np.sin(self.phi)]
        )
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
        rp.Pseudoinverse(task),
        potentials,
        rp.Box(center, half),
        options=rp.FitOptions(**options),
    )


# ---- (39) to (43): the arm ----------------------------------------------------------------------


def test_kinematics_and_null_vector(task: rp.Task, some_q: np.ndarray) -> None:
    for q in some_q:
        s, c = np.sin(q[2]), np.cos(q[2])
        assert np.allclose(
            task.placement(q).translation, [q[0] + c, q[1] + s, 0], atol=1e-14
        )  # (39)
        assert np.allclose(
            task.jacobian(q), [[1, 0, -s], [0, 1, c]], atol=1e-14
        )  # (40)
        n = redundancy.null_vector(task.jacobian(q))
        assert np.allclose(
            n / np.sqrt(2), np.array([s, -c, 1]) / np.sqrt(2), atol=1e-14
        )  # (41)


def test_curl_of_the_null_vector(task: rp.Task, some_q: np.ndarray) -> None:
    def n(q: np.ndarray) -> np.ndarray:
        v = redundancy.null_vector(task.jacobian(q))
        return v / np.linalg.norm(v)

    e = 1e-5
    for q in some_q:
        D = np.array(
            [(n(q + e * d) - n(q - e * d)) / (2 * e) for d in np.eye(3)]
        )  # [k, i] = ∂n_i/∂q_k
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


@pytest.mark.parametrize("k", [0.0, 1.0, -0.7, 25.0, np.inf])
def test_family_is_repeatable(task: rp.Task, k: float) -> None:
    verdict = rp.is_repeatable(
        printed_inverse(task, k), rp.Box(np.zeros(3), [1, 1, PI])
    )
    assert verdict and verdict.defect < 1e-7


@pytest.mark.parametrize("k", [0.0, 1.0, -0.7, 25.0, np.inf])
def test_family_is_what_the_paper_prints(
    task: rp.Task, some_q: np.ndarray, k: float
) -> None:
    printed = printed_inverse(task, k).batch(some_q)
    assert np.allclose(Family(task, k).batch(some_q), printed, atol=1e-14)
    t = some_q[:, 2]
    difference = (
        np.linalg.norm(printed - rp.Pseudoinverse(task).batch(some_q), 2, axis=(1, 2))
        ** 2
    )
    closed = (
        np.cos(t) ** 2 / 2
        if np.isinf(k)
        else (np.sin(t) + k * np.cos(t)) ** 2 / (2 * (k * k + 1))
    )
    assert np.allclose(difference, closed, atol=1e-14)  # (50)
    if not np.isinf(k):
        n_hat = np.stack([np.sin(t), -np.cos(t), np.ones_like(t)], -1)[
            ..., None
        ] / np.sqrt(2)
        w = redundancy.null_component(printed, n_hat)[..., 0]
        assert np.allclose(
            w[:, 0], k * w[:, 1] + (np.sin(t) + k * np.cos(t)) / np.sqrt(2), atol=1e-13
        )  # (44)
        assert np.allclose(w[:, 1], -k * w[:, 0], atol=1e-13)


@pytest.mark.parametrize("a, b", BELOW_PI[::2] + ABOVE_PI[:2])
def test_search_over_the_family_finds_k_star(task: rp.Task, a: float, b: float) -> None:
    found = nearest_in_family(
        rp.Pseudoinverse(task),
        lambda k: Family(task, k),
        rp.Box.between([-1, -1, a], [1, 1, b]),
    )
    k = k_star(a, b)
    assert found.unique
    assert (
        found.parameter == k
        if np.isinf(k)
        else found.parameter == pytest.approx(k, abs=1e-6)
    )
    assert found.cost == pytest.approx(mean_cost(a, b, k), rel=1e-10)
    assert found.cost_error < 1e-10 and found.scanned_costs.min() >= found.cost - 1e-12
    assert "scanned" not in repr(found) and f"cost={found.cost}" in repr(found)


@pytest.mark.parametrize("a, b", [(0.3, 0.3 + PI), (-PI, PI)])
def test_search_says_when_every_k_is_as_good(task: rp.Task, a: float, b: float) -> None:
    found = nearest_in_family(
        rp.Pseudoinverse(task),
        lambda k: Family(task, k),
        rp.Box.between([-1, -1, a], [1, 1, b]),
    )
    assert not found.unique and "every value" in found.summary()
    assert found.cost == pytest.approx(0.25, rel=1e-10)
    assert found.parameter == pytest.approx(0.0, abs=1e-12)  # the middle of the line


@pytest.mark.parametrize("samples", [100, 216, 1000])
def test_search_does_not_take_its_own_quadrature_error_for_a_preference(
    task: rp.Task, samples: int
) -> None:
    region = rp.Box.between([-1, -1, 0], [1, 1, 2 * PI])
    found = nearest_in_family(
        rp.Pseudoinverse(task), lambda k: Family(task, k), region, samples=samples
    )
    assert not found.unique


def test_search_within_bounds_and_over_potentials(task: rp.Task) -> None:
    """A family made of potentials; the best of a dense scan is the oracle. Outside the bounds
    nothing is taken."""
    potentials = rp.Polynomial(np.zeros(3), 1, 1.0)
    desired, region = rp.Pseudoinverse(task), rp.Box([0, 0, 0.5], [1, 1, 0.4])

    def family(k: float) -> rp.RepeatableInverse:
        return rp.RepeatableInverse(task, potentials.weighted([[k], [-0.8], [1.0]]))

    Q, w = region.nodes(1000, 5)
    G_d = desired.batch(Q)
    ks = np.linspace(-1, 2, 76)
    costs = np.array(
        [w @ np.sum((family(k).batch(Q) - G_d) ** 2, axis=(1, 2)) for k in ks]
    )
    best = ks[np.argmin(costs)]
    inside = nearest_in_family(desired, family, region, bounds=(-1, 2), samples=343)
    assert inside.parameter == pytest.approx(
        best, abs=0.04
    ) and inside.cost <= costs.min() * (1 + 1e-9)
    edge = nearest_in_family(
        desired, family, region, bounds=(best + 0.5, 2), samples=343
    )
    assert edge.parameter == best + 0.5
    # the best value of the scan is at a bound, and the best of all is not
    for ends in ((-1, inside.parameter + 0.01), (inside.parameter - 0.01, 2)):
        found = nearest_in_family(desired, family, region, bounds=ends, samples=343)
        assert found.parameter == pytest.approx(inside.parameter, abs=1e-5)


def test_search_returns_what_it_compared(task: rp.Task) -> None:
    """G_d and Ω as they were given, the member at the parameter, and ‖J⁺‖² = 1 + 1/2 as the unit of
    the distance: J Jᵀ has the eigenvalues 1 and 2 everywhere."""
    desired, made = rp.Pseudoinverse(task), []
    region = rp.Box.between([-1, -1, 0.2], [1, 1, 1.0])

    def family(k: float) -> Family:
        made.append((k, Family(task, k)))
        return made[-1][1]

    found = nearest_in_family(desired, family, region, samples=343)
    assert found.desired is desired and found.region is region
    assert any(one is found.inverse and k == found.parameter for k, one in made)
    assert found.relative_distance == pytest.approx(np.sqrt(found.cost / 1.5))
    due = [mean_cost(0.2, 1.0, k) for k in found.scanned]
    np.testing.assert_allclose(found.scanned_costs, due, rtol=1e-6)
    assert np.isinf(found.scanned[[0, -1]]).all() and len(found.scanned) > 16


def test_search_takes_the_middle_of_bounds_within_which_every_k_is_as_good(
    task: rp.Task,
) -> None:
    found = nearest_in_family(
        rp.Pseudoinverse(task),
        lambda k: Family(task, 0.7),
        rp.Box.between([-1, -1, 0.2], [1, 1, 1.0]),
        bounds=(1.0, 4.0),
        samples=64,
    )
    assert not found.unique and found.parameter == 2.5
    assert found.cost == pytest.approx(mean_cost(0.2, 1.0, 0.7), rel=1e-6)


def test_search_finds_the_desired_inverse_itself(task: rp.Task) -> None:
    """However narrow the bounds are, and with however few nodes: the cost there is 0."""
    best, region = 0.3, rp.Box.between([-1, -1, 0.2], [1, 1, 1.0])
    for samples, width in ((1, 1.0), (343, 1e-4)):
        found = nearest_in_family(
            Family(task, best),
            lambda k: Family(task, k),
            region,
            bounds=(best - 0.38 * width, best + width),
            samples=samples,
        )
        assert found.unique and found.cost < 1e-15
        assert found.parameter == pytest.approx(best, abs=2e-8)


@pytest.mark.parametrize("size", [1e-4, 1.0, 1e4])
def test_search_does_not_take_rounding_errors_for_a_preference(
    size: float, tmp_path: Path
) -> None:
    """In any unit of length: every member is G_d, multiplied by k and divided by it."""
    arm = planar_task([size, 0.9 * size, 0.8 * size], tmp_path)
    desired = rp.Pseudoinverse(arm)

    class Rounded(rp.Pseudoinverse):
        k = 1.0

        def batch(self, Q: np.ndarray, J: np.ndarray | None = None) -> np.ndarray:
            return super().batch(Q, J) * self.k / self.k

    def family(k: float) -> Rounded:
        made = Rounded(arm)
        made.k = k
        return made

    found = nearest_in_family(
        desired, family, rp.Box([0.3, 1.0, 0.8], 0.3), bounds=(1, 3), samples=64
    )
    assert np.ptp(found.scanned_costs) > 0 and found.relative_distance < 1e-14
    assert not found.unique and found.parameter == 2


def test_search_is_judged_on_nodes_of_its_own(task: rp.Task) -> None:
    """In a tube, whose nodes are random: eight times as many, none of them a node of the search."""
    nodes: list[np.ndarray] = []

    class Recorded(rp.Pseudoinverse):
        def batch(self, Q: np.ndarray, J: np.ndarray | None = None) -> np.ndarray:
            nodes.append(Q.copy())
            return super().batch(Q, J)

    samples = np.linspace([-0.5, 0, 0.3], [0.5, 0.2, 0.8], 9)
    found = nearest_in_family(
        Recorded(task), lambda k: Family(task, k), rp.Tube(samples, 0.2), samples=128
    )
    few, many = nodes
    assert len(few) == 128 and len(many) == 8 * 128
    assert not set(map(bytes, few)) & set(map(bytes, many))
    G_d = rp.Pseudoinverse(task)
    means = [  # of the closed form at the nodes, which have equal weights
        np.mean(np.sum((found.inverse.batch(Q) - G_d.batch(Q)) ** 2, axis=(1, 2)))
        for Q in nodes
    ]
    assert found.cost == pytest.approx(means[1])
    assert found.cost_error == pytest.approx(abs(means[1] - means[0]))
    said = found.summary()
    assert f"{found.cost:.6g} ± {found.cost_error:.1g}\n" in said
    assert f"parameter          {found.parameter:.6g}\n" in said
    share = re.search(r"relative distance +([\d.]+) ?%", said)
    assert float(share[1]) == pytest.approx(100 * found.relative_distance, rel=0.02)


def test_search_refuses_what_it_cannot_do(task: rp.Task) -> None:
    region = rp.Box(np.zeros(3), 1.0)
    for bounds in ((0.0, np.inf), (1.0, 1.0), (np.nan, 1.0)):
        with pytest.raises(rp.InputError, match="bounds"):
            nearest_in_family(
                rp.Pseudoinverse(task), lambda k: Family(task, k), region, bounds=bounds
            )

    with pytest.raises(rp.InputError, match="the family at k = 2 must be an inverse"):
        nearest_in_family(
            rp.Pseudoinverse(task), lambda k: [k], region, bounds=(2.0, 3.0)
        )

    class Broken(Family):
        def batch(self, Q: np.ndarray, J: np.ndarray | None = None) -> np.ndarray:
            raise rp.SingularityError("nowhere")

    with pytest.raises(rp.SingularityError, match="no member"):
        nearest_in_family(rp.Pseudoinverse(task), lambda k: Broken(task, k), region)


def test_search_passes_over_members_that_are_singular(task: rp.Task) -> None:
    a, b = BELOW_PI[0]
    best = k_star(a, b)

    class Partly(Family):
        def batch(self, Q: np.ndarray, J: np.ndarray | None = None) -> np.ndarray:
            if abs(np.tan(self.phi) - best) > 0.5:
                raise rp.SingularityError("elsewhere")
            return super().batch(Q, J)

    found = nearest_in_family(
        rp.Pseudoinverse(task),
        lambda k: Partly(task, k),
        rp.Box.between([-1, -1, a], [1, 1, b]),
        bounds=(best - 0.9, best + 0.8),
    )
    assert found.unique and found.parameter == pytest.approx(best, abs=1e-6)
    assert np.isinf(found.scanned_costs).any()


# ---- the general engine -------------------------------------------------------------------------


@pytest.mark.parametrize("a, b", BELOW_PI[::2])
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
    assert true_cost(
        engine(task, -0.5, 0.5, 3, tolerance=1e-10), -0.5, 0.5
    ) == pytest.approx(0.0396327, abs=5e-8)


@pytest.mark.parametrize("a, b", [(-2.0, 2.0), (0.0, 2 * PI)])
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
        assert design.cost > 1.2 * mean_cost(
            a, b, 0.0 if b - a == 2 * PI else k_star(a, b)
        )
    assert len(costs) < 3 or costs[0] > 1.01 * costs[1] > 1.005 * costs[2]


def test_products_of_joints_reach_the_leaf(task: rp.Task) -> None:
    """exp(d₁/2) tan(θ₃/2) exp(cos(θ₃)/2) is smooth on [−2, 2] and has θ₃ = 0 for a leaf: k = ∞ is
    in reach."""
    half = [1.0, 1.0, 2.0]
    potentials = rp.Polynomial(np.zeros(3), 6, half, variables=[0, 2])
    design = rp.nearest_repeatable(
        rp.Pseudoinverse(task), potentials, rp.Box(np.zeros(3), half)
    )
    C = mean_cost(-2, 2, np.inf)
    assert design.cost == pytest.approx(C, rel=1e-2) and design.cost > C * (1 - 1e-4)
    assert (
        np.linalg.norm(design.inverse(np.zeros(3)).T @ [0, 0, 1]) < 1e-2
    )  # θ₃ = 0 is (nearly) kept


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


def test_the_engine_says_whether_its_potentials_are_rich_enough(task: rp.Task) -> None:
    """Short intervals settle at C(k*); on longer ones no smooth potential of this form is best, and
    it shows."""

    def designs(b: float, degrees: tuple[int, ...]) -> list:
        found = []
        for degree in degrees:
            half = [1.0, 1.0, b]
            potentials = rp.Polynomial(np.zeros(3), 1, half, variables=[0, 1])
            potentials = potentials + rp.Polynomial(
                np.zeros(3), degree, half, variables=[2]
            )
            box = rp.Box(np.zeros(3), half)
            try:
                found.append(
                    rp.nearest_repeatable(
                        rp.Pseudoinverse(task),
                        potentials,
                        box,
                        options=rp.FitOptions(samples=1000, held_out=1024),
                    )
                )
            except rp.SingularityError as error:
                found.append(error)
        return found

    assert cost_has_converged(designs(0.8, (5, 7)))
    assert not cost_has_converged(designs(2.0, (5, 7)))
    refused = rp.SingularityError("it lies in Ω")
    assert not cost_has_converged(
        [*designs(0.8, (3,)), refused]
    )  # a refusal settles nothing
    with pytest.raises(rp.InputError, match="each of the designs"):
        cost_has_converged([3, refused])
    with pytest.raises(rp.InputError, match="designs must be a list of designs"):
        cost_has_converged(3)
    with pytest.raises(rp.InputError, match="at least two"):
        cost_has_converged(designs(0.8, (3,)))


def test_costs_have_converged_when_the_last_two_are_equal(
    panda_design: rp.Design,
) -> None:
    """By hand: |c − c'| < tolerance · c, of the last two designs alone, all of them converged."""

    def judged(*costs: float, converged: bool = True, **options: float) -> bool:
        designs = [replace(panda_design, cost=cost) for cost in costs]
        designs[0] = replace(designs[0], converged=converged)
        return cost_has_converged(designs, **options)

    assert judged(5.0, 100.009, 100.0) and judged(5.0, 100.0, 100.009)
    assert not judged(100.0, 100.0, 100.02) and not judged(5.0, 5.0, 1.0)
    assert not judged(0.01, 0.010009) and judged(0.01, 0.010009, tolerance=1e-3)
    assert not judged(3.0, 2.0, tolerance=0.5) and judged(3.0, 2.0, tolerance=0.6)
    assert not judged(2.0, 1.0, 1.0, converged=False)
