"""The control step: the same numbers as plain formulas, fresh results, limits kept, bad input
named."""

from __future__ import annotations

import copy
import pickle
import tracemalloc
import warnings
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from arms import KINDS, planar_task, spatial_task

import repctl_pin as rp


def some_field(
    task: rp.Task, center: np.ndarray, degree: int, seed: int = 0
) -> rp.RepeatableInverse:
    """A potentials near constant rows: regular near the center, curved away from it."""
    rng = np.random.default_rng(seed)
    potentials = rp.Polynomial(center, degree, 0.5)
    A = 0.05 * rng.normal(size=(potentials.size, task.r))
    A[: task.n] = rp.redundancy.nullspace(task.jacobian(center)) * 0.5 / np.sqrt(3)
    return rp.RepeatableInverse(task, potentials.weighted(A))


def plain_step(inverse: rp.RepeatableInverse, q, target, dt, twist, leaf, gain) -> np.ndarray:
    """The law as it stands, with NumPy's general solver."""
    task = inverse.task
    J_V = np.vstack([task.jacobian(q), inverse.potentials.gradient(q).T])
    errors = np.concatenate([task.error(q, target), leaf - inverse.potentials.value(q)])
    rates = np.concatenate([task.task_velocity(q, twist), np.zeros(task.r)])
    return q + np.linalg.solve(J_V, dt * rates + gain * dt * errors)


@pytest.mark.parametrize("degree", [1, 2, 3, 4, 5])
@pytest.mark.parametrize("r", [1, 2])
def test_quick_potentials_are_the_familys(degree: int, r: int, tmp_path: Path) -> None:
    """``J_V x = (x − f, c − h)``, with h and V of the family's own batch evaluation, which shares
    no code with what a step evaluates."""
    task = planar_task((1, 0.9, 0.8), tmp_path) if r == 1 else spatial_task(5, tmp_path)
    rng, n = np.random.default_rng(2), task.n
    potentials = rp.Polynomial(rng.normal(size=n), degree, rng.uniform(0.3, 2, n))
    A = rng.normal(size=(potentials.size, r))
    h = potentials.weighted(A)
    inverse = rp.RepeatableInverse(task, h)
    for q in potentials.center + rng.uniform(-1, 1, (6, n)) * potentials.scale:
        value = potentials.values(q[None])[0] @ A
        V = potentials.gradients(q[None])[0] @ A
        assert np.allclose(h.gradient(q), V, rtol=1e-10, atol=1e-10)
        assert np.allclose(h.value(q), value, rtol=1e-10, atol=1e-10)
        target, leaf, xdot = pin.SE3.Random(), rng.normal(size=r), np.ones(task.m)
        rhs = np.concatenate([task.error(q, target), leaf - value])
        J_V = np.vstack([task.jacobian(q), V.T])
        for x, right in (
            (inverse.step(q, target, 0.01, leaf=leaf) - q, rhs),
            (inverse.velocity(q, xdot), np.concatenate([xdot, np.zeros(r)])),
        ):
            scale = np.abs(J_V) @ np.abs(x) + np.abs(right) + 1
            assert (np.abs(J_V @ x - right) < 1e-10 * scale).all()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("degree", [1, 2, 3])
