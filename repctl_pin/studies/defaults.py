"""Defaults where nothing is said: task kind, start, path, region."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from ..arguments import Array
from ..design import nearest_repeatable
from ..errors import InputError, SingularityError
from ..fit_options import FitOptions
from ..motion import Motion, TaskPath, follow
from ..motion.fitting_circle import dexterity_at, fitting_circle
from ..potentials import Polynomial
from ..redundancy.inverses import inverse_condition_number
from ..regions import Region, Tube
from ..regions.region import sobol
from ..robot.length import arm_length
from ..robot.robot import Robot
from ..robot.task import KINDS, Kind, Task
from ..strategies import Inverse, LimitWeight, Pseudoinverse, WeightedInverse

PREFERRED_KINDS: tuple[Kind, ...] = ("pose", "position", "xy", "xz", "yz")
"""Kinds tried in this order when none is named (``axis`` on request only)."""

PERIOD = 5.0
"""Period, s, where none is given and the joints are fast enough."""

SHARE = 0.9
"""Share of a speed limit that a cycle uses at most, where its time is chosen."""

SEARCHED = ("a dexterous pose near mid-range", "another dexterous pose")
"""What starts are that are looked for only where better-known ones fail."""

_LEAST_DEXTERITY = {6: 0.05, 5: 0.05, 2: 0.1}
_LEAST_DEXTERITY_OF_POSITION = 0.2
_LEAST_MARGIN = 0.15
_RANK = 1e-4
_MOST_STARTS, _APART = 8, 0.5


def redundant_kinds(robot: Robot, frame: str) -> dict[str, int]:
    """Find the task kinds an arm can carry out (J reaches full row rank), each with its r.

    The rank is looked for at 32 configurations spread over the joint limits.
    """
    kinds: dict[str, int] = {}
    for kind, rows in KINDS.items():
        if len(robot.chain(frame)) < len(rows):
            continue
        task = robot.task(frame, kind)
        if reaches_full_rank(task):
            kinds[kind] = task.r
    return kinds


def reaches_full_rank(task: Task) -> bool:
    """Say whether J has full row rank at one of 32 configurations within the limits."""
    J = task.jacobians(_spread(task, 32))
    J[:, :3] /= max(arm_length(task, task.reference), 1e-9) if task.m > 2 else 1.0
    return bool((inverse_condition_number(J) > _RANK).any()) and task.r >= 0


def choose_task(
    robot: Robot, frame: str | None, kind: str | None, joints: list[str] | None = None
) -> Task:
    """Make the task asked for, or the first preferred kind that leaves r ≥ 1.

    Raises
    ------
    InputError
        Where r = 0, or J never reaches full rank: the kinds that would be redundant are named.
    """
    frame = robot.default_frame if frame is None else frame
    if kind is not None:
        task = robot.task(frame, cast(Kind, kind), joints=joints)
        if task.r >= 1 and reaches_full_rank(task):
            return task
        others = redundant_kinds(robot, frame)
        names = ", ".join(f"{k} (r = {r})" for k, r in others.items() if r >= 1)
        why = (
            f"n = {task.n} joints move it and the task has m = {task.m} coordinates, so r = {task.r}"
            if task.r < 1
            else f"its joints can never move it in all {task.m} coordinates of the task"
        )
        remedy = f"redundant here: {names}" if names else "no kind of task is redundant here"
        raise InputError(f"{robot.name} {frame!r}, {kind}: {why}; {remedy}")
    kinds = redundant_kinds(robot, frame)
    for preferred in PREFERRED_KINDS:
        if kinds.get(preferred, 0) >= 1:
            return robot.task(frame, preferred, joints=joints)
    count, other = len(robot.chain(frame)), _redundant_frame(robot)
    raise InputError(
        f"{robot.name} {frame!r} is moved by {count} joint{'s' * (count != 1)}: no kind of task is redundant there, "
        + (
            "nor at another frame"
            if other is None
            else f"but one is at {other!r}, for example; choose another frame"
        )
    )


def _redundant_frame(robot: Robot) -> str | None:
    """Find a frame at which some kind of task is redundant, one that many joints move."""
    chains = {tuple(robot.chain(frame)): frame for frame in robot.frames}
    most = sorted(chains, key=len, reverse=True)
    redundant = (
        chains[chain]
        for chain in most
        if max(redundant_kinds(robot, chains[chain]).values(), default=0) > 0
    )
    return next(redundant, None)


def kind_note(robot: Robot, task: Task) -> list[str]:
    """Say why a kind of task was taken that is not the first preferred one."""
    first, joints = PREFERRED_KINDS[0], len(robot.chain(task.frame))
    if task.kind == first:
        return []
    if joints <= len(KINDS[first]):
        return [f"{first} has no redundancy: {joints} joints; {task.kind} was taken"]
    return [f"{first} is not possible: {joints} joints never move {task.frame} in all its coordinates; "
            f"{task.kind} was taken"]  # fmt: skip


def choose_period(usual: float, motions: Mapping[str, Motion | None]) -> tuple[float, list[str]]:
    """Choose a period in which first cycles keep the speed limits: the usual one, or a longer one;
    and say so.

    ``q̇ = G ẋ`` goes as fast as the path is driven: the joints' path is the same in any time. A
    motion that leaves its path in the first cycle does not count.

    Parameters
    ----------
    usual
        The period to lengthen if need be, s.
    motions
        The motions at that period, by the name of their controller.
    """
    first = {
        name: replace(motion, qdot=motion.qdot[: motion.steps + 1])
        for name, motion in motions.items()
        if motion is not None and not (motion.path_loss and motion.path_loss[0] <= 1)
    }
    name = max(first, key=lambda name: first[name].speed_ratio, default=None)
    if name is None or not 1 < first[name].speed_ratio < np.inf:
        return usual, []
    worst = first[name]
    longer = usual * worst.speed_ratio / SHARE
    digit = 10.0 ** (np.floor(np.log10(longer)) - 1)
    period = float(f"{np.ceil(longer / digit) * digit:.2g}")
    return period, [
        f"period increased to {period:g} s; at {usual:g} s, {worst.fastest_joint} would reach "
        f"{worst.speed_ratio:.2g} times its speed limit ({name})"
    ]


LONG = 60.0
"""Estimated processor time of a design, s, above which a lower degree is chosen, or it is said."""

_TOO_LONG = 600.0
"""The same, above which a study is refused unless its degree was asked for."""

_RATE = 3000.0
"""Blocks of the Gauss–Newton matrix that are summed per second of a whole design, in units of N²
entries."""


def design_seconds(task: Task, degree: int) -> float:
    """Estimate the processor time of a design of r out of N polynomials, s, to a factor of about
    3."""
    N = math.comb(task.n + degree, degree) - 1
    nodes = max(1.0, 32 * (N - task.r) * task.r / task.m / 16384)
    return nodes * N**2 * task.r * (task.r + 1) / 2 / _RATE


def choose_degree(task: Task, degree: int | None) -> tuple[int, list[str]]:
    """Take the degree asked for, or 2, or 1 for arms of so many joints that 2 would take long; and
    say so.

    Raises
    ------
    InputError
        If the degree makes too many potentials of all joints, or takes very long and was not asked
        for: before anything long is begun.
    """
    if degree is not None:
        check_degree(task, degree)
        seconds = design_seconds(task, degree)
        told = f"a design of degree {degree} for {task.n} joints takes {_about(seconds)}; a lower --degree takes less"
        return degree, [told] if seconds > LONG else []
    seconds = design_seconds(task, 2)
    if seconds <= LONG:
        check_degree(task, 2)
        return 2, []
    least = design_seconds(task, 1)
    if least > _TOO_LONG:
        raise InputError(
            f"a study of {task.n} joints takes {_about(least)} even at degree 1; choose a frame that fewer joints move "
            "(--frame), lock joints (--lock), or ask for it with --degree 1 (degree=1)"
        )
    why = f"degree 1 is used, which takes {_about(least)}: degree 2 would take {_about(seconds)} for {task.n} joints"
    return 1, [f"{why}; ask for it with --degree 2 (degree=2)"]


def _about(seconds: float) -> str:
    if seconds < 100:
        return f"about {max(seconds, 1):.0f} s"
    return f"about {seconds / 60:.0f} min" if seconds < 6000 else f"about {seconds / 3600:.0f} h"


def check_degree(task: Task, degree: int) -> None:
    """Refuse a degree that makes too many potentials of all joints.

    Raises
    ------
    InputError
        Before anything long is begun.
    """
    try:
        Polynomial(task.reference, degree)
    except InputError as error:  # whose remedy is to choose joints, which not everybody can
        raise InputError(f"{str(error).partition(';')[0]}; lower the degree") from None


def starts(task: Task) -> Iterator[tuple[Array, str]]:
    """Offer starts, the best known first: the reference pose, the ready one, mid-range, a search
    round it.

    Poses that are nearly singular or on a limit are passed over.

    Yields
    ------
    q0 : (n,) array
    where : str
        What it is, for a person.
    """
    names = {
        "reference": "the reference pose",
        "ready": "the ready pose",
        "middle": "mid-range of the joints",
    }
    for pose, where in names.items():
        if pose not in task.robot.poses:
            continue
        q = task.from_robot(task.robot.poses[pose])
        margin = task.limit_margin(q).min()
        least = _LEAST_DEXTERITY.get(task.m, _LEAST_DEXTERITY_OF_POSITION)
        if dexterity_at(task, q) >= least and margin >= _LEAST_MARGIN:
            yield q, where
    middle = task.from_robot(task.robot.poses["middle"])
    low, high = _inner(task)
    low, high = np.maximum(middle - 2.0, low), np.minimum(middle + 2.0, high)
    points = low + (high - low) * sobol(task.n, 512, 0)
    scores = np.array([dexterity_at(task, q) for q in points])
    # Of all poses at least half as dexterous as the best, the one nearest to mid-range.
    good = points[scores >= 0.5 * scores.max()]
    good = good[np.argsort(np.linalg.norm(good - middle, axis=1))]
    for k in range(_MOST_STARTS):  # the nearest, then others that are no neighbours of it
        yield np.round(good[0], 3), SEARCHED[min(k, 1)]
        good = good[np.abs(good - good[0]).max(axis=1) > _APART]
        if not len(good):
            return


def choose_start(task: Task) -> tuple[Array, str]:
    """Take the first good start from which a default path exists, see :func:`starts`."""
    best: tuple[Array, str] | None = None
    for q0, where in starts(task):
        best = best or (q0, where)
        try:
            fitting_circle(task, q0)
        except InputError:
            continue
        return q0, where
    assert best is not None  # there is always a start to offer
    return best


def choose_desired(task: Task, weight: ArrayLike | str | None) -> tuple[Inverse, str]:
    """Make the inverse to be near to, and a name for it: J⁺, or one weighted by ``inertia``,
    ``limits`` or numbers."""
    if weight is None:
        return Pseudoinverse(task), "J⁺"
    if isinstance(weight, str) and weight == "limits":
        return WeightedInverse(
            task, LimitWeight(task)
        ), "J⁺ weighted by the nearness of joint limits"
    desired = WeightedInverse(task, weight)
    if isinstance(weight, str):
        return desired, "J⁺ weighted by the inertia (least kinetic energy)"
    return desired, f"J⁺ weighted by {', '.join(f'{x:g}' for x in np.ravel(weight))}"


def choose_region(task: Task, motion: Motion, width: float | None = None) -> Tube:
    """Take the tube round one cycle of a motion; 0.1 rad or 0.05 m each way, where no width is
    given."""
    return Tube(motion.cycle(0), np.where(task.revolute, 0.1, 0.05) if width is None else width)


def round_the_motion(
    desired: Inverse, path: TaskPath, q0: Array, *, width: float | None = None, seed: int = 0
) -> Tube:
    """Lay a tube where a repeatable motion will be: the desired one drifts away from there, a
    linear design does not.

    Raises
    ------
    SingularityError
        If the desired control cannot follow the path once.
    """
    tube = choose_region(desired.task, follow(desired, path, q0, cycles=1), width)
    # it only says where to design: few nodes will do
    linear = nearest_repeatable(
        desired,
        None,
        tube,
        degree=1,
        options=FitOptions(seed=seed, samples=4096, held_out=1024),
        shrink=True,
    ).inverse
    try:
        return choose_region(desired.task, follow(linear, path, q0, cycles=1), width)
    except SingularityError:
        return tube


def half_width_within(region: Region) -> str:
    """Write the half-width, of two digits, of the largest cube that a region's box holds."""
    width = float(region.bounds.half_width.min())
    digit = 10.0 ** (np.floor(np.log10(width)) - 1)
    return f"{np.floor(width / digit) * digit:.2g}"


def _inner(task: Task) -> tuple[Array, Array]:
    """The middle 80 % of the joint limits; ±3 where there are none."""
    low = np.where(np.isfinite(task.lower), task.lower, np.minimum(-3.0, task.reference - 3.0))
    high = np.where(np.isfinite(task.upper), task.upper, np.maximum(3.0, task.reference + 3.0))
    return low + 0.1 * (high - low), high - 0.1 * (high - low)


def _spread(task: Task, count: int) -> Array:
    """Configurations spread over the inside of the joint limits (count, n)."""
    low, high = _inner(task)
    return np.random.default_rng(0).uniform(low, high, (count, task.n))
