"""Torques on a leaf: what the hand feels and does not feel, by Pinocchio's forward dynamics."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest

import repctl_pin as rp
from repctl_pin import redundancy

PUSH = 20.0
"""N, at the elbow, for half a second."""


@pytest.fixture(scope="module", params=["panda", "pr2"])
def inverse(request: pytest.FixtureRequest) -> rp.RepeatableInverse:
    """One null direction, and two with a prismatic joint: linear potentials, their gradients off
    the null space."""
    task = rp.Robot.load(request.param).task(kind="pose")
    q0 = np.array(task.reference)
    N = redundancy.nullspace(task.jacobian(q0))
    rows = N + 0.1 * np.random.default_rng(0).normal(size=N.shape)
    potentials = rp.Polynomial(q0, 1, 1.0)
    return rp.RepeatableInverse(task, potentials.weighted(rows))


def acceleration(task: rp.Task, q: np.ndarray, qdot: np.ndarray, torque: np.ndarray) -> np.ndarray:
    return pin.aba(task.model, task.model.createData(), q, qdot, torque)


def test_the_leaf_answers_at_its_frequency_and_the_hand_feels_nothing(
    inverse: rp.RepeatableInverse,
) -> None:
    task, q = inverse.task, np.array(inverse.task.reference)
    control = rp.LeafImpedance(inverse, leaf_frequency=4.0)
    off = np.linspace(0.1, 0.2, task.r)
    torque = control.torque(q, np.zeros(task.n), task.placement(q), leaf=inverse.leaf(q) + off)
    qddot = acceleration(task, q, np.zeros(task.n), torque)
    assert np.allclose(task.jacobian(q) @ qddot, 0, atol=1e-9)
    assert np.allclose(inverse.potentials.gradient(q).T @ qddot, 16 * off, rtol=1e-9)


def test_the_hand_is_a_spring_with_its_own_inertia(inverse: rp.RepeatableInverse) -> None:
    task, q = inverse.task, np.array(inverse.task.reference)
    control = rp.LeafImpedance(inverse, stiffness=(300.0, 20.0), damping=0.7)
    target = task.placement(q) * pin.SE3(
        pin.exp3(np.array([0.1, 0.0, 0.2])), np.array([0.02, -0.01, 0.03])
    )
    J, M = task.jacobian(q), task.inertias(q[None])[0]
    inertia = np.linalg.inv(J @ np.linalg.inv(M) @ J.T)
    rest = acceleration(
        task, q, np.zeros(task.n), control.torque(q, np.zeros(task.n), target, leaf=inverse.leaf(q))
    )
    K = np.diag([300.0] * 3 + [20.0] * 3)
    assert np.allclose(inertia @ J @ rest, K @ task.error(q, target), atol=1e-8)
    # Every mode of Λ ẍ + D ẋ + K x = 0 has the damping ratio 0.7; a moving target gives D.
    here, leaf = task.placement(q), inverse.leaf(q)
    D = np.empty((6, 6))
    for i, twist in enumerate(np.eye(6)):
        torque = control.torque(q, np.zeros(task.n), here, twist, leaf=leaf)
        D[:, i] = inertia @ J @ acceleration(task, q, np.zeros(task.n), torque)
    system = np.block(
        [
            [np.zeros((6, 6)), np.eye(6)],
            [-np.linalg.solve(inertia, K), -np.linalg.solve(inertia, D)],
        ]
    )
    poles = np.linalg.eigvals(system)
    assert np.allclose(-poles.real / np.abs(poles), 0.7, atol=1e-6)


def test_the_force_on_the_hand_does_not_move_the_leaf(inverse: rp.RepeatableInverse) -> None:
    """Khatib's form, with Λ_h and projectors, and what makes Vᵀ M⁻¹ τ = 0 of the force."""
    task, q = inverse.task, np.array(inverse.task.reference)
    control = rp.LeafImpedance(inverse, stiffness=(300.0, 20.0), leaf_frequency=5.0)
    target = task.placement(q + 0.05 * np.sin(np.arange(task.n)))
    off = np.linspace(0.1, 0.2, task.r)
    J, V, M = (task.jacobian(q), inverse.potentials.gradient(q), task.inertias(q[None])[0])
    B = np.linalg.inv(M)
    J_bar = B @ J.T @ np.linalg.inv(J @ B @ J.T)
    P = np.eye(task.n) - J.T @ J_bar.T
    leaf_inertia = np.linalg.inv(V.T @ B @ P @ V)
    F = np.diag([300.0] * 3 + [20.0] * 3) @ task.error(q, target)
    apart = J.T @ F + P @ V @ leaf_inertia @ (25 * off - V.T @ B @ J.T @ F)
    still = np.zeros(task.n)
    gravity = pin.rnea(task.model, task.model.createData(), q, still, still)
    torque = control.torque(q, still, target, leaf=inverse.leaf(q) + off)
    assert np.abs(V.T @ B @ J.T @ F).max() > 0.1  # what is subtracted
    assert np.allclose(torque - gravity, apart, atol=1e-9 * np.abs(apart).max())


