"""The kinematics and Newton's method of a chart in C are NumPy's, on arms of all kinds."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from arms import planar_urdf, spatial_urdf
from cell_functions import CELLS, chart_of, function_of
from controls import NEEDS_C, own_cache  # noqa: F401

import repctl_pin as rp

EXACT = 1e-12


def both_ways(text: str, kind: str, folder: Path) -> list[rp.Task]:
    """The arm, and the same one with 32 more joints before its tip, which follow its first joint
    and undo each other: more than the C code takes."""
    tip = text[text.rindex("<joint ") :]
    (last,) = re.findall('<parent link="([^"]*)"/>', tip)
    (first, *_), chain = re.findall('<joint name="([^"]*)"', text), ""
    for i in range(32):
        link = f'<parent link="{f"more{i - 1}" if i else last}"/><child link="more{i}"/>'
        chain += (
            f'<link name="more{i}"/><joint name="m{i}" type="revolute">{link}'
            '<axis xyz="0 0 1"/><limit lower="-9" upper="9" effort="1" velocity="9"/>'
            f'<mimic joint="{first}" multiplier="{1 - 2 * (i % 2)}" offset="0"/></joint>'
        )
    longer = text.replace(tip, chain + tip.replace(f'"{last}"', '"more31"', 1))
    tasks = []
    for name, one in (("arm", text), ("longer", longer)):
        (folder / f"{name}.urdf").write_text(one)
        tasks.append(rp.Robot.load(folder / f"{name}.urdf").task("tool", kind))
    assert tasks[1].model.njoints > 33 and tasks[0].n == tasks[1].n
    return tasks


def moved(chart: Any, task: rp.Task) -> Any:
    """The same chart for the same arm in another file."""
    cell = chart.cell
    turned = cell.rotation if len(cell.rotation) else 0.0
    same = rp.Cell(task, cell.placement, cell.half_width, turned)
    return replace(chart, cell=same)


def agree_in_place(chart: Any) -> None:
    """Compare R, J and the residual with the task's own, anywhere the arm can be."""
    cell, task, rng = chart.cell, chart.cell.task, np.random.default_rng(0)
    Q = np.clip(task.reference + rng.normal(size=(20, task.n)), -3, 3)
    U, s = np.zeros((20, cell.k)), np.zeros((20, task.r))
    at = chart.solve(U, s, Q, iterations=0)
    places = [task.placement(q) for q in Q]
    assert np.array_equal(at.Q, Q)
    assert np.abs(at.R - [x.rotation for x in places]).max() < EXACT
    assert np.abs(at.J - task.jacobians(Q)).max() < EXACT
    due = [np.abs(task.error(q, cell.placement)).max() for q in Q]
    assert np.abs(at.residual - due).max() < EXACT


@NEEDS_C
@pytest.mark.parametrize("kind", ["pose", "axis", "position", "xz"])
def test_newtons_method_in_c_is_numpys(kind: str, tmp_path: Path) -> None:
    """The same kinematics, solutions, residuals and failures, from good starts and from bad ones,
    on random axes with prismatic joints."""
    arm, _ = tasks = both_ways(spatial_urdf(8, 1), kind, tmp_path)
    turned = 0.3 * (kind in ("pose", "axis"))
    cell = rp.Cell(arm, arm.placement(arm.reference), 0.02, turned)
    charts = [moved(chart_of(cell, arm.reference, 1, 64), task) for task in tasks]
    U = cell.sample(64)
    s = np.where(np.arange(64) < 32, 0.02, 4.0)[:, None] * np.ones(arm.r)
    fast, slow = (chart.solve(U, s) for chart in charts)
    assert np.array_equal(fast.found, slow.found) and fast.found[:32].all()
    for one in ("Q", "R", "J", "q_ref", "n_ref", "U"):
        away = np.abs(getattr(fast, one) - getattr(slow, one))[slow.found]
        assert away.max() < 1e-11
    assert fast.residual[slow.found].max() < EXACT
    for chart in charts:
        agree_in_place(chart)


@NEEDS_C
@pytest.mark.parametrize("kind", ["pose", "axis", "position", "xz"])
def test_kinematics_of_a_torso_and_of_joints_that_slide(kind: str) -> None:
    task = rp.Robot.load("tiago").task("wrist_ft_tool_link", kind)
    cell = rp.Cell(task, task.placement(task.reference), 0.02)
    agree_in_place(chart_of(cell, task.reference, 1, 16))


@pytest.mark.parametrize("name", CELLS)
def test_solutions_satisfy_both_equations(name: str) -> None:
    """f(q) = x(u) by the task, and n_refᵀ (q − q_ref) = s; none is found that does not."""
    chart = function_of(name).chart
    cell, r = chart.cell, chart.cell.task.r
    U = cell.sample(64)
    s = np.where(np.arange(64) < 32, 0.05, 4.0)[:, None] * np.ones(r)
    at = chart.solve(U, s)
    q_ref, n_ref = chart.reference(U)
    assert at.found[:32].all()
    for i in np.flatnonzero(at.found):
        assert np.abs(cell.task.error(at.Q[i], cell.at(U[i]))).max() < 1e-11
        assert np.abs(n_ref[i].T @ (at.Q[i] - q_ref[i]) - s[i]).max() < 1e-11


@pytest.mark.parametrize("compiled", [False, pytest.param(True, marks=NEEDS_C)])
def test_a_singular_matrix_leaves_the_others_solved(compiled: bool, tmp_path: Path) -> None:
    """One of the starts is a stretched arm, whose J has a row of zeros."""
    tasks = both_ways(planar_urdf([1.0, 0.9, 0.8]), "xy", tmp_path)
    task, q = tasks[0 if compiled else 1], np.array([0.3, 0.9, 0.8])
    cell = rp.Cell(tasks[0], task.placement(q), 0.02)
    chart = moved(chart_of(cell, q, 2, 32), task)
    U, s = 0.5 * cell.sample(8), np.zeros((8, 1))
    alone = chart.solve(U, s)
    starts = alone.Q + 0.01
    starts[3] = 0.0
    assert np.linalg.matrix_rank(task.jacobian(starts[3])) == 1
    among = chart.solve(U, s, starts)
    others = np.delete(np.arange(8), 3)
    assert alone.found.all() and among.found[others].all() and not among.found[3]
    assert np.abs(among.Q - alone.Q)[others].max() < 1e-11
    ends = chart.solve(U, s, starts, iterations=0)
    dF, B = chart.derivative(ends, np.zeros((8, 1, 2)))
    assert np.isnan(dF[3]).all() and np.isnan(B[3]).all()
    J = task.jacobians(starts)
    assert np.allclose((J @ dF)[others], cell.half_width * np.eye(2), atol=1e-9)
    assert np.allclose((J @ B)[others], 0, atol=1e-9)
