"""Cells of the panda, and inverse kinematic functions over them that need no search."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from arms import Q_PANDA
from store import shared

import repctl_pin as rp
from repctl_pin.extensions.cells.chart import chart
from repctl_pin.extensions.cells.evaluate import reach

CELLS = {
    "poses": ("pose", 0.3),
    "poses of one orientation": ("pose", 0.0),
    "tool axes": ("axis", 0.3),
    "positions": ("position", 0.0),
}


@cache
def panda(kind: str = "pose") -> rp.Task:
    return rp.Robot.load("panda").task("panda_hand_tcp", kind)


def middle(kind: str = "pose") -> pin.SE3:
    x = panda(kind).placement(Q_PANDA)
    return pin.SE3(x.rotation, x.translation + [0.15, 0.0, -0.19])


def cell_of(kind: str = "pose", rotation: float = 0.0, half_width: float = 0.1) -> rp.Cell:
    return rp.Cell(panda(kind), middle(kind), half_width, rotation)


def chart_of(cell: rp.Cell, q: np.ndarray, degree: int = 3, count: int = 128) -> Any:
    """The chart of polynomials that the joints at the ends of rays from the middle have."""
    ends = reach.rays(rp.Pseudoinverse(cell.task), cell, q, cell.sample(count))
    assert (ends.reached == 1).all()
    return chart.Chart.fitted(cell, ends.U, ends.Q, ends.N, degree)


@shared
def function_of(name: str) -> rp.InverseFunction:
    """A section near straight fibres; what it is worth does not matter here."""
    kind, rotation = CELLS[name]
    cell = cell_of(kind, rotation)
    return rp.InverseFunction(chart_of(cell, rp.solve_ik(cell.task, Q_PANDA, cell.placement)))


@cache
def on_a_workpiece() -> rp.InverseFunction:
    """A welding torch on the workpiece that a two-axis positioner moves: n = 8, r = 2."""
    weld = Path(__file__).parents[1] / "examples" / "weld_cell.urdf"
    task = rp.Robot.load(weld).task("torch", "pose", on="workpiece")
    ready = [0.0, 0.0, 0.0, 0.5, -0.9, 0.0, 1.2, 0.0]
    place = pin.SE3(pin.utils.rotate("y", np.pi), np.array([0.05, 0.0, 0.05]))
    cell = rp.Cell(task, place, 0.05, 0.1)
    return rp.InverseFunction(chart_of(cell, rp.solve_ik(task, ready, place), degree=2))


def f_in_numpy(function: rp.InverseFunction) -> rp.InverseFunction:
    """The same function on the plain NumPy law."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("REPCTL_NATIVE", "no")
        return rp.InverseFunction(function.chart, keep_limits=function.keep_limits)


def tour(cell: rp.Cell, seed: int = 0, reach: float = 0.9) -> rp.TaskPath:
    """A random closed path through a cell: three waves in each of its coordinates, each of which
    comes to ``reach`` on one side at least."""
    waves = 2 * np.pi * np.arange(1, 4)
    a, phase = np.random.default_rng(seed).uniform(0.2, 1.0, size=(2, cell.k, 3))
    s = np.linspace(0, 1, 1001)

    def raw(s: np.ndarray) -> np.ndarray:
        turns = np.multiply.outer(s, waves)[:, None] + 2 * np.pi * phase
        return (a / waves * np.sin(turns)).sum(axis=2)

    most = np.abs(raw(s)).max(axis=0)

    def placed(s: float) -> tuple[np.ndarray, np.ndarray]:
        p, R = cell.placements(reach / most * raw(np.array([s])))
        return p[0], R[0]

    def slope(s: float) -> np.ndarray:
        return (placed(s + 1e-6)[0] - placed(s - 1e-6)[0]) / 2e-6

    turned = cell.task.m > 3
    rotation = (lambda s: placed(s)[1]) if turned else cell.placement.rotation
    return rp.TaskPath(f"loop {seed}", lambda s: placed(s)[0], slope, rotation)
