"""Joint coordinates q = T ψ: every method of a task in ψ, against the same task in q and closed
forms."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest
from arms import planar_urdf, spatial_task

import repctl_pin as rp

RNG = np.random.default_rng(0)


@pytest.fixture(scope="module")
def prr() -> rp.Task:
    return rp.Robot.load("prr").task("tool", "xy")


@pytest.fixture(scope="module", params=["pose", "axis", "position", "xz"])
def pair(request: pytest.FixtureRequest) -> tuple[rp.Task, rp.Task, np.ndarray]:
    """A panda task in q, the same in ψ, and T."""
    task = rp.Robot.load("panda").task(None, request.param)
    T = np.eye(7) + 0.4 * np.random.default_rng(3).normal(size=(7, 7))
    return task, task.in_coordinates(T), T


def test_absolute_angles_give_the_papers_kinematics(prr: rp.Task) -> None:
    task = prr.in_coordinates(rp.absolute_angles(prr))
    for d1, p2, p3 in RNG.uniform(-3, 3, (20, 3)):
        psi = np.array([d1, p2, p3])
        x = [d1 + np.cos(p2) + np.cos(p3), np.sin(p2) + np.sin(p3)]  # (10)
        assert np.abs(task.placement(psi).translation[:2] - x).max() < 1e-12
        J = [[1, -np.sin(p2), -np.sin(p3)], [0, np.cos(p2), np.cos(p3)]]  # (11)
        assert np.abs(task.jacobian(psi) - J).max() < 1e-12


def test_every_method_takes_psi(pair: tuple[rp.Task, rp.Task, np.ndarray]) -> None:
    task, other, T = pair
    assert (other.n, other.m, other.r, other.kind, other.frame) == (
        task.n,
        task.m,
        task.r,
        task.kind,
        task.frame,
    )
    psi = np.linalg.solve(T, task.reference) + 0.1 * RNG.normal(size=(4, 7))
    Q = psi @ T.T
    target = task.placement(task.reference)
    twist = RNG.normal(size=6)
    for p, q in zip(psi, Q, strict=True):
        assert np.allclose(
            other.placement(p).homogeneous, task.placement(q).homogeneous, atol=1e-12
        )
        assert np.allclose(other.error(p, target), task.error(q, target), atol=1e-12)
        assert np.allclose(other.task_velocity(p, twist), task.task_velocity(q, twist), atol=1e-12)
        assert np.allclose(other.joint_origins(p), task.joint_origins(q), atol=1e-12)
        assert np.allclose(other.jacobian(p), task.jacobian(q) @ T, atol=1e-12)
    assert np.allclose(other.positions(psi), task.positions(Q), atol=1e-12)
    assert np.allclose(other.to_robot(psi), task.to_robot(Q), atol=1e-12)
    assert np.allclose(other.jacobians(psi), [other.jacobian(p) for p in psi], atol=1e-14)
    assert np.allclose(other.inertias(psi), [T.T @ M @ T for M in task.inertias(Q)], atol=1e-12)


def test_the_hessian_in_psi_agrees_with_finite_differences(
    pair: tuple[rp.Task, rp.Task, np.ndarray],
) -> None:
    _, other, T = pair
    psi, e = (np.linalg.solve(T, other.robot.task(None, other.kind).reference) + 0.05, 1e-6)
    H = other.hessian(psi)
    for k, d in enumerate(np.eye(7)):
        slope = (other.jacobian(psi + e * d) - other.jacobian(psi - e * d)) / (2 * e)
        assert np.allclose(H[:, :, k], slope, atol=2e-8)


def test_the_pseudoinverse_in_psi_is_a_weighted_one_in_q(
    pair: tuple[rp.Task, rp.Task, np.ndarray],
) -> None:
    task, other, T = pair
    M = np.linalg.inv(T @ T.T)
    M = (M + M.T) / 2
    psi = np.linalg.solve(T, task.reference)
    G = T @ rp.Pseudoinverse(other)(psi)
    assert np.allclose(G, rp.WeightedInverse(task, M)(T @ psi), atol=1e-10)


def test_a_motion_is_the_same_in_both(prr: rp.Task) -> None:
    T = rp.absolute_angles(prr)
    other = prr.in_coordinates(T)
    q0 = np.array([0.2, 1.0, -1.5])
    M = np.linalg.inv(T @ T.T)
    path = rp.circle(prr, q0, 0.3)
    here = rp.follow(rp.WeightedInverse(prr, (M + M.T) / 2), path, q0, cycles=2, steps=60)
    there = rp.follow(rp.Pseudoinverse(other), path, np.linalg.solve(T, q0), cycles=2, steps=60)
    assert np.abs(there.q @ T.T - here.q).max() < 1e-10
    assert here.drift[-1] > 1e-3  # it does move


def test_limits_are_stated_where_they_are_exact_and_tested_on_the_joints(prr: rp.Task) -> None:
    T = rp.absolute_angles(prr)
    task = prr.in_coordinates(T)
    assert task.joint_names == ("d1", "ψ2", "ψ3")
    assert task.lower[:2].tolist() == prr.lower[:2].tolist() and np.isneginf(task.lower[2])
    assert task.upper[:2].tolist() == prr.upper[:2].tolist() and np.isposinf(task.upper[2])
    assert task.velocity_limit[:2].tolist() == prr.velocity_limit[:2].tolist() and np.isposinf(
        task.velocity_limit[2]
    )
    assert np.allclose(T @ task.reference, prr.reference)
    high = prr.upper[2]
    assert task.check([0, 1.0, 1.0 + high - 0.01]) is not None
    with pytest.raises(rp.InputError, match="theta3 = .* is outside its limits"):
        task.check([0, 1.0, 1.0 + high + 0.01])
    with pytest.raises(rp.InputError, match="theta3 = .* is outside its limits"):
        task.check([0, 0.5 - high, 1.0])
    with pytest.raises(rp.InputError, match="d1 = .* is outside its limits"):
        task.check([prr.upper[0] + 1, 0, 0])


def test_a_negative_factor_swaps_the_limits(prr: rp.Task) -> None:
    task = prr.in_coordinates(np.diag([1.0, -2.0, 0.5]))
    assert np.allclose(task.lower, [prr.lower[0], -prr.upper[1] / 2, prr.lower[2] / 0.5])
    assert np.allclose(task.upper, [prr.upper[0], -prr.lower[1] / 2, prr.upper[2] / 0.5])
    assert np.allclose(task.velocity_limit, prr.velocity_limit / [1, 2, 0.5])


def test_an_axis_that_points_the_other_way_counts_negative(tmp_path: Path) -> None:
    text = planar_urdf([1, 0.8, 0.6])
    second = text.index('name="theta2"')
    axis = text.index('xyz="0 0 1"', second)
    path = tmp_path / "turned.urdf"
    path.write_text(text[:axis] + 'xyz="0 0 -1"' + text[axis + len('xyz="0 0 1"') :])
    task = rp.Robot.load(path).task("tool", "xy")
    other = task.in_coordinates(rp.absolute_angles(task))
    a, b, c = psi = np.array([0.3, -1.1, 2.0])
    x = [
        np.cos(a) + 0.8 * np.cos(b) + 0.6 * np.cos(c),
        np.sin(a) + 0.8 * np.sin(b) + 0.6 * np.sin(c),
    ]
    assert np.abs(other.placement(psi).translation[:2] - x).max() < 1e-12


def test_what_is_no_change_of_coordinates_is_refused(prr: rp.Task, tmp_path: Path) -> None:
    with pytest.raises(rp.InputError, match="invertible"):
        prr.in_coordinates(np.ones((3, 3)))
    with pytest.raises(rp.InputError, match=r"(3, 3)"):
        prr.in_coordinates(np.eye(2))
    with pytest.raises(rp.InputError, match=r"(3, 3)"):
        prr.in_coordinates([[1, 2], [3]])
    with pytest.raises(rp.InputError, match="finite"):
        prr.in_coordinates(np.diag([1, np.nan, 1]))
    task = prr.in_coordinates(np.eye(3))
    with pytest.raises(rp.InputError, match="already"):
        task.in_coordinates(np.eye(3))
    with pytest.raises(rp.InputError, match="already"):
        rp.absolute_angles(task)
    with pytest.raises(rp.InputError, match="parallel axes"):
        rp.absolute_angles(spatial_task(5, tmp_path))


def test_the_task_in_q_is_left_alone_and_both_pickle(prr: rp.Task) -> None:
    q = np.array([0.1, 0.2, 0.3])
    before = prr.jacobian(q)
    task = prr.in_coordinates(rp.absolute_angles(prr))
    again = pickle.loads(pickle.dumps(task))
    assert np.array_equal(again.jacobian(q), task.jacobian(q))
    assert np.array_equal(prr.jacobian(q), before) and prr.coordinates is None


def test_limits_are_those_of_the_joints(prr: rp.Task) -> None:
    """θ₃ = ψ₃ − ψ₂ has no bound of its own in ψ, and must be seen all the same."""
    T = rp.absolute_angles(prr)
    task = prr.in_coordinates(T)
    rng = np.random.default_rng(0)
    Q = rng.uniform(-1, 1, (50, 3)) * [4, 5, 9]
    psi = np.linalg.solve(T, Q.T).T
    assert np.allclose(task.limit_margin(psi), np.minimum(Q - prr.lower, prr.upper - Q))
    # a motion that takes θ₃ out of its limits, and turns it above its speed limit
    q0 = np.array([0.0, 1.0, -5.2])
    path = rp.circle(prr, q0, 0.3)
    M = np.linalg.inv(T @ T.T)
    here = rp.follow(
        rp.WeightedInverse(prr, (M + M.T) / 2), path, q0, cycles=2, steps=60, period=0.2
    )
    there = rp.follow(
        rp.Pseudoinverse(task), path, np.linalg.solve(T, q0), cycles=2, steps=60, period=0.2
    )
    assert here.limit_margin.min() < -0.01 and here.speed_ratio > 1.5
    assert np.allclose(there.limit_margin, here.limit_margin, atol=1e-8)
    assert there.speed_ratio == pytest.approx(here.speed_ratio, rel=1e-6)
    assert there.fastest_joint == here.fastest_joint
    assert there.first_violation == here.first_violation


def test_a_design_in_psi_says_what_share_of_its_region_is_inside_the_joints_limits(
    prr: rp.Task,
) -> None:
    T = rp.absolute_angles(prr)
    task = prr.in_coordinates(T)
    center = np.linalg.solve(T, [0.0, 1.0, prr.upper[2]])  # half of the box is outside
    box = rp.Box(center, 0.1)
    design = rp.nearest_repeatable(
        rp.Pseudoinverse(task),
        None,
        box,
        degree=1,
        options=rp.FitOptions(samples=256, held_out=256),
    )
    assert design.inside_limits == pytest.approx(0.5, abs=0.05)


def test_limits_are_the_joints_own_in_any_coordinates(
    pair: tuple[rp.Task, rp.Task, np.ndarray],
) -> None:
    task, other, T = pair
    assert np.array_equal(task.coordinate_matrix, np.eye(7)) and np.array_equal(
        other.coordinate_matrix, T
    )
    outside = np.array(task.reference)
    outside[3] = task.upper[3] + 0.5
    region = rp.Box(np.linalg.solve(T, outside), 0.01)
    with pytest.raises(rp.InputError, match="outside the joint limits: panda_joint4"):
        rp.nearest_repeatable(rp.Pseudoinverse(other), None, region, degree=2)
    with pytest.raises(rp.InputError, match="mixes joints"):
        rp.LimitWeight(other)
    with pytest.raises(rp.InputError, match="before in_coordinates"):
        rp.Cell(other, other.placement(region.center), 0.1)
    doubled = task.in_coordinates(2 * np.eye(7))  # a gear ratio mixes nothing
    assert np.allclose(
        rp.LimitWeight(doubled)(task.reference / 2), rp.LimitWeight(task)(task.reference)
    )