def test_velocity_and_step_obey_their_laws(
    panda: rp.Robot, q_panda, kind: str, degree: int
) -> None:
    task, center = panda.task("panda_hand_tcp", kind), q_panda
    inverse = some_field(task, center, degree)
    rng = np.random.default_rng(3)
    for q in center + rng.uniform(-0.2, 0.2, (4, 7)):
        xdot, twist = rng.normal(size=task.m), rng.normal(size=6)
        qdot = inverse.velocity(q, xdot)
        assert np.allclose(qdot, inverse(q) @ xdot, atol=1e-10)
        assert np.allclose(task.jacobian(q) @ qdot, xdot, atol=1e-11)
        assert np.allclose(inverse.potentials.gradient(q).T @ qdot, 0, atol=1e-11)
        target = task.placement(q + 0.01 * rng.normal(size=7))
        leaf = inverse.leaf(q) + 0.01 * rng.normal(size=task.r)
        found = inverse.step(q, target, 0.01, twist, leaf=leaf, gain=60.0)
        assert np.allclose(
            found, plain_step(inverse, q, target, 0.01, twist, leaf, 60.0), atol=1e-11
        )
        still = np.zeros(6)
        newton = inverse.step(q, target, 0.01, leaf=leaf)
        expected = plain_step(inverse, q, target, 1.0, still, leaf, 1.0)
        assert np.allclose(newton, expected, atol=1e-11)
        for goal in (target, pin.SE3.Random()):  # near and anywhere
            held = inverse.step(q, goal, 0.01)
            expected = plain_step(inverse, q, goal, 1.0, still, inverse.leaf(q), 1.0)
            assert np.allclose(held, expected, rtol=1e-9, atol=1e-11)


def test_other_fields_step_by_the_same_law(panda_pose: rp.Task, q_panda) -> None:
    """Fourier, joined and extended potentials have no quick tensors, and the same result."""
    rng = np.random.default_rng(4)
    potentials = rp.Fourier(7, 1) + rp.Polynomial(q_panda, 2, 0.5, variables=[0, 3])
    A = 0.05 * rng.normal(size=(potentials.size, 1))
    slope = np.linalg.lstsq(
        potentials.gradients(q_panda[None])[0],
        rp.redundancy.nullspace(panda_pose.jacobian(q_panda)),
        rcond=None,
    )[0]
    for inverse in (
        rp.RepeatableInverse(panda_pose, potentials.weighted(A + slope)),
        rp.ExtendedJacobian(panda_pose, q_panda),
    ):
        q, target = q_panda + 0.1 * rng.normal(size=7), panda_pose.placement(q_panda)
        leaf = inverse.leaf(q_panda)
        found = inverse.step(q, target, 0.01, leaf=leaf)
        assert np.allclose(
            found, plain_step(inverse, q, target, 1.0, np.zeros(6), leaf, 1.0), atol=1e-10
        )


def test_pseudoinverse_velocity_is_the_shortest(panda: rp.Robot, q_panda) -> None:
    rng = np.random.default_rng(5)
    for kind in KINDS:
        task = panda.task("panda_hand_tcp", kind)
        strategy = rp.Pseudoinverse(task)
        q, xdot = q_panda + 0.2 * rng.normal(size=7), rng.normal(size=task.m)
        assert np.allclose(
            strategy.velocity(q, xdot), np.linalg.pinv(task.jacobian(q)) @ xdot, atol=1e-12
        )


def test_batch_is_the_single_form(panda_design, q_panda) -> None:
    rng = np.random.default_rng(6)
    Q, Xdot = q_panda + 0.2 * rng.normal(size=(20, 7)), rng.normal(size=(20, 6))
    single = [panda_design.inverse.velocity(q, xdot) for q, xdot in zip(Q, Xdot, strict=True)]
    assert np.allclose(panda_design.inverse.velocities(Q, Xdot), single, atol=1e-11)


def test_results_are_fresh_and_arguments_untouched(panda_design, panda_pose, q_panda) -> None:
    inverse, target = panda_design.inverse, panda_pose.placement(q_panda + 0.02)
    q, xdot, leaf = q_panda.copy(), np.ones(6), inverse.leaf(q_panda)
    for array in (q, xdot, leaf):
        array.setflags(write=False)
    first, following = (inverse.velocity(q, xdot), inverse.step(q, target, 0.01, xdot, leaf=leaf))
    kept = first.copy(), following.copy()
    inverse.velocity(q + 0.1, 2 * xdot)
    inverse.step(q + 0.1, target, 0.01, leaf=leaf)
    assert np.array_equal(first, kept[0]) and np.array_equal(following, kept[1])
    other = pickle.loads(pickle.dumps(inverse))
    assert np.array_equal(other.step(q, target, 0.01, xdot, leaf=leaf), following)
    # The task's own functions share its scratch memory; asking them in between changes nothing.
    panda_pose.placement(q_panda + 0.5)
    assert np.array_equal(inverse.velocity(q, xdot), first)


