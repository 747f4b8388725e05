"""Problem that the design of a cell solves, with a start and a path of its own or others: a random
smooth closed path through the cell."""

from __future__ import annotations

from functools import partial
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from ...arguments import Array
from ...motion.fitting_circle import fitting_circle
from ...paths import ClosedPath, TaskPath
from ...studies.choose_start import PathOf
from ...studies.problem import Problem
from .cell import Cell
from .cell_design import CellDesign
from .sector import Sector

_WAVES = 3
_POINTS = 721
_REACH = 0.9


def _problem_of_cell(
    design: CellDesign,
    start: ArrayLike | None,
    path: str | ClosedPath | PathOf | Literal[False] | None,
    plane: str | None,
) -> Problem:
    """Create a problem inside a cell.

    By default it begins at the configuration that the function gives for the path's first pose.
    """
    begin = design.posture if start is None else start
    inside = partial(fitting_circle, control=design.inverse, region=design.cell)
    draw = inside if path is None and plane is None else path
    if draw is inside and isinstance(design.cell, Sector):
        draw = tour(
            design.cell
        )  # the orientation turns with the angle, which no circle does
    problem = Problem(design.task, start=begin, path=draw, plane=plane)._with(
        region=design.cell
    )
    if start is not None or path is False:
        return problem
    q0 = design.function(problem.cycle.placement(0.0))
    name = "the configuration that the function gives where the path begins"
    return problem._with(start=q0, start_is=name, moved=(), region=design.cell)


PROBLEM = (CellDesign, _problem_of_cell)
"""The part that :func:`repctl_pin.plugins.parts` gives for the place ``problem``."""


def tour(cell: Cell) -> TaskPath:
    r"""Make a random smooth closed path through a cell.

    Its coordinates in the cell are ``u_i(s) = Σ_k a_ik cos 2πks + b_ik sin 2πks`` for s from 0 to
    1, with random a and b, scaled so that the maximum of every |u_i| is 0.9.
    """
    rng = np.random.default_rng(0)
    k = 2 * np.pi * np.arange(1, _WAVES + 1)
    a, b = rng.normal(size=(2, cell.k, _WAVES)) / np.arange(1, _WAVES + 1)
    s = np.linspace(0, 1, _POINTS)[:, None]
    most = np.abs(np.cos(k * s) @ a.T + np.sin(k * s) @ b.T).max(axis=0)
    a, b = _REACH * a / most[:, None], _REACH * b / most[:, None]
    R_0, active = cell.placement.rotation, cell.moved
    turning = cell._frame_twists(np.zeros((1, cell.task.m)))[0, 3:][:, active]
    turns = cell.task.m > 3 and bool(turning.any())

    def at(s: float) -> Array:
        """Evaluate the coordinates u (k,) at the path parameter s."""
        return np.asarray(a @ np.cos(k * s) + b @ np.sin(k * s), float)

    def placed(s: float) -> tuple[Array, Array]:
        """Evaluate the position (3,), m, and the rotation (3, 3) at the path parameter s."""
        p, R = cell.placements(at(s)[None])
        return p[0], R[0]

    def twist(s: float) -> Array:
        """Evaluate the twist (v, ω), base axes, per unit of the path parameter s: (6,)."""
        du = b @ (k * np.cos(k * s)) - a @ (k * np.sin(k * s))
        rates = cell.spread(du[None])[0] - cell._offset
        return np.asarray(
            cell._frame_twists(cell.spread(at(s)[None]))[0] @ rates, float
        )

    return TaskPath(
        "tour 0 of the cell",
        lambda s: placed(s)[0],
        lambda s: twist(s)[:3],
        (lambda s: placed(s)[1]) if turns else R_0,
        spin=(lambda s: twist(s)[3:]) if turns else None,
    )
