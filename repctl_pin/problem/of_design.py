"""Problem that a design solves, optionally with another start or path."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike

from ..design import Design
from ..motion.fitting_circle import fitting_circle
from ..paths import ClosedPath
from ..paths.task_path import Cycle
from .choose_start import SAME, PathOf
from .problem import SAVED, Problem

if TYPE_CHECKING:
    from ..inverse_function import CellDesign


def problem_of(
    design: Design | CellDesign,
    *,
    start: ArrayLike | None = None,
    path: str | ClosedPath | PathOf | Literal[False] | None = None,
    plane: str | None = None,
) -> Problem:
    """Create the problem that a design solves, from its task, region and cycle.

    Another start or path can be given. A design without a cycle gets the largest circle inside its
    region. With ``path=False``, the default start is the centre of the region.

    Parameters
    ----------
    design
        Design of a repeatable inverse; or of a cell's function, in which case the region is the
        cell.
    start, path, plane
        As for :class:`Problem`.

    Raises
    ------
    InputError
        If no circle lies inside Ω, or the path cannot be followed from the start.
    """
    if not isinstance(design, Design):
        return _of_cell(design, start, path, plane)
    task, region, cycle = design.task, design.region, design.cycle
    if path is False:
        begin = region.center if start is None else start
        problem = Problem(task, start=begin, path=False, region=region)
        return (
            problem
            if start is not None
            else problem._with(start_is="the centre of the region")
        )
    if path is not None or plane is not None or cycle is None:
        center = region.center if cycle is None else cycle.start
        begin = center if start is None else start
        inside = partial(fitting_circle, control=design.inverse, region=region)
        draw = inside if path is None and plane is None else path
        return Problem(task, start=begin, path=draw, plane=plane, region=region)
    return _of_cycle(design, cycle, start)


def _of_cycle(design: Design, cycle: Cycle, start: ArrayLike | None) -> Problem:
    """Create the problem of the cycle that a design was made for, from its start or another one.

    Another start keeps the path if it is at the path's first pose, on any leaf. Otherwise the path
    is a circle inside the region.
    """
    task, region = design.task, design.region
    if start is None:
        problem = Problem(task, start=cycle.start, path=False, region=region)
        return problem._with(path=cycle.path, period=cycle.period, start_is=SAVED)
    start = task.check(start, "start")
    gap = task.error(start, cycle.path.placement(0.0))
    if np.abs(gap).max() < SAME:
        return Problem(task, start=start, path=cycle.path, region=region)
    inside = partial(fitting_circle, control=design.inverse, region=region)
    return Problem(task, start=start, path=inside, region=region)


def _of_cell(
    design: CellDesign,
    start: ArrayLike | None,
    path: str | ClosedPath | PathOf | Literal[False] | None,
    plane: str | None,
) -> Problem:
    """Create a problem inside a cell.

    By default it begins at the configuration that the function gives for the path's first pose.
    """
    from ..inverse_function import Sector  # slow to import, and not needed by a study
    from ..inverse_function.sample_path import tour

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
