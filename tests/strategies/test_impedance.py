"""Torques on a leaf: what the hand feels and does not feel, by Pinocchio's forward dynamics."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import repctl_pin as rp
from repctl_pin.motion import elbow
from repctl_pin.redundancy import nullspace

PUSH = 20.0
"""N, at the elbow, for half a second."""


@pytest.fixture(scope="module", params=["panda", "pr2"])
def inverse(request: pytest.FixtureRequest) -> rp.RepeatableInverse:
    """One null direction, and two with a prismatic joint: linear potentials, their gradients off
    the null space."""
    task = rp.Robot.load(request.param).task(kind="pose")
    q0 = np.array(task.reference)
    N = nullspace(task.jacobian(q0))
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
    # Every mode of Λ ẍ + D ẋ + K x = 0 has the damping ratio 0.7.
    D = np.array([control._force(-e, inertia, np.zeros(6), np.zeros(6)) for e in np.eye(6)]).T
    system = np.block(
        [
            [np.zeros((6, 6)), np.eye(6)],
            [-np.linalg.solve(inertia, K), -np.linalg.solve(inertia, D)],
        ]
    )
    poles = np.linalg.eigvals(system)
    assert np.allclose(-poles.real / np.abs(poles), 0.7, atol=1e-6)


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
    control = rp.LeafImpedance(inverse, stiffness=(2000.0, 100.0))
    home, leaf, joint = task.placement(q_panda), inverse.leaf(q_panda), elbow(task, q_panda) + 1
    model, data = task.model, task.model.createData()

    def elbow_jacobian(q: np.ndarray) -> np.ndarray:
        pin.computeJointJacobians(model, data, q)
        return pin.getJointJacobian(model, data, joint, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)[:3]

    along = elbow_jacobian(q_panda) @ nullspace(task.jacobian(q_panda))[:, 0]
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
    ],
)
def test_refusals(panda_design: rp.Design, options: dict, said: str) -> None:
    with pytest.raises(rp.InputError, match=said):
        rp.LeafImpedance(panda_design.inverse, **options)
    with pytest.raises(rp.InputError, match="leaf must be 1 finite"):
        control = rp.LeafImpedance(panda_design.inverse)
        control.torque(np.zeros(7), np.zeros(7), pin.SE3.Identity(), leaf=[np.nan])


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
