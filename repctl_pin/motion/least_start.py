"""Search for the start whose closed motion needs minimum joint speed, before a design is made."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..arguments import Array
from ..errors import InputError, SingularityError
from ..paths.task_path import TaskPath
from ..redundancy import nullspace
from ..robot.task import Task
from .least_motion import least_closed_motion
from .motion import Motion
from .self_motion import self_motions

_STRIDE = 0.4
"""Distance of the starts along a self-motion, rad; for prismatic joints in arm lengths."""

_SPARE = (1.0, 1.1, 1.3, 1.6)
"""Factors of the margin to the limits with which a free start is searched, until it is kept."""

_STEPS = 24
"""Number of points per cycle."""

_ROUNDS = 3
"""Number of starts from which self-motions of more than one dimension are walked: the given one,
then the best found."""

_IMPROVED = 4
"""Number of the slowest motions, and of those with the margin, whose starts are freed."""


class LeastStart(NamedTuple):
    """Least closed motions from several starts on one path; the first point is the start.

    Attributes
    ----------
    best : Motion
        The slowest with at least half of the largest joint-limit margin and no collision; the given
        one if no other is better.
    given : Motion
        The one from the given start.
    clearest : Motion
        The one with the largest joint-limit margin.
    """

    best: Motion
    given: Motion
    clearest: Motion


def least_start(
    task: Task, path: TaskPath, q0: ArrayLike, *, guess: Motion | None = None
) -> LeastStart:
    """Search the self-motions of a start for the start that needs minimum joint speed.

    Its joint-limit margin is at least half of the largest found, and no bodies collide. The motions
    have few points per cycle, enough to compare starts.

    Parameters
    ----------
    task
        Redundant task.
    path
        Closed path.
    q0 : (n,) array
        Start, at the path's first point.
    guess
        A closed motion from there, if there is one.

    Raises
    ------
    InputError, SingularityError
        If there is no closed motion from q0.
    """
    given = least_closed_motion(task, path, q0, steps=_STEPS, guess=guess)
    motions, walked = [given], given
    rng = np.random.default_rng(0)
    for _ in range(_ROUNDS if task.r > 1 else 1):
        turn = np.linalg.qr(rng.normal(size=(task.r, task.r)))[0]
        motions += _along_self_motions(task, path, walked, turn)
        clearest = max(motions, key=_margin)
        kept = _margin(clearest) / 2
        kept = kept if 0 < kept < np.inf else 0.0
        motions.sort(key=lambda motion: motion.rms_speed)
        ahead = next(m for m in motions if m is given or _better(m, given, kept))
        if ahead in (given, walked):
            break
        walked = ahead
    good = [motion for motion in motions if _better(motion, given, kept)]
    chosen = [*motions[:_IMPROVED], *good[:_IMPROVED]]
    freed = (_freed(motion, given, kept) for motion in chosen if motion is not given)
    best = min([given, *good, *freed], key=lambda motion: motion.rms_speed)
    return LeastStart(best, given, clearest)


def _freed(motion: Motion, given: Motion, kept: float) -> Motion:
    """Improve a motion with its start free; the given one if none is better with the margin."""
    found = (_free(motion, factor * kept) for factor in _SPARE)
    better = (one for one in found if one is not None and _better(one, given, kept))
    return next(better, given)


def _along_self_motions(task: Task, path: TaskPath, given: Motion, turn: Array) -> Iterator[Motion]:
    """Generate least closed motions from starts along the self-motions of a start.

    ``turn`` (r, r) rotates the directions. The walks go on beyond joint limits: other parts of a
    self-motion can be inside them again."""
    start, target = given.q[0], path.placement(0.0)
    directions = turn @ nullspace(task.jacobian(start)).T
    for walk in self_motions(task, start, target, directions, _STRIDE, limits=False):
        guess: Motion | None = given
        for q in walk:
            guess = _least(task, path, q, guess)
            if guess is not None:
                yield guess


def _least(task: Task, path: TaskPath, q: Array, guess: Motion | None) -> Motion | None:
    """Find the closed motion of minimum joint speed from a start, by searches that begin with
    ``guess`` and with the motion of J⁺: the better of the two; None if both fail."""
    found: list[Motion] = []
    if task.limit_margin(q).min() >= 0:
        for beside in {guess, None}:
            with suppress(InputError, SingularityError):
                found.append(least_closed_motion(task, path, q, steps=_STEPS, guess=beside))
    return min(found, key=lambda motion: motion.rms_speed, default=None)


def _free(motion: Motion, margin: float) -> Motion | None:
    """Improve a motion with its start free, found with a margin to the limits; None if that fails.

    From the start found, the result is a least motion without that margin."""
    try:
        found = least_closed_motion(
            motion.task,
            motion.path,
            motion.q[0],
            steps=_STEPS,
            free_start=True,
            limit_margin=margin,
            guess=motion,
        )
        start = found.q[0]
        return least_closed_motion(motion.task, motion.path, start, steps=_STEPS, guess=found)
    except (InputError, SingularityError):
        return None


def _better(motion: Motion, given: Motion, margin: float) -> bool:
    """Test for a lower speed than the given motion's, a margin to the limits, and no collision."""
    fast = motion.rms_speed < given.rms_speed
    return fast and _margin(motion) >= margin and bool(motion.body_distance.min() >= 0)


def _margin(motion: Motion) -> float:
    """Minimum joint-limit margin of a motion, rad or m."""
    return float(motion.limit_margin.min())
