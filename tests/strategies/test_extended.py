"""The extended Jacobian: h = Nᵀ∇U is a function, V its gradient, and the leaf h = 0 minimises U."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
import scipy.optimize

import repctl_pin as rp
from repctl_pin import redundancy

Q0 = np.array([0, -np.pi / 4, 0, -3 * np.pi / 4, 0, np.pi / 2, np.pi / 4])


def bowl(q: np.ndarray) -> float:
    return float(np.sum(np.cosh(q - Q0)) + 0.3 * q[1] * q[3])


def bowl_gradient(q: np.ndarray) -> np.ndarray:
    g = np.sinh(q - Q0)
    g[1] += 0.3 * q[3]
    g[3] += 0.3 * q[1]
    return g


def bowl_hessian(q: np.ndarray) -> np.ndarray:
    H = np.diag(np.cosh(q - Q0))
    H[1, 3] = H[3, 1] = 0.3
    return H


@pytest.fixture(params=["pose", "axis", "position", "xy"])
def task(request: pytest.FixtureRequest, panda: rp.Robot) -> rp.Task:
    return panda.task("panda_hand_tcp", request.param)


def some_q(count: int = 4) -> np.ndarray:
    return Q0 + 0.4 * np.random.default_rng(2).uniform(-1, 1, (count, 7))


@pytest.mark.parametrize("potential", ["posture", "given"])
def test_V_is_the_gradient_of_h(task: rp.Task, potential: str) -> None:
    """For r > 1 this needs the gauge term: the aligned basis turns within the null space as q
    moves."""
    if potential == "posture":
        inverse = rp.ExtendedJacobian(task, Q0 + 0.1)
    else:
        inverse = rp.ExtendedJacobian(
            task, bowl, gradient=bowl_gradient, hessian=bowl_hessian, reference=Q0
        )
    h, e = inverse.potentials, 1e-5
    for q in some_q():
        V = h.gradient(q)
        for i, d in enumerate(np.eye(7)):
            slope = (h.value(q + e * d) - h.value(q - e * d)) / (2 * e)
            assert np.allclose(V[i], slope, atol=5e-9 * max(1, np.abs(V).max()))


def test_h_is_the_gradient_along_the_null_space(task: rp.Task) -> None:
    inverse = rp.ExtendedJacobian(task, Q0)
    for q in some_q():
        N = redundancy.nullspace(task.jacobian(q))
        assert np.isclose(
            np.linalg.norm(inverse.potentials.value(q)), np.linalg.norm(N.T @ (q - Q0)), atol=1e-12
        )
    assert np.abs(inverse.potentials.value(Q0)).max() < 1e-15


def test_the_reference_matters_for_several_degrees_of_redundancy_only(task: rp.Task) -> None:
    q, other = some_q(1)[0], Q0 + [0.5, 0.4, -0.6, 0.3, 0.7, -0.4, 0.6]
    here, there = (
        rp.ExtendedJacobian(task, Q0, reference=reference).potentials.value(q)
        for reference in (Q0, other)
    )
    assert np.allclose(here, there, atol=1e-12) == (task.r == 1)


def test_numerical_derivatives_come_close(panda_pose: rp.Task) -> None:
    exact = rp.ExtendedJacobian(
        panda_pose, bowl, gradient=bowl_gradient, hessian=bowl_hessian, reference=Q0
    )
    Q = some_q()
    V = exact.potentials.gradients(Q)
    for rough, tolerance in (
        (rp.ExtendedJacobian(panda_pose, bowl, gradient=bowl_gradient, reference=Q0), 1e-8),
        (rp.ExtendedJacobian(panda_pose, bowl, reference=Q0), 1e-3),
    ):
        assert np.abs(rough.potentials.gradients(Q) - V).max() < tolerance * np.abs(V).max()


@pytest.mark.slow
def test_on_the_leaf_U_stays_at_its_minimum(panda: rp.Robot) -> None:
    """Follow a path from the posture: at every point q is the constrained minimum that another
    optimiser finds."""
    task = panda.task("panda_hand_tcp", "position")
    inverse = rp.ExtendedJacobian(task, Q0)
    path = rp.circle(task, Q0, radius=0.08, normal="yz")
    motion = rp.follow(inverse, path, Q0, cycles=2, steps=200)
    assert motion.drift.max() < 1e-7
    q = motion.q[70]
    target = task.placement(q).translation
    found = scipy.optimize.minimize(
        lambda x: 0.5 * np.sum((x - Q0) ** 2),
        Q0,
        jac=lambda x: x - Q0,
        constraints={
            "type": "eq",
            "fun": lambda x: task.placement(x).translation - target,
            "jac": task.jacobian,
        },
        method="SLSQP",
        options={"ftol": 1e-15, "maxiter": 300},
    )
    assert found.success and np.abs(found.x - q).max() < 1e-5


def test_it_is_repeatable_and_pickles(task: rp.Task) -> None:
    inverse = rp.ExtendedJacobian(task, Q0)
    q = some_q()[0]
    G, V = inverse(q), inverse.potentials.gradient(q)
    assert np.abs(task.jacobian(q) @ G - np.eye(task.m)).max() < 1e-10
    assert np.abs(V.T @ G).max() < 1e-9 * np.abs(V).max() * np.abs(G).max()
    again = pickle.loads(pickle.dumps(inverse))
    assert isinstance(again, rp.ExtendedJacobian) and np.array_equal(again(q), G)
    assert np.allclose(inverse.batch(some_q())[0], G) and np.allclose(
        inverse.velocity(q, np.ones(task.m)), G.sum(axis=1)
    )


@pytest.mark.parametrize(
    "make, message",
    [
        (lambda t: rp.ExtendedJacobian(t, Q0[:6]), "7 finite numbers"),
        (lambda t: rp.ExtendedJacobian(t, Q0 * np.nan), "7 finite numbers"),
        (
            lambda t: rp.ExtendedJacobian(t, lambda q: np.nan).potentials.value(Q0),
            "potential U must be one finite number",
        ),
        (
            lambda t: rp.ExtendedJacobian(t, bowl, gradient=lambda q: q[:2]).potentials.value(Q0),
            "gradient of potential U",
        ),
    ],
)
def test_bad_input_gets_one_clear_line(panda_pose: rp.Task, make, message: str) -> None:
    with pytest.raises(rp.InputError, match=message) as error:
        make(panda_pose)
    assert "\n" not in str(error.value)
