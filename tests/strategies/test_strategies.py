"""Strategies on a real arm: J G = I, least norms, and velocity the same as G ẋ."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from arms import planar_task

import repctl_pin as rp


@pytest.fixture(scope="module")
def Q() -> np.ndarray:
    rng = np.random.default_rng(4)
    center = np.array([0, -np.pi / 4, 0, -3 * np.pi / 4, 0, np.pi / 2, np.pi / 4])
    return center + rng.uniform(-0.4, 0.4, (12, 7))


def inverses(task: rp.Task, design: rp.Design) -> list:
    rng = np.random.default_rng(0)
    return [
        rp.Pseudoinverse(task),
        rp.WeightedInverse(task, rng.uniform(0.5, 3, 7)),
        rp.WeightedInverse(task, np.eye(7) + 0.3),
        rp.WeightedInverse(task, lambda q: np.diag(1 + q**2)),
        rp.WeightedInverse(task, "inertia"),
        design.inverse,
    ]


def test_every_inverse_is_one_and_its_three_forms_agree(panda_pose, panda_design, Q) -> None:
    J = panda_pose.jacobians(Q)
    xdot = np.random.default_rng(1).normal(size=6)
    for strategy in inverses(panda_pose, panda_design):
        Gs = strategy.batch(Q)
        assert np.abs(J @ Gs - np.eye(6)).max() < 1e-11
        assert np.allclose(strategy.batch(Q, J), Gs, atol=1e-14)
        for q, G in zip(Q, Gs, strict=True):
            assert np.allclose(strategy(q), G, atol=1e-11)
            assert np.allclose(strategy.velocity(q, xdot), G @ xdot, atol=1e-11)


def test_inertia_weighting_gives_the_least_kinetic_energy(panda_pose, Q) -> None:
    xdot = np.random.default_rng(2).normal(size=6)
    M = panda_pose.inertias(Q)
    for q, M_q in zip(Q, M, strict=True):
        best = rp.WeightedInverse(panda_pose, "inertia").velocity(q, xdot)
        N = rp.redundancy.nullspace(panda_pose.jacobian(q))
        for a in (-0.1, 0.1):
            other = best + a * N[:, 0]
            assert other @ M_q @ other > best @ M_q @ best


def test_repeatable_inverse_keeps_h(panda_pose, panda_design, Q) -> None:
    V = panda_design.inverse.potentials.gradients(Q)
    assert np.abs(np.swapaxes(V, -1, -2) @ panda_design.inverse.batch(Q)).max() < 1e-12


def test_unit_weight_is_the_pseudoinverse(panda_pose, Q) -> None:
    assert np.allclose(
        rp.WeightedInverse(panda_pose, np.ones(7)).batch(Q), rp.Pseudoinverse(panda_pose).batch(Q)
    )


@pytest.mark.parametrize(
    "weight, message",
    [
        ("mass", "inertia"),
        (np.ones(6), r"shape \(6,\); give 7 numbers"),
        (-np.ones(7), "smallest eigenvalue is -1; give every joint a weight above 0"),
        (np.full(7, np.nan), "contains nan or inf"),
        (np.diag([np.inf] * 7), "contains nan or inf"),
        (np.eye(7) + np.eye(7, k=1), r"not symmetric: it differs from M\.T by 1;"),
    ],
)
def test_bad_weights_get_one_clear_line(panda_pose, weight, message: str) -> None:
    with pytest.raises(rp.InputError, match=message):
        rp.WeightedInverse(panda_pose, weight)


def test_an_arm_too_short_for_its_task_is_refused() -> None:
    task = rp.Robot.load("so100").task(None, "pose")
    with pytest.raises(rp.InputError, match="5 joints, too few for a pose task"):
        rp.Pseudoinverse(task)


def test_singular_configurations_are_named_errors() -> None:
    task = rp.Robot.load("planar3r").task("tool", "xy")
    stretched = np.zeros(3)
    for strategy in (rp.Pseudoinverse(task), rp.WeightedInverse(task, np.ones(3))):
        with pytest.raises(rp.SingularityError, match="singularity"):
            strategy(stretched)
        with pytest.raises(rp.SingularityError, match="singularity"):
            strategy.velocity(stretched, np.ones(2))


def test_a_link_without_inertia_is_named(tmp_path: Path) -> None:
    task = planar_task((1, 1, 1), tmp_path)
    with pytest.raises(
        rp.InputError, match="no link that theta1 moves .* give link 'link1' an <inertial>"
    ):
        rp.WeightedInverse(task, "inertia")


def test_many_pseudoinverses_are_those_of_numpy_and_count_singular_rows(panda_pose, Q) -> None:
    """C computes them, of any Jacobians: strided ones, too, and rows of very different sizes."""
    plain, J = rp.Pseudoinverse(panda_pose), panda_pose.jacobians(Q)
    sizes = 10.0 ** np.arange(-3, 3)[:, None]
    for given in (J, np.asfortranarray(J), sizes * J):
        G = plain.batch(Q, given)
        np.testing.assert_allclose(G, rp.redundancy.pseudoinverse(given), rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(given @ G, np.broadcast_to(np.eye(6), (12, 6, 6)), atol=1e-9)
    assert plain.batch(Q[:0]).shape == (0, 7, 6)
    J[[2, 5], 3] = J[[2, 5], 1]
    with pytest.raises(rp.SingularityError, match="at 2 of 12 configurations"):
        plain.batch(Q, J)


def test_the_quick_pseudoinverse_serves_rows_of_any_size(panda_pose, Q) -> None:
    """Short arms have small linear rows: that is no singularity, where J Jᵀ would not do."""
    plain = rp.Pseudoinverse(panda_pose)
    quick = [plain.velocity(q, np.ones(6)) for q in Q]
    np.testing.assert_allclose(quick, plain.batch(Q) @ np.ones(6), atol=1e-10)