def test_nothing_grows(panda_design, panda_pose, q_panda) -> None:
    inverse, target, leaf = (
        panda_design.inverse,
        panda_pose.placement(q_panda),
        panda_design.inverse.leaf(q_panda),
    )

    def work(count: int) -> None:
        q = q_panda
        for _ in range(count):
            q = inverse.step(q, target, 0.01, leaf=leaf)
            inverse.velocity(q, np.zeros(6))

    work(100)
    tracemalloc.start()
    work(500)
    before = tracemalloc.get_traced_memory()[0]
    work(5000)
    grown = tracemalloc.get_traced_memory()[0] - before
    tracemalloc.stop()
    assert grown < 4096


# ---- near singularities and limits
# -----------------------------------------------------------------


@pytest.mark.parametrize("most", [0.02, 0.2])
def test_a_step_is_damped_by_its_formula(most: float) -> None:
    """``x = Σ v_i σ_i / (σ_i² + λ²) u_iᵀ rhs`` with λ² = λ_max² (1 − (σ_min / 2 λ_max)²) below
    2 λ_max and λ = 0 above: continuous, and at most ‖rhs‖ / (√3 λ_max) long where λ > 0."""
    task = rp.Robot.load("planar3r").task("tool", "xy")
    inverse = some_field(task, np.array([0.3, 0.8, 0.8]), 2)
    rng, exact = np.random.default_rng(7), 0
    for angle in np.geomspace(1.0, 1e-14, 200):  # 0 is a stretched arm
        q = np.array([0.3, angle, 0.7 * angle])
        target, leaf = task.placement(q + rng.normal(size=3)), rng.normal(size=1)
        rhs = np.concatenate([task.error(q, target), leaf - inverse.leaf(q)])
        J_V = np.vstack([task.jacobian(q), inverse.potentials.gradient(q).T])
        U, s, V_T = np.linalg.svd(J_V)
        square = most**2 * max(0.0, 1 - (s[-1] / (2 * most)) ** 2)
        step = inverse.damped_step(q, target, 0.01, leaf=leaf, damping=most)
        x = step.q - q
        expected = V_T.T @ (s / (s**2 + square) * (U.T @ rhs))
        assert np.allclose(x, expected, rtol=1e-9, atol=1e-12)
        assert step.damping == pytest.approx(np.sqrt(square), abs=1e-12)
        exact += step.damping == 0
        if step.damping:
            longest = np.linalg.norm(rhs) / (np.sqrt(3) * most)
            assert np.linalg.norm(x) <= longest * (1 + 1e-12)
    assert 5 < exact < 60


def test_any_gain_below_divergence_is_taken(panda_design, panda_pose, q_panda) -> None:
    """gain · dt from 0 to 2: a share of 1.5 overshoots, 2 goes round for ever, and neither is
    refused."""
    inverse, q = panda_design.inverse, q_panda + 1e-4
    target, leaf = panda_pose.placement(q_panda), panda_design.inverse.leaf(q_panda)
    for share, left in ((0.5, 0.5), (1.5, -0.5), (2.0, -1.0)):
        after = inverse.step(q, target, 0.01, gain=share / 0.01, leaf=leaf)
        np.testing.assert_allclose(after - q_panda, left * (q - q_panda), atol=2e-7)
    with pytest.raises(rp.InputError, match="from 0 to 2"):
        inverse.step(q, target, 0.01, gain=201.0)


