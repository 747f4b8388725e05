"""Where a motion begins and what it follows: the same for every command that leads an arm round a path."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arguments import function
from ..errors import RepctlError, SingularityError
from ..motion import ClosedPath, TaskPath, check_reach, closed_path, reach_start
from ..motion.fitting import dexterity
from ..robot.task import Task
from . import defaults

Array = NDArray[np.float64]

GIVEN = "as given"

_SINGULAR = 1e-3


class Setting(NamedTuple):
    """A start, and a path that can be followed from there."""

    q0: Array
    path: TaskPath
    where: str  # what the start is
    moved: list[str]  # a note, where it is not quite that

    @property
    def notes(self) -> list[str]:
        """What a person should know of it."""
        return [*([] if self.where == GIVEN else [f"start: {self.where}"]), *self.moved]


def choose_setting(
    task: Task, start: ArrayLike | None, path: ClosedPath | Callable[[Task, Array], TaskPath]
) -> Setting:
    """Take the start, or the first good one from which the path can be followed; and say which it is.

    Parameters
    ----------
    task
        What to move.
    start : (n,) array, optional
        q0; by default the first of :func:`starts` that will do.
    path
        A closed path, or a function ``(task, q0) → path``. Where it begins elsewhere, the start is moved there.

    Raises
    ------
    InputError
        If the path cannot be followed from there; without a start, what the best one was refused for.
    SingularityError
        If the start is singular.
    """
    if isinstance(path, ClosedPath):
        given = closed_path(path)
        path = lambda task, q0: given  # noqa: E731
    function(path, "path", "a closed path, such as rp.circle(task, q0), or a function (task, q0) → path")
    offered = defaults.starts(task) if start is None else [(task.check(start, "start"), GIVEN)]
    failure: RepctlError | None = None
    for q0, where in offered:
        try:
            if dexterity(task, q0) < _SINGULAR:
                raise SingularityError(
                    f"the start is at a singularity of {task.frame!r}, {task.kind}; choose another start"
                )
            found = closed_path(path(task, q0))
            begin = reach_start(task, q0, found)
            check_reach(task, begin, found)
        except RepctlError as error:
            failure = failure or error  # of the best start
            continue
        there = np.array_equal(begin, q0)
        return Setting(begin, found, where, [] if there else ["the start was moved to the path's first point"])
    assert failure is not None  # there is always a start to try
    raise failure
