"""Problem that the design of a cell solves, optionally with another start or path."""

from __future__ import annotations

from functools import partial
from typing import Literal

from numpy.typing import ArrayLike

from ...motion.fitting_circle import fitting_circle
from ...paths import ClosedPath
from ...studies.choose_start import PathOf
from ...studies.problem import Problem
from .cell_design import CellDesign
from .sample_path import tour
from .sector import Sector


def problem_of_cell(
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


PROBLEM = (CellDesign, problem_of_cell)
"""The part that :func:`repctl_pin.plugins.parts` gives for the place ``problem``."""
