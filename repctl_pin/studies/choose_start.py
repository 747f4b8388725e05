"""Search for a start from which a closed path can be followed: the default starts, best first.

A start is the configuration q0 where a path begins. The default starts are the named poses of the
robot (reference, ready, mid-range), then poses found by a search. The reference pose is the default
configuration of a robot, from its SRDF or else mid-range, the middle of the joint ranges; the ready
pose is a working pose of the catalogue. A dexterous configuration is far from a singularity. The
measure of this distance, ``dexterity_at``, is the ratio of the smallest to the largest singular
value of J, with lengths divided by that of the arm. J⁺ is the pseudoinverse, the usual controller.

``PathStart`` is a start configuration that the search found, and the path that begins there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..base.arguments import Array
from ..base.errors import InputError, RepctlError, SingularityError, unknown
from ..model.bodies import bodies_of
from ..model.task import Task
from ..motion import Motion, check_reach, followed, is_reached, reach_start
from ..motion.body_displacement import farthest_link
from ..motion.fitting_circle import dexterity_at, fitting_circle
from ..motion.joint_motion import violations_of
from ..paths import ClosedPath, TaskPath, closed_path
from ..regions.region import sobol
from ..strategies import Pseudoinverse

PathOf = Callable[[Task, Array], ClosedPath]

GIVEN = "as given"

SAME = 1e-6
"""Task error, m and rad, up to which two placements count as equal."""

_SINGULAR = 1e-3
_FAR = 1.0  # rad
_FAINT = 1e-3
"""Displacement of every part in one cycle of J⁺, m, below which ten cycles show no drift."""

_POSES = {
    "reference": "the reference pose",
    "ready": "the ready pose",
    "middle": "mid-range of the joints",
}
"""Named poses of a robot, in the order in which they are tried."""

_SEARCHED = ("a dexterous pose near mid-range", "another dexterous pose")
"""Descriptions of the starts that are searched for, after the named poses."""

_LEAST_DEXTERITY = {6: 0.05, 5: 0.05, 2: 0.1}
_LEAST_DEXTERITY_OF_POSITION = 0.2
_LEAST_MARGIN = 0.15
_DRAWN = 512
"""Number of configurations from which starts are selected."""

_MOST_STARTS, _APART = 8, 0.5


class PathStart(NamedTuple):
    """Start configuration that the search found, and the path that begins there.

    Attributes
    ----------
    q0 : (n,) array
        Start configuration, rad or m.
    name : str
        Description: ``as given``, ``the reference pose``.
    path : TaskPath or None
        The closed path, which begins at q0.
    moved : bool
        True if q0 was moved to the first point of the path.
    violates : bool
        True for a default start from which J⁺ violates a limit, or bodies collide, in the first
        cycle. Always False for a given start, or if J⁺ drifts by more than 1 rad or m.
    cycle : Motion or None
        The first cycle of J⁺ from q0; None if it fails at a singularity, or without a path.
    """

    q0: Array
    name: str
    path: TaskPath | None = None
    moved: bool = False
    violates: bool = False
    cycle: Motion | None = None


def starts(
    task: Task, start: ArrayLike | str | None, draw: PathOf | None, *, any_path: bool = False
) -> Iterator[PathStart]:
    """Generate the usable starts, the best first, for a caller that takes the first that works.

    Parameters
    ----------
    task
        Task to carry out.
    start : (n,) array or str, optional
        The only start to try, a configuration or the name of a pose of the robot; by default, the
        default starts are tried.
    draw
        Function (task, q0) → closed path; None for a problem without a path.
    any_path
        True if the user gave no path; starts from which J⁺ drifts visibly then come first.

    Raises
    ------
    InputError, SingularityError
        If no start is usable; the message is the reason for the first start.
    """
    if start is not None:
        q0, name = _named(task, start)
        if draw is None:
            yield PathStart(q0, name)
        else:
            yield from _reachable(task, [(q0, name)], draw, "choose another start")
        return
    offers = default_starts(task)
    if draw is None:
        yield from _with_a_circle(task, offers)
    else:
        remedy = "every default start is singular; give a start"
        found = _reachable(task, offers, draw, remedy)
        yield from _best_first(task, found, _FAINT if any_path else 0.0)


def default_starts(task: Task) -> Iterator[tuple[Array, str]]:
    """Generate starts: the reference pose, the ready pose, mid-range, and poses around mid-range.

    Named poses (the first three) that are nearly singular, or less than 0.15 rad or m from a joint
    limit, are left out.

    Yields
    ------
    q0 : (n,) array
        Configuration, rad (m for prismatic joints).
    name : str
        Description of the start.
    """
    least = _LEAST_DEXTERITY.get(task.m, _LEAST_DEXTERITY_OF_POSITION)
    for pose, name in _POSES.items():
        if pose not in task.robot.poses:
            continue
        q = task.from_robot(task.robot.poses[pose])
        margin = task.limit_margin(q).min()
        if dexterity_at(task, q) >= least and margin >= _LEAST_MARGIN:
            yield q, name
    for k, q in enumerate(_dexterous(task)):
        yield np.round(q, 3), _SEARCHED[min(k, 1)]


def _dexterous(task: Task) -> Iterator[Array]:
    """Generate up to 8 configurations (n,) far from singularities, the nearest to mid-range first.

    They are selected from quasi-random points within 2 rad or m of mid-range. Each has at least
    half of the best dexterity found, and any two differ by more than 0.5 rad or m in some joint.
    """
    middle = task.from_robot(task.robot.poses["middle"])
    low, high = _inner_limits(task)
    low = np.maximum(middle - 2.0, low)
    high = np.minimum(middle + 2.0, high)
    points = low + (high - low) * sobol(task.n, _DRAWN, 0)
    scores = np.array([dexterity_at(task, q) for q in points])
    good = points[scores >= 0.5 * scores.max()]
    good = good[np.argsort(np.linalg.norm(good - middle, axis=1))]
    for _ in range(_MOST_STARTS):
        yield good[0]
        good = good[np.abs(good - good[0]).max(axis=1) > _APART]
        if not len(good):
            return


def plain_cycle(task: Task, path: TaskPath, q0: Array) -> Motion | None:
    """Follow one cycle of a path with J⁺ from q0 (n,), in 96 steps; None at a singularity."""
    try:
        return followed(Pseudoinverse(task), path, q0, cycles=1, steps=96)
    except SingularityError:
        return None


def violations(motion: Motion) -> int:
    """Count the kinds of violation in a motion (joint limit, collision): 0, 1 or 2."""
    return len(violations_of(motion))


def _named(task: Task, start: ArrayLike | str) -> tuple[Array, str]:
    """Convert the argument ``start``: a configuration (n,), or the name of a pose of the robot.

    Returns the configuration of the task's joints, and its description, such as ``as given`` or
    ``the ready pose``. InputError is raised for another size or an unknown name.
    """
    if not isinstance(start, str):
        return task.check(start, "start"), GIVEN
    poses = task.robot.poses
    if start not in poses:
        raise unknown("pose", start, poses)
    name = _POSES.get(start, f"the pose {start!r}")
    return task.from_robot(poses[start]), name


def _with_a_circle(task: Task, offers: Iterable[tuple[Array, str]]) -> Iterator[PathStart]:
    """Generate the starts of a problem without a path, those with space for a circle first.

    A start has space for a circle if the arm can follow one from there, and no bodies collide at
    the start. Other starts follow in their given order. ``offers`` are pairs (configuration,
    description).
    """
    others: list[PathStart] = []
    for q0, name in offers:
        try:
            fitting_circle(task, q0)
            clear = bodies_of(task).distances(q0[None]).min() >= 0
        except InputError:
            clear = False
        if clear:
            yield PathStart(q0, name)
        else:
            others.append(PathStart(q0, name))
    yield from others


def _reachable(
    task: Task, offers: Iterable[tuple[Array, str]], draw: PathOf, remedy: str
) -> Iterator[PathStart]:
    """Generate the starts at which J is not singular, and from which the whole path is reached.

    ``offers`` are pairs (configuration, description), and ``draw`` is the function (task, q0) →
    path. If the path does not begin at the pose of a start, the start is moved to the path's first
    point. Such a path is taken to lie at a fixed place, whatever the start, so the starts found by
    a search are not tried. ``remedy`` is the remedy in the error of a singular start.

    Raises
    ------
    InputError, SingularityError
        If there is no such start; the message is the reason for the first start.
    """
    failure: RepctlError | None = None
    found = elsewhere = False
    for q0, name in offers:
        if elsewhere and name in _SEARCHED:
            break  # the path lies where its author put it, whatever the start
        try:
            _check_regular(task, q0, remedy)
            path = closed_path(draw(task, q0))
            gap = task.error(q0, path.placement(0.0))
            elsewhere = float(np.linalg.norm(gap)) > SAME
            begin = reach_start(task, q0, path)
            cycle = plain_cycle(task, path, begin)
            if cycle is None or not is_reached(task, path, cycle.q):
                check_reach(task, begin, path)
        except RepctlError as error:
            failure = failure or error
            continue
        found = True
        moved = not np.array_equal(begin, q0)
        yield PathStart(begin, name, path, moved=moved, cycle=cycle)
    if not found:
        assert failure is not None  # there is always a start to try
        raise failure


def _check_regular(task: Task, q0: Array, remedy: str) -> None:
    """Raise SingularityError, with the given remedy, if J is nearly singular at a start q0 (n,)."""
    if dexterity_at(task, q0) < _SINGULAR:
        raise SingularityError(
            f"the start is a singularity of the {task.kind} task of {task.frame!r}",
            remedy=remedy,
            at=q0,
        )


def _best_first(task: Task, found: Iterable[PathStart], least: float) -> Iterator[PathStart]:
    """Sort starts by the first cycle of J⁺ from each, the best first.

    First come starts without violations at which some part of the robot ends at least ``least``, m,
    from where it began. Starts at which no part ends so far away follow, then those with a violated
    limit or a collision. Last come those at which the cycle fails, or the drift, the norm over the
    joints, exceeds 1 rad or m.
    """
    faint: list[PathStart] = []
    violating: list[PathStart] = []
    wild: list[PathStart] = []
    for start in found:
        motion = start.cycle
        if motion is None or motion.drift[0] > _FAR:
            wild.append(start)
        elif violations(motion):
            violating.append(start._replace(violates=True))
        elif farthest_link(motion)[1] < least:
            faint.append(start)
        else:
            yield start
    yield from (*faint, *violating, *wild)


def _inner_limits(task: Task) -> tuple[Array, Array]:
    """Compute the lower and upper ends of the middle 80 % of the joint ranges: (n,) each, rad or m.

    Starts are searched between them. A missing limit is replaced by a value at least 3 rad or m
    beyond 0 and beyond the reference pose.
    """
    low = np.where(np.isfinite(task.lower), task.lower, np.minimum(-3.0, task.reference - 3.0))
    high = np.where(np.isfinite(task.upper), task.upper, np.maximum(3.0, task.reference + 3.0))
    return low + 0.1 * (high - low), high - 0.1 * (high - low)