def test_a_singular_arm_raises_without_damping_and_is_damped_with_it() -> None:
    task = rp.Robot.load("planar3r").task("tool", "xy")
    inverse = some_field(task, np.array([0.3, 0.8, 0.8]), 2)
    stretched = np.zeros(3)
    target = pin.SE3(np.eye(3), np.array([2.5, 0.5, 0.0]))
    kept = stretched.copy()
    with pytest.raises(rp.SingularityError, match="singular.*0, 0, 0"):
        inverse.step(stretched, target, 0.01, leaf=inverse.leaf(stretched))
    with pytest.raises(rp.SingularityError):
        inverse.velocity(stretched, np.ones(2))
    with pytest.raises(rp.SingularityError):  # even where the velocity asked for could be had
        inverse.velocity(stretched, np.array([0.0, 1.0]))
    step = inverse.damped_step(stretched, target, 0.01, leaf=inverse.leaf(stretched), damping=0.1)
    following = step.q
    assert 0 < step.damping <= 0.1
    error = np.linalg.norm(task.error(stretched, target))
    assert np.linalg.norm(following - stretched) <= error / (np.sqrt(3) * 0.1)
    assert np.array_equal(stretched, kept)
    bent = np.array([0.3, 0.8, 0.8])
    exact = inverse.step(bent, target, 0.01, gain=1.0)
    step = inverse.damped_step(bent, target, 0.01, gain=1.0, damping=1e-3)
    assert np.allclose(step.q, exact, atol=1e-13)
    assert step.damping == 0


def test_damping_brings_an_arm_out_of_a_singularity() -> None:
    task = rp.Robot.load("planar3r").task("tool", "xy")
    inverse = some_field(task, np.array([0.3, 0.8, 0.8]), 1)
    goal = np.array([0.3, 0.8, 0.8])
    target, leaf, q = (task.placement(goal), inverse.leaf(goal), np.array([0.6, 0.0, 1e-9]))
    used = []
    for _ in range(200):
        step = inverse.damped_step(q, target, 0.01, leaf=leaf, gain=30.0, damping=0.1)
        q = step.q
        used.append(step.damping)
    assert max(used) > 0 and used[-1] == 0
    assert (
        np.linalg.norm(task.error(q, target)) < 1e-9 and np.abs(inverse.leaf(q) - leaf).max() < 1e-9
    )


def test_speed_limits_are_kept_and_the_task_goes_first(panda_design, panda_pose, q_panda) -> None:
    inverse, dt = panda_design.inverse, 0.01
    target, leaf = panda_pose.placement(q_panda), inverse.leaf(q_panda)
    pushed = q_panda + 0.3 * rp.redundancy.nullspace(panda_pose.jacobian(q_panda))[:, 0]
    limit = np.full(7, 2.0)
    free = inverse.step(pushed, target, dt, leaf=leaf)
    assert np.abs(free - pushed).max() / dt > 4 * limit.max()
    step = inverse.damped_step(pushed, target, dt, leaf=leaf, gain=5.0, velocity_limit=limit)
    assert step.slowed == 1.0
    assert np.allclose(step.q - pushed, 0.05 * (free - pushed), atol=1e-12)
    step = inverse.damped_step(pushed, target, dt, leaf=leaf, velocity_limit=limit)
    bounded = step.q
    assert np.abs(bounded - pushed).max() <= limit.max() * dt * (1 + 1e-12)
    assert 0 < step.slowed < 1

    def task_error_after(q: np.ndarray) -> float:
        return float(
            np.linalg.norm(
                panda_pose.jacobian(pushed) @ (q - pushed) - panda_pose.error(pushed, target)
            )
        )

    # With room for the task's own part only the return to the leaf gives way: the task's error is
    # still undone.
    moved = pushed - 0.001 * panda_pose.jacobian(pushed)[0]
    task_part = inverse.step(moved, target, dt)
    roomy = 1.2 * np.abs(task_part - moved).max() / dt
    step = inverse.damped_step(moved, target, dt, leaf=leaf, velocity_limit=roomy)
    slow = step.q
    assert np.abs(slow - moved).max() <= roomy * dt * (1 + 1e-12)
    J, e = panda_pose.jacobian(moved), panda_pose.error(moved, target)
    assert np.allclose(J @ (slow - moved), e, atol=1e-10) and step.slowed < 1
    assert task_error_after(bounded) < np.linalg.norm(panda_pose.error(pushed, target)) + 1e-12


# ---- bad input
# -------------------------------------------------------------------------------------

