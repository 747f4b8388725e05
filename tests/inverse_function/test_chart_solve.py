"""The kinematics and Newton's method of a chart in C are NumPy's, on arms of all kinds."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from arms import spatial_task
from cell_functions import CELLS, function_of
from controls import NEEDS_C, own_cache  # noqa: F401

import repctl_pin as rp
from repctl_pin.inverse_function import chart as charts
from repctl_pin.inverse_function import chart_solve, kinematics, margins, posture_search
from repctl_pin.robot.bodies import bodies_of

EXACT = 1e-12


def agree_in_place(task: rp.Task) -> None:
    """Compare f and J with the task's own."""
    Q = np.clip(
        task.reference + np.random.default_rng(0).normal(size=(20, task.n)), -3, 3
    )
    fast = chart_solve.compiled_chain(task)
    assert fast is not None
    p, R, J = fast.placed(Q)
    places = [task.placement(q) for q in Q]
    assert np.abs(p - [x.translation for x in places]).max() < EXACT
    assert np.abs(R - [x.rotation for x in places]).max() < EXACT
    assert np.abs(J - task.jacobians(Q)).max() < EXACT


@NEEDS_C
@pytest.mark.parametrize("kind", ["pose", "axis", "position", "xz"])
def test_kinematics_in_c_are_the_tasks(kind: str, tmp_path: Path) -> None:
    """Also of random axes with prismatic joints, and of tiago's torso."""
    agree_in_place(rp.Robot.load("tiago").task("wrist_ft_tool_link", kind))
    agree_in_place(spatial_task(8, tmp_path, kind=kind, seed=1))


@NEEDS_C
@pytest.mark.parametrize("name", CELLS)
def test_newtons_method_in_c_is_numpys(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The same solutions, residuals and failures, from good starts and from bad ones."""
    chart = function_of(name).chart
    U, r = chart.cell.sample(64), chart.cell.task.r
    s = np.where(np.arange(64) < 32, 0.05, 4.0)[:, None] * np.ones(r)
    fast = chart.solve(U, s)
    with monkeypatch.context() as patch:
        for module in (charts, kinematics):
            patch.setattr(module, "compiled_chain", lambda task: None)
        slow = chart.solve(U, s)
    assert np.array_equal(fast.found, slow.found) and fast.found[:32].all()
    for one in ("Q", "R", "J", "q_ref", "n_ref", "U"):
        away = np.abs(getattr(fast, one) - getattr(slow, one))[slow.found]
        assert away.max() < 1e-11
    assert fast.residual[slow.found].max() < EXACT


def test_the_lowest_body_distance_is_that_of_all() -> None:
    """Where hulls overlap, few bodies are tested, and the minimum is still that of all poses."""
    task = rp.Robot.load("xarm7").task("link_eef", "pose")
    rng, bodies = np.random.default_rng(0), bodies_of(task)
    for size in (0.1, 1.0):
        Q = task.reference + size * rng.normal(size=(40, task.n))
        exact = bodies.distances(Q)
        found, share = margins.lowest_distances(bodies, Q)
        assert found.min() == exact.min()
        assert abs(share - (exact < 0).mean()) < 0.2
        assert (found >= exact - 1e-12).all() or exact.min() < 0
    # and of a configuration whose hulls overlap, in the middle of a cell, but no bodies
    q = np.array([-1.25, -0.15, 0.35, -0.1, -0.8, -0.87, 0.43])
    assert bodies.hull_distances(q[None])[0] < -0.005
    (one,) = posture_search.judged(
        rp.Pseudoinverse(task), rp.Cell(task, task.placement(q), 1e-3), q[None]
    )
    assert one.share == 1 and one.body_distance >= 0


@pytest.mark.parametrize("columns", [(), (2,)])
def test_a_singular_matrix_leaves_the_others_solved(columns: tuple[int, ...]) -> None:
    rng = np.random.default_rng(0)
    A, x = rng.normal(size=(5, 4, 4)), rng.normal(size=(5, 4, *columns))
    b = np.einsum("kij,kj...->ki...", A, x)
    np.testing.assert_allclose(kinematics.solved(A, b), x, rtol=1e-9)
    A[2] = 0.0
    found = kinematics.solved(A, b)
    np.testing.assert_allclose(np.delete(found, 2, 0), np.delete(x, 2, 0), rtol=1e-9)
    assert np.isnan(found[2]).all()
