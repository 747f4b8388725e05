"""Cells of the panda, and inverse kinematic functions over them that need no search."""

from __future__ import annotations

from functools import cache

import numpy as np
import pinocchio as pin
from arms import Q_PANDA

import repctl_pin as rp
from repctl_pin.inverse_function import chart, reference

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


def cell_of(
    kind: str = "pose", rotation: float = 0.0, half_width: float = 0.1
) -> rp.Cell:
    return rp.Cell(panda(kind), middle(kind), half_width, rotation)


def chart_of(
    cell: rp.Cell, q: np.ndarray, degree: int = 3, count: int = 128
) -> chart.Chart:
    ends = reference.rays(rp.Pseudoinverse(cell.task), cell, q, cell.sample(count))
    assert (ends.reached == 1).all()
    return reference.fitted(cell, ends.U, ends.Q, ends.N, degree)


def function_of(name: str) -> rp.InverseFunction:
    """A section near straight fibres; what it is worth does not matter here."""
    kind, rotation = CELLS[name]
    cell = cell_of(kind, rotation)
    return rp.InverseFunction(
        chart_of(cell, rp.solve_ik(cell.task, Q_PANDA, cell.placement))
    )