GOOD = {"dt": 0.01}
BAD_STEPS: dict[str, tuple[dict, str]] = {
    "q short": ({"q": np.zeros(6)}, r"q must be 7 finite numbers, one per joint; got shape \(6,\)"),
    "q matrix": ({"q": np.zeros((1, 7))}, r"q must be 7 .*; got shape \(1, 7\)"),
    "q nan": ({"q": np.full(7, np.nan)}, "7 finite numbers"),
    "q inf": ({"q": np.full(7, np.inf)}, "7 finite numbers"),
    "q text": ({"q": "zero"}, "q must be 7 finite numbers, one per joint; got 'zero'"),
    "target": ({"target": np.eye(3)}, "placement"),
    "target reflected": ({"target": np.diag([1.0, 1.0, -1.0, 1.0])}, "rotation"),
    "target last row": ({"target": np.ones((4, 4))}, "last row"),
    "target none": ({"target": None}, "placement"),
    "target nan": ({"target": pin.SE3(np.eye(3), np.full(3, np.nan))}, "finite"),
    "dt zero": ({"dt": 0.0}, "dt must be above 0"),
    "dt negative": ({"dt": -1.0}, "dt must be above 0"),
    "dt nan": ({"dt": float("nan")}, "dt must be above 0"),
    "dt text": ({"dt": "soon"}, "dt must be above 0"),
    "twist long": ({"twist": np.zeros(7)}, "twist"),
    "twist nan": ({"twist": np.full(6, np.nan)}, "finite"),
    "leaf long": ({"leaf": np.zeros(2)}, "leaf c = h"),
    "leaf nan": ({"leaf": np.array([np.nan])}, "finite"),
    "gain": ({"gain": 1e6}, "gain"),
    "gain negative": ({"gain": -1.0}, "gain"),
    "velocity_limit": ({"velocity_limit": np.zeros(7)}, "speed limit"),
    "limit short": ({"velocity_limit": np.ones(3)}, "speed limit"),
    "damping": ({"damping": -0.1}, "damping"),
    "damping nan": ({"damping": float("nan")}, "damping"),
}


@pytest.mark.parametrize("case", BAD_STEPS)
def test_bad_steps_get_one_clear_line_and_change_nothing(
    panda_design, panda_pose, q_panda, case: str
) -> None:
    inverse = panda_design.inverse
    good = {
        "q": q_panda + 0.01,
        "target": panda_pose.placement(q_panda),
        "dt": 0.01,
        "leaf": inverse.leaf(q_panda),
    }
    before = inverse.step(**good)
    changed, words = BAD_STEPS[case]
    with pytest.raises(rp.InputError, match=words) as caught:
        inverse.step(**(good | changed))
    assert "\n" not in str(caught.value)
    assert np.array_equal(inverse.step(**good), before)


@pytest.mark.parametrize(
    "q, xdot",
    [
        (np.zeros(6), np.ones(6)),
        (np.zeros(7), np.ones(5)),
        (np.zeros(7), 1.0),
        (np.full(7, np.nan), np.ones(6)),
        (np.zeros(7), np.full(6, np.inf)),
    ],
)
def test_bad_velocities_get_one_clear_line(panda_design, panda_pose, q, xdot) -> None:
    for strategy in (panda_design.inverse, rp.Pseudoinverse(panda_pose)):
        with pytest.raises(rp.InputError) as caught:
            strategy.velocity(q, xdot)
        assert "\n" not in str(caught.value)


def test_lists_and_whole_numbers_are_taken(panda_design, panda_pose, q_panda) -> None:
    inverse = panda_design.inverse
    assert np.allclose(
        inverse.velocity(list(q_panda), [1, 0, 0, 0, 0, 0]), inverse(q_panda)[:, 0], atol=1e-12
    )
    whole = np.array([0, -1, 0, -2, 0, 2, 1])
    assert np.allclose(
        inverse.velocity(whole, np.ones(6)), inverse.velocity(whole.astype(float), np.ones(6))
    )
    with pytest.raises(rp.InputError, match="Ẋ must be finite numbers .3, 6."):
        inverse.velocities(np.zeros((3, 7)), np.zeros((2, 6)))


