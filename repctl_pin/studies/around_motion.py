"""Design of a repeatable inverse for a problem: in its region, or around its motion.

A problem is an arm, its task, a start and a closed path. The region Ω is the part of joint space
for which a design is made. If none is given, Ω is a tube: all configurations within a radius of the
motion. Nodes are the configurations at which a design is fitted. G_d is the desired inverse,
usually the pseudoinverse J⁺, which the design approximates. A function ``say`` receives the name of
each step when it begins.

``Cycle`` is one cycle of a motion that ends in its start: start configuration, path and period, s.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import islice
from typing import Any

import numpy as np

from ..base.arguments import Array, percentage
from ..base.defaults import PERIOD
from ..base.errors import SingularityError
from ..base.fit_options import FitOptions
from ..design import Design, SingularRegionError, nearest_repeatable
from ..model.task import Task
from ..motion import Motion, followed
from ..paths import TaskPath
from ..paths.task_path import Cycle
from ..regions import Region, Tube
from ..strategies import Inverse
from .choose_start import plain_cycle, violations
from .period import choose_period
from .problem import Problem, tube_around
from .quantities import LABELS

_Make = Callable[[Region], Design]
_Say = Callable[[str], None]

_MOST_STARTS = 5
"""Maximum number of starts for which a design is made."""

_HIGH_SPEED = 0.05
"""Extra joint speed in cycle 1, relative to J⁺, above which another start is tried."""

NO_BETTER = "no default start keeps the joints within limits and the bodies apart on this path"


def design_for(
    problem: Problem,
    desired: Inverse,
    make: _Make,
    *,
    width: float | None = None,
    seed: int = 0,
    say: _Say = lambda text: None,
) -> tuple[Problem, Design]:
    """Design a repeatable inverse in the given region, or around the motion from the best start.

    Up to five default starts are tried, until the repeatable motion keeps the joint limits, no
    bodies collide, and its joint speed exceeds that of J⁺ by at most 5 %. If there is no such
    start, the one with the fewest kinds of violation is used, and among equals, the one with the
    lowest joint speed relative to J⁺. If its motion violates a limit or bodies collide, a note is
    added to the problem. A given region or start is not replaced.

    Parameters
    ----------
    problem
        The problem; another default start may be chosen.
    desired
        Desired inverse G_d, which the design approximates.
    make
        Function (region) → design, called for each region Ω that is tried.
    width
        Radius of the tube around the motion; by default 0.1 rad or 0.05 m.
    seed
        Random seed of the nodes.
    say
        Function of a text, the name of a step, which is called when the step begins.

    Returns
    -------
    problem : Problem
        The problem with the start that was used.
    design : Design

    Raises
    ------
    SingularityError
        If the design fails for every start tried; the message is that of the first failure.
    """
    if problem.path is None or "region" in problem.given:
        return problem, _in_region(problem, make)
    failure: SingularityError | None = None
    best: tuple[tuple[int, float], Problem, Design] | None = None
    for tried in islice(problem.alternatives(), _MOST_STARTS):
        if tried._violates and best is not None:
            break
        try:
            design = _around_motion(tried, desired, make, width, seed, say)
            merit = _merit(tried, design)
        except SingularityError as error:
            failure = failure or error
            continue
        if best is None or merit < best[0]:
            best = merit, tried, design
        if "start" in tried.given or tried._violates or merit == (0, 0.0):
            break
    if best is not None:
        (violated, _), chosen, design = best
        if violated and "start" not in chosen.given:
            chosen = chosen._with(moved=(*chosen.moved, NO_BETTER))
        return chosen, design
    assert failure is not None
    if isinstance(failure, SingularRegionError):
        other = "the design fails at every start tried; give another start"
        if "start" in problem.given:
            other = "choose another start"
        failure.remedy = f"{other}, or a smaller path"
    raise failure


def timed_cycle(
    design: Design, problem: Problem, *, period: float | None = None
) -> tuple[Cycle, list[str]]:
    """Choose the period of a design's cycle, so that no joint exceeds its speed limit.

    Returns the cycle (start, path and period), and a list of notes. A given period, s, is not
    changed. Otherwise the period is that of the path, else 5 s, and is increased if necessary,
    which a note says.
    """
    path = problem.cycle
    time = period or path.period or PERIOD
    notes: list[str] = []
    if period is None:
        motion = _own_cycle(design, path, problem.start, steps=200, period=time)
        time, notes = choose_period(time, {LABELS["repeatable"]: motion})
    return Cycle(problem.start, path, time), notes


def shrunk_note(design: Design) -> tuple[str, ...]:
    """Make a note on how far Ω, the region of a design, was shrunk to avoid singularities.

    The result is a tuple of one text; it is empty if Ω was not shrunk.
    """
    share = f"Ω was shrunk to {percentage(design.shrunk)} of its half-width"
    return (f"{share} to keep clear of singularities",) if design.shrunk < 1 else ()


def half_width_within(region: Region) -> str:
    """Format the smallest half-width of the box around a region, rad or m, to two digits.

    The number is rounded down. An error message suggests it as the argument ``region`` of a
    problem, the half-width of a box, if the design failed at a singularity in a larger region.
    """
    width = float(region.bounds.half_width.min())
    digit = 10.0 ** (np.floor(np.log10(width)) - 1)
    return f"{np.floor(width / digit) * digit:.2g}"


def own_failure(task: Task, path: TaskPath, q0: Array) -> SingularityError | None:
    """Create the error of a design that cannot follow the cycle for which it was made.

    The message names the design as the cause. If J⁺ cannot follow the path from q0 (n,) either, the
    path is the cause, and the result is None.
    """
    if plain_cycle(task, path, q0) is None:
        return None
    return SingularityError(
        "the design fails on the cycle it was made for, which J⁺ can follow",
        remedy="choose another start, a smaller path or another degree",
    )


def _in_region(problem: Problem, make: _Make) -> Design:
    """Design in the region Ω of a problem by ``make``, a function region → design.

    If Ω contains a singularity, the remedy of the SingularRegionError suggests a smaller region
    without singularities, as a half-width if the user gave one. If no smaller region is free of
    singularities, it suggests another start.
    """
    region = problem.region
    try:
        return make(region)
    except SingularRegionError as error:
        if error.free is None:
            error.remedy = "choose another start"
        elif isinstance(problem._asked, float):
            error.remedy = f"pass region={half_width_within(error.free)}"
        else:
            error.remedy = "pass that region, which is the attribute free of this error"
        raise


def _merit(problem: Problem, design: Design) -> tuple[int, float]:
    """Rate a design by its motion, as a sort key for choosing the start; the smallest is best.

    The key is a tuple: the number of kinds of violation (joint limits, collisions), 0 to 2, and the
    extra joint speed in cycle 1 relative to J⁺, a fraction, where up to 0.05 counts as 0.
    """
    path, q0 = problem.cycle, problem.start
    motion = _own_cycle(design, path, q0, steps=96)
    plain = plain_cycle(design.task, path, q0)
    extra = 0.0 if plain is None else motion.first_rms_speed / plain.first_rms_speed - 1
    return violations(motion), extra if extra > _HIGH_SPEED else 0.0


def _around_motion(
    problem: Problem, desired: Inverse, make: _Make, width: float | None, seed: int, say: _Say
) -> Design:
    """Design in a tube around the motion: all configurations within ``width`` of the motion.

    The motion of a design depends on its tube, and the tube on the motion. The first tube is
    therefore around the motion of a design of degree 1. If the motion of the new design leaves its
    tube, the design is repeated in a tube around that motion, at most twice. It is not repeated if
    the tube had to be shrunk because of a singularity. ``width``, rad or m, is the largest
    difference of a joint; None for 0.1 rad or 0.05 m. ``make`` designs in a given region, ``seed``
    is that of the nodes, and ``say`` is called with the name of each step.
    """
    path, q0 = problem.cycle, problem.start
    say("finding where the motion will be")
    tube = _tube_of_linear(desired, path, q0, width, seed)
    say("designing")
    design = make(tube)
    for _ in range(2):
        motion = _own_cycle(design, path, q0)
        if design.shrunk < 1 or not (design.region.ratio(motion.q) > 1).any():
            break
        say("designing again, around the motion that resulted")
        design = make(tube_around(motion, width))
    return design


def _tube_of_linear(
    desired: Inverse, path: TaskPath, q0: Array, width: float | None, seed: int
) -> Tube:
    """Create the tube around the motion of a design of degree 1, whose fit has 4096 nodes.

    This motion is closed, and so nearer to that of the final design than the motion of G_d, which
    drifts. If the design of degree 1 cannot follow the path, the tube is around one cycle of G_d.
    ``width`` is the radius of the tube, rad or m; None for 0.1 rad (revolute joints) and 0.05 m
    (prismatic ones). The path begins at q0 (n,), and ``seed`` is the random seed of the nodes.

    Raises
    ------
    SingularityError
        If the desired inverse cannot follow the path once.
    """
    tube = tube_around(followed(desired, path, q0, cycles=1), width)
    few = FitOptions(samples=4096, held_out=1024, seed=seed)
    linear = nearest_repeatable(desired, None, tube, degree=1, shrink=True, options=few)
    try:
        return tube_around(followed(linear.inverse, path, q0, cycles=1), width)
    except SingularityError:
        return tube


def _own_cycle(design: Design, path: TaskPath, q0: Array, **options: Any) -> Motion:
    """Follow a path with a design for one cycle, from q0 (n,), with ``options`` of ``follow``.

    Raises
    ------
    SingularityError
        If the design cannot follow the path; if J⁺ can, the message names the design as the cause.
    """
    try:
        return followed(design.inverse, path, q0, cycles=1, **options)
    except SingularityError as error:
        raise own_failure(design.task, path, q0) or error from error
