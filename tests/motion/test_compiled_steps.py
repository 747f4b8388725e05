"""Motions integrated in C, against the same controllers as plain functions, which run in Python."""

from __future__ import annotations

import numpy as np
import pytest

import repctl_pin as rp
from repctl_pin import redundancy

ARMS = [
    ("panda", "pose"),
    pytest.param("panda", "position", marks=pytest.mark.slow),
    ("tiago", "pose"),  # a prismatic joint
    ("planar4r", "xy"),
    ("ppr", "xy"),
]


@pytest.mark.parametrize(("name", "kind"), ARMS)
def test_c_and_python_follow_alike(name: str, kind: str) -> None:
    task = rp.Robot.load(name).task(kind=kind)
    q0 = task.reference
    path = rp.circle(task, q0, 0.03, normal="z")
    basis = rp.Polynomial(q0, 2)
    linear = basis.gradients(q0[None])[0]  # (n, N)
    N = redundancy.nullspace(task.jacobian(q0))
    A = np.linalg.lstsq(linear, N, rcond=None)[0]
    A += 0.01 * np.random.default_rng(0).normal(size=A.shape)
    controllers = [
        rp.Pseudoinverse(task),
        rp.PostureControl(task, q0 + 0.1, gain=0.7),
        rp.RepeatableInverse(task, basis.weighted(A)),
    ]
    for control in controllers:
        for integrator in ("rk4", "euler"):
            options = {"cycles": 2, "steps": 40, "period": 3.0, "integrator": integrator}
            ours = rp.follow(control, path, q0, **options)
            plain = rp.follow(control.velocity, path, q0, task=task, **options)
            np.testing.assert_allclose(ours.q, plain.q, atol=1e-10)
            np.testing.assert_allclose(ours.qdot, plain.qdot, atol=1e-9)
            assert ours.qdot.any()


def test_corners(panda_pose: rp.Task, q_panda: np.ndarray) -> None:
    task, start = panda_pose, q_panda
    path = rp.polygon(task, start, [[0.05, 0, 0], [0.05, 0.05, 0.02]])
    control = rp.Pseudoinverse(task)
    ours = rp.follow(control, path, start, cycles=2, steps=50)
    plain = rp.follow(control.velocity, path, start, cycles=2, steps=50, task=task)
    np.testing.assert_allclose(ours.q, plain.q, atol=1e-11)


def test_a_singularity_is_reported_alike(panda_pose: rp.Task, q_panda: np.ndarray) -> None:
    far = rp.polygon(panda_pose, q_panda, [[2.0, 0, 0]])
    control, said = rp.Pseudoinverse(panda_pose), []
    for one, task in ((control, None), (control.velocity, panda_pose)):
        with pytest.raises(rp.SingularityError) as error:
            rp.follow(one, far, q_panda, cycles=1, steps=200, task=task)
        said.append(str(error.value))
    assert said[0] == said[1]


def test_steps_near_a_singularity_are_taken_in_python() -> None:
    """A stretched planar arm bends: J Jᵀ alone is not accurate enough at the start."""
    task = rp.Robot.load("planar3r").task(kind="xy")
    q0 = np.array([0.3, 2e-3, -1e-3])
    here = task.placement(q0)
    inward = -here.translation / np.linalg.norm(here.translation)
    path = rp.polygon(task, q0, [0.4 * inward])
    control = rp.Pseudoinverse(task)
    ours = rp.follow(control, path, q0, cycles=1, steps=300)
    plain = rp.follow(control.velocity, path, q0, cycles=1, steps=300, task=task)
    np.testing.assert_allclose(ours.q, plain.q, atol=1e-7)