def test_one_singularity_test_one_error() -> None:
    """At an algorithmic singularity every way to ask for G_r refuses; 1 % beside it every one
    answers, and alike."""
    task = rp.Robot.load("ppr").task("tool", "xy")
    for size in (1.0, 1e-7, 1e7):  # of the potential: a gauge
        A = size * np.array([[-(2**0.5)], [0], [1]])  # Vᵀ n = 1 − √2 sin θ₃, 0 at π/4
        inverse = rp.RepeatableInverse(task, rp.Polynomial(np.zeros(3), 1).weighted(A))
        n = rp.redundancy.null_vector(task.jacobian([0, 0, np.pi / 4]))
        assert abs(inverse.potentials.gradient(np.array([0, 0, np.pi / 4]))[:, 0] @ n) < 1e-9 * size
        xdot, bad, good = (
            np.ones(2),
            np.array([0, 0, np.pi / 4]),
            np.array([0, 0, np.pi / 4 + 0.01]),
        )
        asked = {
            "call": lambda G, q, v: G(q) @ v,
            "batch": lambda G, q, v: G.batch(q[None])[0] @ v,
            "velocity": lambda G, q, v: G.velocity(q, v),
            "velocities": lambda G, q, v: G.velocities(q[None], v[None])[0],
        }
        for ask in asked.values():
            with pytest.raises(rp.SingularityError, match="J_V is singular"):
                ask(inverse, bad, xdot)
            J_V = np.vstack([task.jacobian(good), inverse.potentials.gradient(good).T])
            assert np.allclose(ask(inverse, good, xdot), np.linalg.inv(J_V)[:, :2] @ xdot)


def test_the_velocity_of_the_pseudoinverse_is_as_exact_as_its_matrix() -> None:
    task = rp.Robot.load("planar3r").task("tool", "xy")
    for angle in (1e-3, 1e-4, 1e-5):
        q, xdot = np.array([0.3, angle, angle]), np.array([0.7, -0.4])
        exact = np.linalg.pinv(task.jacobian(q), rcond=1e-15) @ xdot
        got = rp.Pseudoinverse(task).velocity(q, xdot)
        assert np.linalg.norm(got - exact) < 1e-9 * np.linalg.norm(exact)
        assert np.abs(task.jacobian(q) @ got - xdot).max() < 1e-11 * np.linalg.norm(exact)


def test_outside_the_region_is_told_where_it_is_asked_for(
    panda_design, panda_pose, q_panda
) -> None:
    inverse, xdot, target = (panda_design.inverse, np.ones(6), panda_pose.placement(q_panda))
    assert inverse.region is panda_design.region
    edge = panda_design.region.half_width
    for q, out in (
        (q_panda + 0.99 * edge, False),
        (q_panda - 1.5 * edge * (np.arange(7) == 3), True),
    ):
        for call in (
            lambda how, q=q: inverse.velocity(q, xdot, outside=how),
            lambda how, q=q: inverse.step(q, target, 0.01, outside=how),
        ):
            plain = call("ignore")
            with warnings.catch_warnings(record=True) as told:
                warnings.simplefilter("always")
                assert np.array_equal(call("warn"), plain)
            assert ["the design does not cover it" in str(w.message) for w in told] == [True] * out
            if out:
                with pytest.raises(rp.InputError, match=r"outside Ω \(scaled distance 1\.5;"):
                    call("raise")
            else:
                assert np.array_equal(call("raise"), plain)
    for other in (pickle.loads(pickle.dumps(inverse)), copy.copy(inverse)):
        with pytest.raises(rp.InputError, match="outside Ω"):
            other.velocity(q_panda + 2 * edge, xdot, outside="raise")
    with pytest.raises(rp.InputError, match="no action outside Ω 'shout'"):
        inverse.velocity(q_panda, xdot, outside="shout")
    with pytest.raises(rp.InputError, match="outside= requires a region"):
        rp.RepeatableInverse(panda_pose, inverse.potentials).velocity(q_panda, xdot, outside="warn")
