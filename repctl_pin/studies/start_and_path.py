"""Where a motion begins and what it follows: the same for every command that leads an arm round a
path."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from itertools import islice
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..arguments import Array, function
from ..design import Design, SingularRegionError
from ..errors import RepctlError, SingularityError
from ..inverse_function import CellDesign
from ..motion import ClosedPath, Motion, TaskPath, check_reach, closed_path, follow, reach_start
from ..motion.fitting_circle import dexterity_at, fitting_circle
from ..motion.joint_motion import violations_of
from ..paths.task_path import Cycle
from ..regions import Region
from ..robot.task import Task
from ..strategies import Bounded, Inverse, Pseudoinverse
from ..strategies.names import LABELS
from . import defaults

Say = Callable[[str], None]

GIVEN = "as given"

MOST_STARTS = 5
"""Starts for which a design is made, at most."""

DEAR = 0.05
"""Extra joint speed in cycle 1, relative to J⁺, above which another start is tried."""

NO_BETTER = "none of the default starts keeps the joint limits and the bodies apart on this path"

_SINGULAR = 1e-3
_FAR = 1.0  # rad
_LOOKS = 12
"""Points of a cycle at which bodies are looked at before a start is taken."""


class Setting(NamedTuple):
    """Where a motion begins, what it follows, and Ω: as far as each is known."""

    q0: Array
    where: str  # what the start is
    path: TaskPath | None = None
    region: Bounded | None = None
    moved: tuple[str, ...] = ()  # notes, where it is not quite what was asked for
    period: float | None = None
    violates: bool = False  # whether J⁺ violates a limit in the first cycle, or bodies collide

    @property
    def drawn(self) -> TaskPath:
        """The path, where there is one."""
        assert self.path is not None
        return self.path

    @property
    def notes(self) -> list[str]:
        """What a person should know of it."""
        return [*([] if self.where == GIVEN else [f"the start is {self.where}"]), *self.moved]


def settings(
    task: Task, start: ArrayLike | None, path: ClosedPath | Callable[[Task, Array], TaskPath]
) -> Iterator[Setting]:
    """Offer starts from which a path can be followed, the best first.

    Parameters
    ----------
    task
        What to move.
    start : (n,) array, optional
        q0; by default those of :func:`starts` that will do.
    path
        A closed path, or a function ``(task, q0) → path``. Where it begins elsewhere, the start is
        moved there.

    Raises
    ------
    InputError
        If the path cannot be followed from there; without a start, what the best one was refused
        for.
    SingularityError
        If the start is singular.
    """
    if isinstance(path, ClosedPath):
        given = closed_path(path)
        path = lambda task, q0: given  # noqa: E731
    function(
        path,
        "path",
        "a closed path, such as rp.circle(task, q0), or a function (task, q0) → path",
        2,
    )
    failure: RepctlError | None = None
    found = fixed = False
    violating: list[Setting] = []
    wild: list[Setting] = []
    for q0, where in (
        defaults.starts(task) if start is None else [(task.check(start, "start"), GIVEN)]
    ):
        if fixed and where in defaults.SEARCHED:
            break  # a path that does not begin at the start is where its author says
        try:
            if dexterity_at(task, q0) < _SINGULAR:
                remedy = (
                    "choose another start"
                    if start is not None
                    else "no start was found that is not; give one"
                )
                raise SingularityError(
                    f"the start is at a singularity of {task.frame!r}, {task.kind}; {remedy}"
                )
            drawn = closed_path(path(task, q0))
            fixed = float(np.linalg.norm(task.error(q0, drawn.placement(0.0)))) > 1e-6
            begin = reach_start(task, q0, drawn)
            check_reach(task, begin, drawn)
        except RepctlError as error:
            failure = failure or error  # of the best start
            continue
        found = True
        there = np.array_equal(begin, q0)
        moved = () if there else ("the start was moved to the path's first point",)
        setting = Setting(begin, where, drawn, moved=moved)
        once = _once(task, setting) if start is None else None
        if start is not None:
            yield setting
        elif once is None or once.drift[0] > _FAR:
            wild.append(setting)
        elif violations_of(once, once.thinned(_LOOKS)):
            violating.append(setting._replace(violates=True))
        else:
            yield setting
    yield from violating
    yield from wild
    if not found:
        assert failure is not None  # there is always a start to try
        raise failure


def _once(task: Task, setting: Setting) -> Motion | None:
    """Follow one cycle with J⁺; None where it cannot."""
    try:
        return follow(Pseudoinverse(task), setting.drawn, setting.q0, cycles=1, steps=96)
    except SingularityError:
        return None


def choose_setting(
    task: Task, start: ArrayLike | None, path: ClosedPath | Callable[[Task, Array], TaskPath]
) -> Setting:
    """Take the start, or the first good one from which the path can be followed, see
    :func:`settings`."""
    return next(settings(task, start, path))


def setting_of(
    design: Design | CellDesign,
    start: ArrayLike | None = None,
    path: Callable[[Task, Array], TaskPath] | None = None,
) -> Setting:
    """Take the cycle that a design is for; where another start or path is asked for, that.

    A design that is for no cycle gets the largest circle inside Ω; the function of a cell is for
    none, and its Ω is what brings the frame into the cell.

    Raises
    ------
    InputError
        If no circle lies inside Ω, or the path cannot be followed from the start.
    """
    if isinstance(design, CellDesign):
        q0 = design.posture if start is None else start
        round_it = path or partial(fitting_circle, control=design.inverse, region=design.cell)
        setting = choose_setting(design.task, q0, round_it)._replace(region=design.cell)
        if start is not None:
            return setting
        begin = design.function(setting.drawn.placement(0.0))
        return setting._replace(
            q0=begin, where="the function's joints where the path begins", moved=()
        )
    cycle, task = design.cycle, design.task
    if cycle is not None and start is None and path is None:
        return Setting(cycle.start, "the design's own", cycle.path, design.region, (), cycle.period)
    if start is None:
        start = design.region.center if cycle is None else cycle.start
    if (
        path is None
        and cycle is not None
        and np.abs(task.error(start, cycle.path.placement(0.0))).max() < 1e-6
    ):
        return choose_setting(task, start, cycle.path)._replace(
            region=design.region
        )  # the same hand, another elbow
    if path is None:
        path = partial(fitting_circle, control=design.inverse, region=design.region)
    return choose_setting(task, start, path)._replace(region=design.region)


def _design_along(
    desired: Inverse,
    setting: Setting,
    make: Callable[[Region], Design],
    width: float | None,
    seed: int,
    say: Say,
) -> Design:
    """Design in a tube round the motion that comes of it, so that the motion lies inside Ω."""
    path = setting.drawn
    say("finding where the motion will be")
    region = defaults.round_the_motion(desired, path, setting.q0, width=width, seed=seed)
    say("designing")
    design = make(region)
    for _ in range(2):
        motion = follow_own(design, path, setting.q0)
        if design.shrunk < 1 or not (design.region.ratio(motion.q) > 1).any():
            break
        say("designing again, round the motion that came of it")
        design = make(defaults.choose_region(desired.task, motion, width))
    return design


def follow_own(design: Design, path: TaskPath, q0: Array, **options: Any) -> Motion:
    """Follow one cycle under a design that was made for it.

    Raises
    ------
    SingularityError
        If it fails; where J⁺ follows the same path, the message says that the design fails, not the
        path.
    """
    try:
        return follow(design.inverse, path, q0, cycles=1, **options)
    except SingularityError as error:
        raise SingularityError(whose_fault(error, design.task, path, q0)) from None


def whose_fault(error: object, task: Task, path: TaskPath, q0: Array) -> str:
    """Say why a design stopped on its own cycle: the design fails, if J⁺ follows the path there."""
    if _once(task, Setting(q0, "", path)) is None:
        return str(error)
    what = str(error).partition(":")[0]
    return (
        f"{what}: the design fails on its own cycle, which J⁺ can follow; "
        "choose another start, a smaller path or another degree"
    )


def shrunk_note(design: Design) -> tuple[str, ...]:
    """Say by how much Ω was shrunk, if it was."""
    what = f"Ω was shrunk to {design.shrunk:.0%} of its half-width to keep clear of singularities"
    return (what,) if design.shrunk < 1 else ()


def with_cycle(
    design: Design, setting: Setting, *, period: float | None = None
) -> tuple[Design, list[str]]:
    """Give a design the cycle it is for, in a time that keeps the speed limits where none is asked
    for; and notes."""
    path = setting.drawn
    time = period or path.period or defaults.PERIOD
    notes: list[str] = []
    if period is None:
        motion = follow_own(design, path, setting.q0, steps=200, period=time)
        time, notes = defaults.choose_period(time, {LABELS["repeatable"]: motion})
    return replace(design, cycle=Cycle(setting.q0, path, time)), notes


def design_from(
    desired: Inverse,
    start: ArrayLike | None,
    path: ClosedPath | Callable[[Task, Array], TaskPath],
    make: Callable[[Region], Design],
    *,
    width: float | None = None,
    seed: int = 0,
    say: Say = lambda text: None,
) -> tuple[Setting, Design]:
    """Design for the first start that will do: if a default start does not, try the next.

    It will do if the repeatable motion keeps the joint limits, no bodies collide, and it costs
    little joint speed. If none does, the one with the fewest kinds of violation is taken, of those
    the cheapest, and a note says so.

    Parameters
    ----------
    desired
        What to be near to.
    start, path
        As :func:`settings` takes them.
    make
        Designs in a region: a tube round the motion that comes of it.
    width
        Half-width of the tube; by default 0.1 rad or 0.05 m.
    seed
        Of the nodes.
    say
        Called with a word on what is being done.

    Raises
    ------
    SingularityError
        What the first start was refused for.
    """
    failure: SingularityError | None = None
    best: tuple[tuple[float, float], Setting, Design] | None = None
    for setting in islice(settings(desired.task, start, path), MOST_STARTS):
        if setting.violates and best is not None:
            break
        try:
            design = _design_along(desired, setting, make, width, seed, say)
            merit = _merit(design, setting)
        except SingularityError as error:
            failure = failure or error
            continue
        if best is None or merit < best[0]:
            best = merit, setting, design
        if start is not None or setting.violates or merit <= (0, DEAR):
            break
    if best is not None:
        (violated, _), setting, design = best
        if violated and start is None:
            setting = setting._replace(moved=(*setting.moved, NO_BETTER))
        return setting, design
    assert failure is not None
    if isinstance(failure, SingularRegionError):
        other = (
            f"none of {MOST_STARTS} starts does better; give one"
            if start is None
            else "choose another start"
        )
        raise failure.with_remedy(f"{other}, or a smaller path") from None
    raise failure


def _merit(design: Design, setting: Setting) -> tuple[float, float]:
    """Count the kinds of violation of a design's first cycle, and measure its joint speed relative
    to J⁺'s."""
    motion = follow_own(design, setting.drawn, setting.q0, steps=96)
    plain = _once(design.task, setting)
    dear = 0.0 if plain is None else motion.first_rms_speed / plain.first_rms_speed - 1
    return len(violations_of(motion, motion.thinned(_LOOKS))), dear if dear > DEAR else 0.0
