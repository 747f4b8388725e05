"""A problem: task, start, closed path and region Ω, checked and complete.

The region Ω is the part of joint space for which a controller is designed. Parts that are not given
are chosen, by ``choose_task`` and ``choose_start``. J⁺ is the pseudoinverse, the usual controller.
The reference pose is the default configuration of a robot, from its SRDF or else mid-range.

``ClosedPath`` is a closed path as a function of s, which goes from 0 to 1 in a cycle. ``PathStart``
is a start configuration that the search found, and the path that begins there.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from ..base.arguments import (
    Array,
    freeze,
    function,
    positive,
    read_only,
    require_choice,
    require_type,
    row,
)
from ..base.errors import InputError
from ..model.robot import Robot
from ..model.task import Task
from ..motion import Motion, fitting_circle, followed
from ..paths import ClosedPath, TaskPath, closed_path
from ..paths.shapes import PLANES
from ..regions import Box, Region, Tube
from ..strategies import Pseudoinverse
from .choose_start import GIVEN, PathOf, PathStart, starts
from .task_choice import choose_task

if TYPE_CHECKING:
    from ..paths.several_paths import PathOfFrame

_RegionOf = Callable[[Task, Array], Region]

SAVED = "saved in the design"

_A_PATH = "a closed path, such as rp.circle(task, q0), or a function (task, q0) → path"
_A_REGION = "a half-width, rad, or a region of joint space, such as rp.Box(q0, 0.3)"


@dataclass(frozen=True, eq=False, init=False, repr=False)
@read_only
class Problem:
    """Task, start, closed path and region Ω: the input of a study, a design or a motion.

    The region Ω is the part of joint space for which a controller is designed.

    Given parts are checked. Missing parts are chosen: the end of the arm, the first redundant kind
    of task, a start from which J⁺ can follow the path, and a circle as the path.

    Parameters
    ----------
    robot : str, Robot or Task
        Catalogue name, path to a URDF, or a loaded robot; or a task, which has a frame and a kind.
    frame, kind : str, optional
        Frame to move, the name of a link, and kind of task; by default the end of the arm, and the
        first of pose, position, xy, xz, yz that is redundant. For several frames, ``frame`` is a
        list of names, or of tuples (name, kind) or (name, kind, base), where base is the link
        relative to which the frame is placed; the default kind is then pose.
    start : (n,) array or str, optional
        Start configuration q0, rad (m for prismatic joints), or the name of a pose of the robot; by
        default the first of the reference pose, the ready pose, mid-range and poses around it, far
        from singularities, from which the path can be followed.
    path : optional
        Closed path, its name on the command line (``"circle:0.1"``, ``"loop.csv"``), or a function
        ``(task, q0) → path``; by default a circle that fits. For several frames, a list with one
        path per frame, and None for a frame that stands still; by default only the first frame
        moves. False for a problem without a path.
    plane : str, optional
        Plane of the circle, or of a path given by name: ``xy``, ``yz`` or ``xz``.
    region : float, Region or function, optional
        Region Ω: half-width of a box around the start, rad (and m), a region, or a function
        ``(task, q0) → region``; by default a tube around the motion.

    Attributes
    ----------
    task : Task
        Redundant task of the robot at the frame.
    start : (n,) array
        Start configuration q0, rad (m for prismatic joints), where the path begins.
    start_is : str
        Description of the start: ``as given``, ``the reference pose``.
    path : TaskPath or None
        Closed path; None for a problem without a path.
    period : float or None
        Period saved with a design, s; None if the path's own period is used.
    given : frozenset of str
        Names of the parts that were given.
    moved : tuple of str
        Notes on differences from the given parts, such as a start that was moved.
    warnings : tuple of str
        Warnings of the loaded robot.

    Raises
    ------
    InputError
        If a given part cannot be used, or the path cannot be followed from the start.
    SingularityError
        If the start is singular.

    Examples
    --------
    >>> problem = rp.Problem("ppr", region=0.2)
    >>> problem.task.kind, problem.start_is
    ('xy', 'the reference pose')
    >>> plain = rp.Pseudoinverse(problem.task)
    >>> motion = rp.follow(plain, problem.path, problem.start, steps=50)
    >>> bool(motion.drift[-1] > 1e-3)  # rad or m
    True
    """

    task: Task
    start: Array
    start_is: str
    path: TaskPath | None
    period: float | None
    given: frozenset[str]
    moved: tuple[str, ...]
    warnings: tuple[str, ...]
    _asked: float | Region | _RegionOf | None  # the region as it was given
    _draw: PathOf | None
    _violates: bool

    def __init__(
        self,
        robot: str | Robot | Task,
        *,
        frame: str | Sequence[str | tuple[str, ...]] | None = None,
        kind: str | None = None,
        start: ArrayLike | str | None = None,
        path: str
        | ClosedPath
        | PathOf
        | Sequence[str | PathOfFrame]
        | Literal[False]
        | None = None,
        plane: str | None = None,
        region: float | Region | _RegionOf | None = None,
    ) -> None:
        draw = _checked_path(path, plane)
        asked = _checked_region(region)
        loaded = robot if isinstance(robot, (Robot, Task)) else Robot.load(robot)
        task = _task_of(loaded, frame, kind)
        parts = {"kind": kind, "start": start, "path": path, "region": region}
        given = frozenset(name for name, value in parts.items() if value is not None)
        warnings: tuple[str, ...] = ()
        if isinstance(loaded, Robot):
            warnings = (*loaded.warnings, *task.narrowed)
        freeze(self, task=task, given=given, period=None, warnings=warnings)
        freeze(self, _draw=draw, _asked=asked)
        self._begin(next(starts(task, start, draw, any_path=path is None)))
        if asked is not None:
            _check_size(self.region, task)

    @cached_property
    def region(self) -> Region:
        """Region Ω: as given, or a tube around one cycle of J⁺, computed when first used.

        Ω is the part of joint space for which a controller is designed; the tube holds all
        configurations near the motion. For a problem made from the design of a cell's function, the
        region is the cell, a box of poses.
        """
        asked = self._asked
        if isinstance(asked, float):
            return Box(self.start, asked)
        if callable(asked):
            made = asked(self.task, self.start)
            return require_type(made, Region, "the result of region", "a region of joint space")
        if asked is not None:
            return asked
        return tube_around(followed(Pseudoinverse(self.task), self.cycle, self.start, cycles=1))

    @property
    def cycle(self) -> TaskPath:
        """The closed path of a problem that has one.

        Raises
        ------
        InputError
            If the problem has no path.
        """
        if self.path is None:
            raise InputError("this problem has no path", remedy="make it without path=False")
        return self.path

    @property
    def notes(self) -> list[str]:
        """Notes on a start that was chosen, and on differences from what was given.

        Commands print them, so that the user knows where a motion begins.
        """
        if self.start_is == GIVEN:
            return list(self.moved)
        if self.start_is == SAVED:
            return ["start configuration taken from the design", *self.moved]
        return [f"the start is {self.start_is}", *self.moved]

    def alternatives(self) -> Iterator[Problem]:
        """Generate this problem, then copies with the other default starts, the best first.

        A problem with a given start has no copies.
        """
        yield self
        if "start" in self.given:
            return
        any_path = "path" not in self.given
        others = starts(self.task, None, self._draw, any_path=any_path)
        for start in islice(others, 1, None):
            other = self._with(start=start.q0)
            other._begin(start)
            yield other

    def __repr__(self) -> str:
        task = self.task
        path = "no path" if self.path is None else self.path.name
        begin = row(self.start) if self.start_is == GIVEN else self.start_is
        region = "" if self._asked is None else f", Ω {self.region}"
        return (
            f"<Problem of {task.robot.name} {task.frame}, {task.kind}: {path} from {begin}{region}>"
        )

    def _begin(self, start: PathStart) -> None:
        """Set the start, its description, the path from there, and a note if the start was moved.

        The search moves a start if the user's path begins at another pose.
        """
        moved = ("the start was moved to the first point of the path",) if start.moved else ()
        freeze(self, start=start.q0, start_is=start.name, path=start.path, moved=moved)
        freeze(self, _violates=start.violates)

    def _with(self, **changes: Any) -> Problem:
        """Copy the problem with other values of attributes, given by name.

        If ``start`` is one of them, the copy computes its own region Ω.
        """
        other = copy.copy(self)
        if "start" in changes:
            vars(other).pop("region", None)
        freeze(other, **changes)
        return other


def tube_around(motion: Motion, width: float | None = None) -> Tube:
    """Create the tube around a motion's first cycle, the default region Ω of a design.

    A configuration q is in the tube if some configuration of that cycle differs from q by at most
    ``width`` in each joint, rad or m; by default 0.1 rad or 0.05 m.
    """
    radius = np.where(motion.task.revolute, 0.1, 0.05) if width is None else width
    return Tube(motion.cycle(0), radius)


def at_minimum_speed(problem: Problem) -> Problem:
    """Copy a problem, with the start moved along its self-motion to minimum joint speed.

    In a self-motion the joints move and the frame does not, so the path does not change. Each start
    is rated by the closed motion of minimum joint speed (rms over a cycle) that begins there and
    follows the path. A start is excluded if bodies collide in this motion, or if its joint-limit
    margin is less than half of the largest one found. A note of the copy says by how much the joint
    speed falls. If no other start needs less joint speed, the start is kept, and the note says so.

    Raises
    ------
    InputError, SingularityError
        If there is no closed motion from the problem's start.
    """
    from ..motion.least_start import least_start  # only on request

    task = problem.task
    path = problem.cycle
    q0 = problem.start
    found = least_start(task, path, q0)
    saved = 1 - found.best.rms_speed / found.given.rms_speed
    note = "no other start tried needs less joint speed"
    if saved > 0:
        note = f"the start was moved along the self-motion, to {100 * saved:.0f} % less joint speed"
    return problem._with(
        start=found.best.q[0], given=problem.given | {"start"}, moved=(*problem.moved, note)
    )


def _task_of(robot: Robot | Task, frame: Any, kind: str | None) -> Task:
    """Choose the task of a robot; the frame and the kind are optional (see :func:`choose_task`).

    A given task is returned as it is. A task has its own frame and kind, so InputError is raised if
    ``frame`` or ``kind`` is given as well.
    """
    if isinstance(robot, Robot):
        return choose_task(robot, frame, kind)
    for name, value in (("frame", frame), ("kind", kind)):
        if value is not None:
            raise InputError("is part of the task already", argument=name, remedy=f"omit {name}=")
    return robot


def _checked_path(path: Any, plane: str | None) -> PathOf | None:
    """Create the function (task, q0) → path from the argument ``path`` of a problem.

    ``path`` is a name (``circle:0.1``, ``loop.csv``), a path, a function (task, q0) → path, a list
    with one of these per frame, None for a circle that fits, or False. For False, None is returned:
    the problem has no path. Only a name or None takes a plane; else InputError is raised.
    """
    if plane is not None:
        require_choice(plane, PLANES, "plane")
        if not (path is None or isinstance(path, str)):
            raise InputError(
                ": only the default circle and a path given by name take a plane",
                argument="plane",
                remedy="omit plane=",
            )
    if path is False:
        return None
    if path is None:
        return lambda task, q0: fitting_circle(task, q0, plane=plane)
    if isinstance(path, (list, tuple)):
        from ..paths.several_paths import several_paths

        own = [_checked_path(each, None) if isinstance(each, str) else each for each in path]
        return lambda task, q0: several_paths(task, q0, own)
    if isinstance(path, str):
        from ..motion.parse_path import parse_path  # with the readers of files

        return parse_path(path, plane)
    if isinstance(path, ClosedPath):
        given = closed_path(path)
        return lambda task, q0: given
    return function(path, "path", _A_PATH, 2)


def _checked_region(region: Any) -> float | Region | _RegionOf | None:
    """Check the argument ``region`` of a problem: a number, a region, a function, or None.

    A number is the half-width of a box, rad (and m); a function is (task, q0) → region. None stands
    for the default, a tube around the motion. All are returned unchanged, because a region can be
    made only when the start is known. InputError is raised for any other value.
    """
    if region is None or isinstance(region, Region):
        return region
    if callable(region):
        return function(region, "region", "a function (task, q0) → region", 2)
    if isinstance(region, (int, float)):
        return positive(region, "region", "rad")
    return require_type(region, Region, "region", _A_REGION)


def _check_size(region: Region, task: Task) -> None:
    """Raise InputError if a region has another number of joints than the task.

    This is checked when the problem is made, so that a design does not fail later in its arrays.
    """
    n = len(region.center)
    if n != task.n:
        raise InputError(
            f"has {n} joints, but {task.frame!r} is moved by {task.n}",
            argument="region",
            remedy="make it around a configuration of this task",
        )