def test_a_moving_leaf_answers_at_its_frequency_too(inverse: rp.RepeatableInverse) -> None:
    """ḧ along a motion, by differences of h, with velocities that bend J_V."""
    task, q = inverse.task, np.array(inverse.task.reference)
    quadratic = rp.Polynomial(q, 2, 0.5)
    A = np.random.default_rng(1).normal(size=(quadratic.size, task.r))
    A[: task.n] = inverse.potentials.gradient(q)
    inverse = rp.RepeatableInverse(task, quadratic.weighted(A))
    control = rp.LeafImpedance(inverse, leaf_frequency=3.0, leaf_damping=0.6)
    qdot, c = np.linspace(-1.0, 1.0, task.n), inverse.leaf(q) + 0.1
    twist = np.r_[task.jacobian(q) @ qdot]
    torque = control.torque(q, qdot, task.placement(q), twist, leaf=c)
    qddot = acceleration(task, q, qdot, torque)

    def second_difference(f: Callable[[np.ndarray], np.ndarray], t: float = 1e-4) -> np.ndarray:
        ahead, behind = (f(q + s * qdot * t + qddot * t * t / 2) for s in (1, -1))
        return (ahead - 2 * f(q) + behind) / t**2

    V = inverse.potentials.gradient(q)
    expected = 9.0 * 0.1 - 2 * 0.6 * 3.0 * V.T @ qdot
    assert np.allclose(second_difference(inverse.leaf), expected, atol=1e-3)
    p = second_difference(lambda x: task.placement(x).translation)
    assert np.allclose(p, 0, atol=1e-3)  # the target's own acceleration is 0
    assert np.abs(V.T @ qddot - expected).max() > 0.01  # V̇ᵀ q̇ matters


@pytest.mark.parametrize("stiff", [5.0, 0.02])
def test_the_observer_opposes_a_disturbance_up_to_its_limit(
    stiff: float, inverse: rp.RepeatableInverse
) -> None:
    """A torque that is not in the model, at the joint that moves the leaf most."""
    task, q = inverse.task, np.array(inverse.task.reference)
    dt, n = 1e-3, task.n
    control = rp.LeafImpedance(inverse, leaf_frequency=10.0, observer_limit=stiff)
    home, leaf, observer = task.placement(q), inverse.leaf(q), control.observer(dt)
    V, M = inverse.potentials.gradient(q), task.inertias(q[None])[0]
    J_V = np.vstack([task.jacobian(q), V.T])
    push = M @ np.linalg.inv(J_V)[:, task.m :] @ np.ones(task.r)
    push *= 0.5 / np.abs(push).max()  # 0.5 Nm on the leaf alone
    qdot = np.zeros(n)
    for k in range(800):
        torque = control.torque(q, qdot, home, leaf=leaf, observer=observer)
        if k % 20 == 0:
            plain = control.torque(q, qdot, home, leaf=leaf)
            assert (np.abs(torque - plain) <= stiff * (1 + 1e-9)).all()
        qdot = qdot + dt * acceleration(task, q, qdot, torque + push)
        q = q + dt * qdot
    away = np.abs(inverse.leaf(q) - leaf).max()
    moved = np.abs(V.T @ np.linalg.solve(M, push)).max() / 100  # where ω² (c − h) balances it
    assert away < 1e-2 * moved if stiff == 5.0 else away > 0.5 * moved


