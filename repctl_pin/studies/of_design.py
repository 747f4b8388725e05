"""Problem that a design solves, optionally with another start or path."""

from __future__ import annotations

from functools import partial
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from ..design import Design
from ..motion.fitting_circle import fitting_circle
from ..paths import ClosedPath
from ..paths.task_path import Cycle
from ..plugins import parts
from .choose_start import SAME, PathOf
from .problem import SAVED, Problem


def problem_of(
    design: Any,
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
        :class:`Design`, or the design of an extension, such as :class:`CellDesign`.
    start, path, plane
        As for :class:`Problem`.

    Raises
    ------
    InputError
        If no circle lies inside Ω, or the path cannot be followed from the start.
    """
    if not isinstance(design, Design):
        kinds = dict(parts("problem"))
        return kinds[type(design)](design, start, path, plane)
    task = design.task
    region = design.region
    cycle = design.cycle
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
