"""The bracket defect: closed forms, two independent derivatives, measured loops, and honest
tolerances."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from arms import planar_task, spatial_task
from controls import some

import repctl_pin as rp
from repctl_pin.integrability import differentiate


def brackets(G: np.ndarray, dG: np.ndarray) -> np.ndarray:
    """[g_a, g_b] (4) of G (n, m) at [a, b], from ∂G/∂q (n, m, n)."""
    along = np.einsum("ibk,ka->abi", dG, G)
    return along - np.swapaxes(along, 0, 1)


def curl(task: rp.Task, q: np.ndarray) -> float:
    """``s = n_J · ∇×n_J`` from the defect of J⁺: ``−det(J Jᵀ) n_Jᵀ Δ₁₂``, by Lemma 2 and (B6)."""
    J, delta = task.jacobian(q), rp.bracket_defect(rp.Pseudoinverse(task), q)[0]
    return float(-np.linalg.det(J @ J.T) * rp.redundancy.null_vector(J) @ delta)


def relative_defect(strategy: object, q: np.ndarray) -> float:
    """The relative defect, of which a verdict reports the largest."""
    return float(np.linalg.norm(rp.bracket_defect(strategy, q, relative=True)))


def by_differences(task: rp.Task) -> rp.CustomInverse:
    """J⁺ as a function of which nothing is known."""
    return rp.CustomInverse(task, lambda q: np.linalg.pinv(task.jacobian(q)))


# ---- closed forms ------------------------------------------------------------------------------


def test_ppr_has_the_papers_curl_and_defect_everywhere() -> None:
    task = rp.Robot.load("ppr").task("tool", "xy")
    plain = rp.Pseudoinverse(task)
    for q in np.random.default_rng(0).uniform(-3, 3, (10, 3)):
        n_J = rp.redundancy.null_vector(task.jacobian(q))
        # (41)
        assert (
            np.abs(n_J / np.sqrt(2) - np.array([np.sin(q[2]), -np.cos(q[2]), 1]) / np.sqrt(2)).max()
            < 1e-12
        )
        assert abs(curl(task, q) / (n_J @ n_J) + 0.5) < 1e-12  # (42)
        assert abs(np.linalg.norm(rp.bracket_defect(plain, q)) - 1 / np.sqrt(8)) < 1e-12
        assert abs(rp.drift_per_area(plain, q)[0, 1] - 1 / np.sqrt(8)) < 1e-12


def test_prr_and_3r_have_the_papers_null_vectors_and_curls() -> None:
    """Δ_q = T Δ_ψ for q = T ψ, with ψ the paper's absolute angles."""
    prr = rp.Robot.load("prr").task("tool", "xy")
    weighted = rp.WeightedInverse(prr, rp.absolute_angles(prr))
    T = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 1.0]])
    three = rp.Robot.load("planar3r").task("tool", "xy")
    for q in np.random.default_rng(1).uniform(-3, 3, (20, 3)):
        _, b, c = q
        J = prr.jacobian(T @ q) @ T
        n_J = rp.redundancy.null_vector(J)
        assert np.abs(n_J - [np.sin(c - b), -np.cos(c), np.cos(b)]).max() < 1e-12  # (12)
        delta = np.linalg.solve(T, rp.bracket_defect(weighted, T @ q)[0])
        s = -np.linalg.det(J @ J.T) * n_J @ delta
        assert abs(s - (np.cos(c) - np.cos(b))) < 1e-11  # (13)
        n_J = rp.redundancy.null_vector(three.jacobian(q))
        printed = [np.sin(c), -np.sin(c) - np.sin(b + c), np.sin(b) + np.sin(b + c)]
        assert np.abs(n_J - printed).max() < 1e-12  # (18)
        s = -np.sin(b) + np.sin(c) * np.cos(b) + np.sin(c) * np.cos(b + c)
        assert abs(curl(three, q) - s) < 1e-11  # (17)