def test_energy_does_not_grow_without_input(inverse: rp.RepeatableInverse) -> None:
    """½ ẋᵀ Λ ẋ + ½ eᵀ K e of the hand, ½ ḣ² + ½ ω² (c − h)² of the leaf, from rest away from
    both."""
    task, home = inverse.task, np.array(inverse.task.reference)
    control = rp.LeafImpedance(
        inverse, stiffness=(300.0, 20.0), damping=0.7, leaf_frequency=5.0, leaf_damping=0.1
    )
    q = home + 0.1 * np.cos(np.arange(task.n))
    target, c, K = (task.placement(home), inverse.leaf(home), np.diag([300.0] * 3 + [20.0] * 3))
    qdot, dt, stored = np.zeros(task.n), 5e-4, []

    def rate(q: np.ndarray, qdot: np.ndarray) -> np.ndarray:
        return acceleration(task, q, qdot, control.torque(q, qdot, target, leaf=c))

    for _ in range(400):
        J, M, e = task.jacobian(q), task.inertias(q[None])[0], task.error(q, target)
        xdot, hdot = J @ qdot, inverse.potentials.gradient(q).T @ qdot
        hand = xdot @ np.linalg.solve(J @ np.linalg.solve(M, J.T), xdot) + e @ K @ e
        gap = inverse.leaf(q) - c
        stored.append([hand / 2, (hdot @ hdot + 25 * gap @ gap) / 2])
        middle = qdot + dt / 2 * rate(q, qdot)  # midpoint rule
        q, qdot = q + dt * middle, qdot + dt * rate(q + dt / 2 * qdot, middle)
    hand, leaf = np.array(stored).T
    assert np.diff(leaf).max() < 0 and leaf[-1] < 0.99 * leaf[0]
    assert np.diff(hand).max() < 0 and hand[-1] < 0.5 * hand[0]


def test_it_holds_still_against_gravity(inverse: rp.RepeatableInverse) -> None:
    task, q = inverse.task, np.array(inverse.task.reference)
    torque = rp.LeafImpedance(inverse).torque(
        q, np.zeros(task.n), task.placement(q), leaf=inverse.leaf(q)
    )
    assert np.allclose(acceleration(task, q, np.zeros(task.n), torque), 0, atol=1e-9)


