"""Problem that a design solves, optionally with another start or path.

The region Ω is the part of joint space for which the design was made. A self-motion moves the
joints while the frame rests.

``ClosedPath`` is a closed path as a function of s, which goes from 0 to 1 in a cycle. ``Cycle`` is
one cycle of a motion that ends in its start: start configuration, path and period, s.
"""

from __future__ import annotations

from functools import partial
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from ..base.arguments import Array
from ..base.plugins import parts
from ..design import Design
from ..model.task import Task
from ..motion.fitting_circle import fitting_circle
from ..paths import ClosedPath
from ..paths.task_path import Cycle
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

    By default, start and path are those of the design's cycle. If only another start is given, the
    design's path is kept if it begins at the pose of that start; otherwise, and if the design has
    no path, the path is the largest circle, of several radii, on which the motion stays inside the
    region. If the design has no cycle, the default start is the centre of the region. With
    ``path=False``, the problem has no path, and the default start is this centre, too.

    Parameters
    ----------
    design
        :class:`Design`, or the design of an extension, such as :class:`CellDesign`.
    start, path, plane
        Start configuration (n,); closed path, its name on the command line, or a function
        (task, q0) → path; plane of a path given by name.

    Raises
    ------
    InputError
        If the motion on every circle tried leaves the region Ω of the design, or the path cannot be
        followed from the start.
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
        if start is not None:
            return problem
        return problem._with(start_is="the centre of the region")
    own = path is None and plane is None
    if own and cycle is not None and start is None:
        problem = Problem(task, start=cycle.start, path=False, region=region)
        return problem._with(path=cycle.path, period=cycle.period, start_is=SAVED)
    if start is None:
        start = region.center if cycle is None else cycle.start
    start = task.check(start, "start")
    if own:
        path = partial(fitting_circle, control=design.inverse, region=region)
        if cycle is not None and _begins(cycle, task, start):
            path = cycle.path
    return Problem(task, start=start, path=path, plane=plane, region=region)


def _begins(cycle: Cycle, task: Task, start: Array) -> bool:
    """Test whether a cycle's path begins at the pose of a start (n,), within 1e-6 m and rad.

    The start can differ from that of the cycle by a self-motion.
    """
    gap = task.error(start, cycle.path.placement(0.0))
    return bool(np.abs(gap).max() < SAME)