@pytest.mark.parametrize("count", some([4, 6], 4))
def test_no_gradient_vanishes_on_the_candidates_of_3r(count: int) -> None:
    """(20) on a grid, with ∂s/∂θ₂ of (19)."""
    task, e = rp.Robot.load("planar3r").task("tool", "xy"), 1e-4
    grid = np.linspace(-3, 3, count)  # not 0, where the arm is stretched
    for b, c in ((b, c) for b in grid for c in grid):
        q = np.array([0.4, b, c])
        first, second, _ = (
            (curl(task, q + e * d) - curl(task, q - e * d)) / (2 * e) for d in np.eye(3)
        )
        printed = -np.cos(b) - np.sin(b) * np.sin(c) - np.sin(c) * np.sin(b + c)
        assert abs(second - printed) < 1e-6 and abs(first) < 1e-6  # (19)
        right = 1 + 2 * np.sin(c) ** 2 * (2 + np.cos(c))
        assert abs(curl(task, q) ** 2 + second**2 - right) < 1e-5 and right >= 1  # (20)


# ---- two derivatives that do not know each other
# ----------------------------------------------------


@pytest.mark.parametrize(
    "name, kind", [("panda", "pose"), ("panda", "axis"), ("xarm7", "position"), ("tiago", "pose")]
)
def test_the_formula_and_differences_agree_within_their_error(name: str, kind: str) -> None:
    task = rp.Robot.load(name).task(None, kind)
    Q = task.reference + 0.1 + 0.2 * np.random.default_rng(2).uniform(-1, 1, (3, task.n))
    plain, differences = rp.Pseudoinverse(task), by_differences(task)
    for q in Q:
        exact, rough = (rp.bracket_defect(one, q) for one in (plain, differences))
        assert np.abs(exact - rough).max() < 1e-7 * np.abs(exact).max()  # accurate
        box = rp.Box(q, 1e-9)
        verdict, doubtful = (rp.is_repeatable(one, box, samples=1) for one in (plain, differences))
        assert verdict.exact and not doubtful.exact
        assert doubtful.tolerance < 1e-5 * doubtful.defect
        gap = abs(verdict.defect - doubtful.defect)
        assert gap <= (verdict.tolerance + doubtful.tolerance) / 2  # and honest


def test_the_transpose_gives_the_same_verdict(tmp_path: Path) -> None:
    """Corollary 1: brackets of Jᵀ, with no inverse in them, are those of J⁺ seen through (J Jᵀ)."""
    task = spatial_task(6, tmp_path, seed=3)
    q = np.random.default_rng(3).uniform(-0.5, 0.5, 6)
    J, H = task.jacobian(q), task.hessian(q)
    onto_null = np.eye(6) - np.linalg.pinv(J) @ J
    of_transpose = brackets(J.T, np.swapaxes(H, 0, 1)) @ onto_null
    delta = np.zeros((3, 3, 6))
    for (a, b), pair in zip(
        ((0, 1), (0, 2), (1, 2)), rp.bracket_defect(rp.Pseudoinverse(task), q), strict=True
    ):
        delta[a, b], delta[b, a] = pair, -pair
    gram = J @ J.T  # Jᵀ = J⁺ (J Jᵀ)
    assert np.allclose(of_transpose, np.einsum("pa,qb,pqi->abi", gram, gram, delta), atol=1e-12)
    assert np.abs(of_transpose).max() > 1e-2


