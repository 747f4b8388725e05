"""Formulas that a quick look would let pass if they were a little wrong, each against its closed
form."""

from __future__ import annotations

import numpy as np
import pytest
from threadpoolctl import threadpool_info

import repctl_pin as rp
from repctl_pin.blas import one_blas_thread
from repctl_pin.design.evaluation import evaluate_design
from repctl_pin.strategies.control_step import damped


@pytest.mark.parametrize("least", [0.0, 0.01, 0.1, 0.19])
def test_damping_is_continuous_and_bounds_the_step(least: float) -> None:
    """λ² = λ_max² (1 − (σ_min / 2 λ_max)²) below 2 λ_max, 0 above."""
    x, used = damped(np.diag([1.0, least]), np.ones(2), 0.1)
    square = 0.1**2 * (1 - (least / 0.2) ** 2)
    assert used == pytest.approx(np.sqrt(square)) and x == pytest.approx(
        [1 / (1 + square), least / (least**2 + square)]
    )
    assert np.abs(x[1]) <= 1 / (np.sqrt(3) * 0.1) + 1e-12
    assert damped(np.diag([1.0, 0.2001]), np.ones(2), 0.1)[1] == 0


def test_a_limit_weight_is_its_formula(panda_pose: rp.Task) -> None:
    quarter = panda_pose.lower + 0.25 * (panda_pose.upper - panda_pose.lower)
    near, far = (
        1 + (share / 0.4) ** 2 for share in (0.5, 1.5)
    )  # shares of half the range
    assert rp.LimitWeight(panda_pose, 0.6, 0.4)(quarter) == pytest.approx(
        1 + 0.6 * (near**-2 + far**-2)
    )
    assert np.array_equal(
        rp.LimitWeight(panda_pose)(quarter),
        rp.LimitWeight(panda_pose, 1.0, 0.1)(quarter),
    )


def test_the_standard_error_is_widened_as_students(panda_design: rp.Design) -> None:
    made = panda_design
    found = evaluate_design(made.inverse, made.desired, made.region, samples=1024)
    plain = found.replicates.std(ddof=1) / np.sqrt(len(found.replicates))
    assert found.cost_error == pytest.approx(plain * np.sqrt(31 / 29), rel=1e-12)


def test_a_workspace_box_weighs_by_the_coarea_formula() -> None:
    task = rp.Robot.load("planar3r").task("tool", "xy")
    q = np.array([0.3, 1.0, 0.8])
    region = rp.WorkspaceBox(
        task, task.placement(q).translation[:2], 0.4, within=rp.Box(q, 0.5)
    )
    Q = region.random(64, 0)
    volume = [np.sqrt(np.linalg.det(J @ J.T)) for J in task.jacobians(Q)]
    assert region.weights(Q) == pytest.approx(np.array(volume) / np.sum(volume))


def test_blas_keeps_to_one_thread_and_is_given_back() -> None:
    def threads() -> list[int]:
        return [
            pool["num_threads"]
            for pool in threadpool_info()
            if pool["user_api"] == "blas"
        ]

    before = threads()
    with one_blas_thread():
        with one_blas_thread():
            assert set(threads()) == {1}
        assert set(threads()) == {1}
    assert threads() == before
    seen: list[int] = []
    task = rp.Robot.load("planar3r").task("tool", "xy")
    box = rp.Box([0.3, 1.0, 0.8], 0.2)
    rp.nearest_repeatable(
        rp.Pseudoinverse(task),
        None,
        box,
        degree=1,
        options=rp.FitOptions(samples=64, held_out=64),
        progress=lambda *_: seen.extend(threads()),
    )
    assert set(seen) == {1} and threads() == before