def test_a_push_at_the_elbow_is_undone_and_the_hand_stays(
    panda_design: rp.Design, q_panda: np.ndarray
) -> None:
    inverse, task, dt = panda_design.inverse, panda_design.task, 1e-3
    control = rp.LeafImpedance(inverse, stiffness=(2000.0, 100.0), leaf_frequency=5.0)
    home, leaf, joint = (
        task.placement(q_panda),
        inverse.leaf(q_panda),
        task.model.getJointId("panda_joint4"),
    )
    model, data = task.model, task.model.createData()

    def elbow_jacobian(q: np.ndarray) -> np.ndarray:
        pin.computeJointJacobians(model, data, q)
        return pin.getJointJacobian(model, data, joint, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)[:3]

    along = elbow_jacobian(q_panda) @ redundancy.nullspace(task.jacobian(q_panda))[:, 0]
    along /= np.linalg.norm(along)
    q, qdot, hand, off = q_panda.copy(), np.zeros(7), [], []
    for k in range(2500):
        torque = control.torque(q, qdot, home, leaf=leaf)
        if k < 500:
            torque = torque + elbow_jacobian(q).T @ (PUSH * along)
        qdot = qdot + dt * pin.aba(model, data, q, qdot, torque)
        q = q + dt * qdot
        hand.append(np.linalg.norm(task.placement(q).translation - home.translation))
        off.append(np.linalg.norm(q - q_panda))
    assert max(off) > 0.3 and off[-1] < 1e-3
    assert max(hand) < 5e-3


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"stiffness": (100.0, -1.0)}, "stiffness must be two numbers above 0"),
        ({"stiffness": [1.0, 2.0, 3.0]}, "or 6"),
        ({"damping": -1.0}, "damping must be 0 or more"),
        ({"leaf_frequency": np.nan}, "leaf_frequency must be"),
        ({"observer_rate": 0.0}, "observer_rate must be above 0 1/s"),
        ({"observer_limit": [1.0, 2.0]}, "observer_limit must be one number above 0 or 7"),
    ],
)
def test_refusals(panda_design: rp.Design, options: dict, said: str) -> None:
    with pytest.raises(rp.InputError, match=said):
        rp.LeafImpedance(panda_design.inverse, **options)
    with pytest.raises(rp.InputError, match="leaf must be 1 finite"):
        control = rp.LeafImpedance(panda_design.inverse)
        control.torque(np.zeros(7), np.zeros(7), pin.SE3.Identity(), leaf=[np.nan])


def test_an_observer_that_cannot_be_used(panda_design: rp.Design) -> None:
    control, q = rp.LeafImpedance(panda_design.inverse), panda_design.region.center
    for dt, said in ((0.0, "dt must be above 0 s"), (0.02, "longer than 1 / observer_rate")):
        with pytest.raises(rp.InputError, match=said):
            control.observer(dt)
    target, leaf, observer = (control.task.placement(q), np.zeros(1), control.observer(1e-3))
    with pytest.raises(rp.InputError, match=r"observer must be a result of observer\(dt\)"):
        control.torque(q, np.zeros(7), target, leaf=leaf, observer=np.zeros(1))  # type: ignore[arg-type]
    control.torque(q, 0.1 * np.ones(7), target, leaf=leaf, observer=observer)
    before = observer.state.copy()
    with pytest.raises(rp.InputError, match="not finite"):
        control.torque(q, np.full(7, 1e200), target, leaf=leaf, observer=observer)
    assert before and observer.state == before
    observer.reset()
    assert observer.state == 0


NOT_FINITE = {
    "a target at nan": {"target": pin.SE3(np.eye(3), np.array([0.3, np.nan, 0.3]))},
    "a target at inf": {"target": pin.SE3(np.eye(3), np.array([0.3, np.inf, 0.3]))},
    "a target turned by nan": {"target": pin.SE3(np.full((3, 3), np.nan), np.zeros(3))},
    "a target that is reflected": {"target": pin.SE3(np.diag([1.0, 1.0, -1.0]), np.zeros(3))},
    "no target": {"target": "there"},
    "a leaf in words": {"leaf": "x"},
    "too many leaves": {"leaf": [1.0, 2.0]},
    "a twist in words": {"twist": "fast"},
    "a twist of words": {"twist": ["a"] * 6},
    "a twist at nan": {"twist": np.full(6, np.nan)},
    "a speed of 1e200": {"qdot": np.full(7, 1e200)},
    "a leaf at 1e308": {"leaf": [1e308]},
}


@pytest.mark.parametrize("case", NOT_FINITE)
def test_a_torque_is_finite_or_refused(case: str, panda_design: rp.Design) -> None:
    control = rp.LeafImpedance(panda_design.inverse)
    task, q = control.task, panda_design.region.center
    good = {
        "q": q,
        "qdot": np.zeros(7),
        "target": task.placement(q),
        "leaf": control.inverse.leaf(q),
    }
    assert np.isfinite(control.torque(**good)).all()
    with pytest.raises(rp.InputError) as caught:
        control.torque(**(good | NOT_FINITE[case]))
    assert "\n" not in str(caught.value)