def test_the_bracket_form_is_the_curl_form() -> None:
    """(B6): g_3 · ∇×g_3 = −g_3ᵀ [g_1, g_2] with g_3 = g_1 × g_2, for an inverse that is not J⁺; the
    defect Δ₁₂ has the bracket's part along g_3."""
    task, e = rp.Robot.load("planar3r").task("tool", "xy"), 1e-5
    weighted = rp.WeightedInverse(task, [1.0, 2.0, 5.0])

    def g_3(q: np.ndarray) -> np.ndarray:
        return np.cross(*weighted(q).T)

    for q in np.random.default_rng(4).uniform(0.4, 1.4, (5, 3)):
        d = np.array([(g_3(q + e * x) - g_3(q - e * x)) / (2 * e) for x in np.eye(3)])
        curl = [d[1, 2] - d[2, 1], d[2, 0] - d[0, 2], d[0, 1] - d[1, 0]]
        s = g_3(q) @ curl
        delta = rp.bracket_defect(weighted, q)[0]
        assert np.isclose(s, -g_3(q) @ delta, rtol=1e-6, atol=1e-9) and abs(s) > 1e-4


@pytest.mark.parametrize("name, kind", [("panda", "pose"), ("prr", "xy"), ("planar7r", "xy")])
def test_the_defect_of_a_constant_weight_is_exact(name: str, kind: str) -> None:
    """Differences of J⁺_M know no formula, and agree with it."""
    task = rp.Robot.load(name).task(None, kind)
    T = np.eye(task.n) + 0.3 * np.random.default_rng(5).normal(size=(task.n, task.n))
    M = np.linalg.inv(T @ T.T)
    weighted = rp.WeightedInverse(task, (M + M.T) / 2)
    q = task.reference + 0.1
    differences = rp.bracket_defect(rp.CustomInverse(task, weighted), q)
    found = rp.bracket_defect(weighted, q)
    assert np.allclose(found, differences, rtol=0, atol=1e-9 * np.abs(differences).max())
    assert "exact derivative" in rp.is_repeatable(weighted, rp.Box(q, 0.1), samples=4).summary()


def test_the_potentials_second_derivatives(panda_pose: rp.Task, q_panda: np.ndarray) -> None:
    for degree in (1, 2, 3, 4):
        potentials = rp.Polynomial(q_panda, degree, 0.5)
        h = potentials.weighted(np.random.default_rng(degree).normal(size=(potentials.size, 2)))
        q, e = q_panda + 0.1, 1e-5
        slope = np.stack(
            [(h.gradient(q + e * d) - h.gradient(q - e * d)) / (2 * e) for d in np.eye(7)], axis=1
        )
        assert np.allclose(h.hessian(q), slope, atol=1e-6 * max(1, np.abs(slope).max()))


# ---- what the defect means
# ---------------------------------------------------------------------------


def test_panda_drifts_as_the_small_loop_law_says(panda_pose: rp.Task, q_panda: np.ndarray) -> None:
    plain = rp.Pseudoinverse(panda_pose)
    delta = rp.bracket_defect(plain, q_panda)[0]
    assert abs(np.linalg.norm(delta) - 6.986) < 5e-4
    assert np.isclose(rp.drift_per_area(plain, q_panda)[0, 1], np.linalg.norm(delta), rtol=1e-12)
    rest = []
    for side in (0.02, 0.01, 0.005):
        corners = [[side, 0, 0], [side, side, 0], [0, side, 0]]  # a → b → −a → −b
        motion = rp.follow(
            plain, rp.polygon(panda_pose, q_panda, corners), q_panda, cycles=1, steps=40
        )
        rest.append(np.linalg.norm((motion.q[-1] - q_panda) / side**2 - delta))
    assert rest[-1] < 0.02 * np.linalg.norm(delta)
    assert all(1.8 < a / b < 2.2 for a, b in pairwise(rest))  # first order in the side


