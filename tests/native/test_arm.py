"""The control law in C (arm.c), from its tables, beside the formulas in NumPy."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from controls import CONTROLS, some, target_at
from native_library import REQUIRED

from repctl_pin.strategies import native_arm, native_law

pytestmark = REQUIRED


@pytest.mark.parametrize(
    "name",
    some(CONTROLS, "panda, pose, joined", "panda in other coordinates", "elbow and hand of panda"),
)
def test_c_computes_the_formulas(name: str, tmp_path: Path) -> None:
    inverse, q0 = CONTROLS[name](tmp_path)
    task, rng = inverse.task, np.random.default_rng(0)
    law = native_law.NativeLaw(
        task, inverse.potentials, native_arm.native_arm(task, inverse.potentials)
    )
    Q = q0 + rng.uniform(-0.2, 0.2, (40, task.n))
    J, V = task.jacobians(Q), inverse.potentials.gradients(Q)
    J_V = np.concatenate([J, np.swapaxes(V, 1, 2)], axis=1)
    Q = Q[np.linalg.cond(J_V) < 1e4]
    G = inverse.batch(Q, task.jacobians(Q))
    Xdot = rng.normal(size=(len(Q), task.m))
    qdot = (G @ Xdot[..., None])[..., 0]
    size = np.abs(G).max()
    assert np.abs(law.inverses(Q) - G).max() < 1e-12 * size
    assert np.abs(law.velocities(Q, Xdot) - qdot).max() < 1e-12 * size
    for q, xdot, v in zip(Q, Xdot, qdot, strict=True):
        assert np.abs(law.velocity(q, xdot) - v).max() < 1e-12 * size
        c = inverse.potentials.value(q)
        assert np.abs(law.leaf(q) - c).max() < 1e-12 * max(1, np.abs(c).max())


@pytest.mark.parametrize("name", some(CONTROLS, "panda, axis, degree 2", "elbow and hand of panda"))
def test_a_step_in_c_is_its_formula(name: str, tmp_path: Path) -> None:
    """q + J_V⁻¹ (dt [ẋ; 0] + K dt [x − f(q); c − h(q)])"""
    inverse, q0 = CONTROLS[name](tmp_path)
    task, rng = inverse.task, np.random.default_rng(1)
    law, h = (
        native_law.NativeLaw(
            task, inverse.potentials, native_arm.native_arm(task, inverse.potentials)
        ),
        inverse.potentials,
    )
    for k in range(20):
        q = q0 + rng.uniform(-0.1, 0.1, task.n)
        turn = pin.SE3(pin.exp3(0.3 * rng.normal(size=3)), 0.01 * rng.normal(size=3))
        target = task.as_target(target_at(task, q, turn))
        twist = rng.normal(size=task.twist_size)
        leaf, gain, dt = h.value(q) + 0.01 * rng.normal(size=task.r), 20.0, 0.01
        J_V = np.concatenate([task.jacobian(q), h.gradient(q).T])
        e = np.concatenate([task.error(q, target), leaf - h.value(q)])
        xdot = np.concatenate([task.task_velocity(q, twist), np.zeros(task.r)])
        x = np.linalg.solve(J_V, dt * xdot + gain * dt * e)
        found = law.step(q, target, dt, twist, leaf, gain, None)
        tolerance = 1e-14 * np.linalg.cond(J_V) * max(1.0, np.abs(x).max())
        assert np.abs(found - q - x).max() < max(tolerance, 1e-13), k