@pytest.mark.parametrize(
    "name, kind, r",
    [
        ("panda", "pose", 1),
        pytest.param("xarm7", "pose", 1, marks=pytest.mark.slow),
        pytest.param("xarm7", "position", 4, marks=pytest.mark.slow),
        pytest.param("tiago", "pose", 2, marks=pytest.mark.slow),
    ],
)
def test_designed_inverses_have_no_defect_where_the_pseudoinverse_has(
    name: str, kind: str, r: int
) -> None:
    task = rp.Robot.load(name).task(None, kind)
    assert task.r == r
    center = task.reference + np.where(task.revolute, 0.3, 0.0)
    plain, box = (rp.Pseudoinverse(task), rp.Box(center, np.where(task.revolute, 0.1, 0.03)))
    # fewer potentials, so that it does not take long
    variables = [0, 2, 3, 4, 6] if r == 4 else None
    potentials = rp.Polynomial(center, 2, box.half_width, variables=variables)
    inverse = rp.nearest_repeatable(
        plain, potentials, box, options=rp.FitOptions(samples=2048)
    ).inverse
    Q = box.random(8, 1)
    assert min(np.abs(rp.bracket_defect(plain, q)).max() for q in Q) > 1e-2
    # by differences too, which know nothing of potentials
    for one in (inverse, rp.CustomInverse(task, inverse)):
        assert max(np.abs(rp.bracket_defect(one, q)).max() for q in Q) < 1e-8
    verdict = rp.is_repeatable(inverse, box, samples=32)
    assert verdict and verdict.exact and verdict.defect <= verdict.tolerance < 1e-8
    assert not rp.is_repeatable(plain, box, samples=32)


def test_the_relative_defect_is_free_of_units_and_axes(
    panda_pose: rp.Task, q_panda: np.ndarray, tmp_path: Path
) -> None:
    plain = rp.Pseudoinverse(panda_pose)
    turned = q_panda + np.array([0.7, 0, 0, 0, 0, 0, 0])  # turns the world axes under the arm
    here, there = (rp.bracket_defect(plain, q)[:3] for q in (q_panda, turned))
    assert np.isclose(relative_defect(plain, q_panda), relative_defect(plain, turned), rtol=1e-10)
    a, b = (np.linalg.norm(pairs, axis=-1) for pairs in (here, there))
    assert np.abs(a - b).max() > 0.1
    q = np.array([0.3, 0.8, -1.1])
    metres, millimetres = (
        rp.Pseudoinverse(planar_task(lengths, tmp_path))
        for lengths in ([1, 0.7, 0.5], [1000, 700, 500])
    )
    one, other = (relative_defect(plain, q) for plain in (metres, millimetres))
    assert np.isclose(one, other, rtol=1e-9)
    assert np.allclose(
        rp.bracket_defect(metres, q), 1e6 * rp.bracket_defect(millimetres, q), rtol=1e-9
    )
    verdict = rp.is_repeatable(metres, rp.Box(q, 0.2), samples=8)
    assert verdict.defect == pytest.approx(relative_defect(metres, verdict.at))


# ---- verdicts
# ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("k", some([-2.0, 0.0, 0.7, 1.0, 30.0, np.inf], 0.7, np.inf))
def test_the_papers_family_is_repeatable_for_every_k(k: float) -> None:
    task = rp.Robot.load("ppr").task("tool", "xy")

    def G(q: np.ndarray) -> np.ndarray:
        s, c = np.sin(q[2]), np.cos(q[2])
        # √2 (48), (49)
        w = np.array([0, -c]) if np.isinf(k) else np.array([1, -k]) * (k * c + s) / (k**2 + 1)
        return np.linalg.pinv(task.jacobian(q)) + np.outer([s, -c, 1], w) / 2

    box = rp.Box([0, 0, 0.2], [0.5, 0.5, 1.0])
    verdict = rp.is_repeatable(rp.CustomInverse(task, G), box, samples=32)
    assert verdict and not verdict.exact and verdict.tolerance < 1e-6
    against = rp.is_repeatable(rp.Pseudoinverse(task), box, samples=32)
    assert not against and against.defect > 0.1
    assert "not repeatable" in against.summary() and "not" not in verdict.summary()


def test_a_small_defect_is_seen_and_noise_is_refused(
    panda_design: rp.Design, q_panda: np.ndarray
) -> None:
    task, inverse, box = panda_design.task, panda_design.inverse, rp.Box(q_panda, 0.1)
    difference = rp.Pseudoinverse(task)

    def mixed(q: np.ndarray, share: float = 1e-6) -> np.ndarray:
        return (1 - share) * inverse(q) + share * difference(q)

    verdict = rp.is_repeatable(rp.CustomInverse(task, mixed), box, samples=16)
    assert not verdict and 1e-8 < verdict.defect < 1e-4
    assert task.n == len(verdict.at) and (np.abs(verdict.at - q_panda) <= 0.1).all()
    rng = np.random.default_rng(6)

    def noisy(q: np.ndarray) -> np.ndarray:
        return inverse(q) + 1e-4 * rng.normal(size=(7, 6))

    with pytest.raises(rp.InputError, match="too noisy"):
        rp.is_repeatable(rp.CustomInverse(task, noisy, tolerance=1), box, samples=16)


@pytest.mark.parametrize("noise", [0.0, 1e-12, 1e-9, 1e-6, 1e-3])
def test_the_error_of_a_difference_is_not_understated(noise: float) -> None:
    rng = np.random.default_rng(7)

    def function(Q: np.ndarray) -> np.ndarray:
        smooth = np.stack(
            [np.sin(3 * Q[:, 0]) * np.exp(Q[:, 1]), 1 / (1.2 + Q[:, 0] * Q[:, 1])], axis=-1
        )
        return smooth + noise * rng.uniform(-1, 1, smooth.shape)

    Q = rng.uniform(-0.5, 0.5, (200, 2))
    x, y = Q.T
    true = np.stack(
        [
            np.stack([3 * np.cos(3 * x) * np.exp(y), np.sin(3 * x) * np.exp(y)], -1),
            np.stack([-y, -x], -1) / (1.2 + x * y)[:, None] ** 2,
        ],
        axis=1,
    )
    slope, error = differentiate(function, Q, np.ones(2))
    off = np.abs(slope - true).max(axis=1)
    # an estimate, not a bound: two values a point leave noise the odd lucky agreement
    assert (off <= error).all() if noise == 0 else np.mean(off <= 3 * error) > 0.99
    assert np.median(error) < max(1e-11, 500 * noise)


def test_a_difference_is_not_fooled_by_a_pole_nearby() -> None:
    distance = np.array([1.0, 0.3, 0.1, 0.05, 0.03, 0.01, 0.005, 0.002, 0.001])
    slope, error = differentiate(lambda Q: 1 / Q[:, 0], distance[:, None], np.ones(1))
    true = -1 / distance**2
    assert (np.abs(slope[:, 0] - true) <= error[:, 0]).all()
    assert (error[:, 0] < 1e-5 * np.abs(true)).all()


def test_a_difference_keeps_clear_of_a_singularity_nearby() -> None:
    def function(Q: np.ndarray) -> np.ndarray:
        if (Q[:, 0] <= 0).any():
            raise rp.SingularityError("here")
        return np.sqrt(Q)

    slope, error = differentiate(function, np.array([[0.02]]), np.ones(1))
    assert abs(slope[0, 0, 0] - 0.5 / np.sqrt(0.02)) <= error[0, 0] < 1e-6
    with pytest.raises(rp.SingularityError):
        differentiate(function, np.array([[1e-9]]), np.ones(1))


def test_what_cannot_be_judged_is_refused(panda_pose: rp.Task, q_panda: np.ndarray) -> None:
    posture = rp.PostureControl(panda_pose, q_panda)
    with pytest.raises(rp.InputError, match="strategy must be an inverse .*PostureControl"):
        rp.is_repeatable(posture, rp.Box(q_panda, 0.1))
    with pytest.raises(rp.InputError, match="3 joints, but the task has 7"):
        rp.is_repeatable(rp.Pseudoinverse(panda_pose), rp.Box(np.zeros(3), 0.1))
    with pytest.raises(rp.InputError, match="shape"):
        rp.bracket_defect(rp.Pseudoinverse(panda_pose), q_panda[:5])


def test_a_custom_inverse_is_checked(panda_pose: rp.Task, q_panda: np.ndarray) -> None:
    good = rp.CustomInverse(panda_pose, lambda q: np.linalg.pinv(panda_pose.jacobian(q)))
    xdot = np.arange(6.0)
    assert np.allclose(
        good.velocity(q_panda, xdot),
        rp.Pseudoinverse(panda_pose).velocity(q_panda, xdot),
        atol=1e-12,
    )
    assert np.allclose(good.batch(q_panda[None])[0], good(q_panda), atol=0)
    bad = rp.CustomInverse(panda_pose, lambda q: panda_pose.jacobian(q).T)
    J = panda_pose.jacobian(q_panda)
    missed = np.abs(J @ J.T - np.eye(6)).max()
    with pytest.raises(rp.InputError, match=f"J G differs from I by {missed:.2g}"):
        bad(q_panda)
    for wrong in (lambda q: np.eye(7), lambda q: np.full((7, 6), np.nan), lambda q: "no"):
        with pytest.raises(rp.InputError, match="7 × 6"):
            rp.CustomInverse(panda_pose, wrong)(q_panda)
    with pytest.raises(rp.InputError, match="function"):
        rp.CustomInverse(panda_pose, 3)  # type: ignore[arg-type]
    with pytest.raises(rp.InputError, match="tolerance"):
        rp.CustomInverse(panda_pose, lambda q: q, tolerance=0)


@pytest.mark.parametrize("kind", ["pose", "position"])
def test_an_extended_jacobian_is_repeatable(
    panda: rp.Robot, q_panda: np.ndarray, kind: str
) -> None:
    """Its potentials know no second derivatives, so differences are taken of G itself."""
    task = panda.task(None, kind)
    verdict = rp.is_repeatable(rp.ExtendedJacobian(task, q_panda), rp.Box(q_panda, 0.1), samples=8)
    assert verdict and not verdict.exact and verdict.tolerance < 1e-5


@pytest.mark.parametrize("robot, kind", [("ur5", "pose"), ("planar3r", "position")])
def test_an_arm_without_redundancy_repeats_by_itself(robot: str, kind: str, tmp_path: Path) -> None:
    task = (
        rp.Robot.load("ur5").task(None, "pose")
        if robot == "ur5"
        else planar_task((1, 0.7), tmp_path)
    )
    q = np.array([0.1, -1.2, 1.3, -0.9, -1.1, 0.2])[: task.n] + (0.0 if robot == "ur5" else 1.6)
    assert task.r == 0
    found = rp.is_repeatable(rp.Pseudoinverse(task), rp.Box(q, 0.1), samples=16)
    assert found and found.defect == 0 and "r = 0" in found.summary()
    assert not rp.bracket_defect(rp.Pseudoinverse(task), q).any()


def test_near_a_limit_the_differences_stay_inside(panda_pose: rp.Task, q_panda: np.ndarray) -> None:
    desired = rp.WeightedInverse(panda_pose, rp.LimitWeight(panda_pose))
    for room in (0.03, 1e-3):
        q = q_panda.copy()
        q[3] = panda_pose.upper[3] - room
        found = rp.is_repeatable(desired, rp.Box(q, room / 2), samples=8)
        assert not found and found.defect > 100 * found.tolerance


def test_near_a_singularity_it_is_the_singularity_that_is_blamed() -> None:
    task = rp.Robot.load("planar3r").task("tool", "xy")
    with pytest.raises(rp.SingularityError, match="σ_min.*too close to a singularity"):
        rp.is_repeatable(
            rp.WeightedInverse(task, lambda q: [1, 1, 1]),
            rp.Box([0.3, 1e-5, 1e-5], 5e-6),
            samples=4,
        )
