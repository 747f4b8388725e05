"""Search for the start whose closed motion needs minimum joint speed, before a design is made.

Other starts with the frame at the same placement lie on the self-motions of the given start. The
closed motion of :mod:`least_closed_motion` from each start shows what the best controller could
reach. All motions here are such closed motions of minimum joint speed, of 24 points. A start is
*freed* if it is optimised together with the motion, along its self-motions. J⁺ is the pseudoinverse
of the Jacobian J.

``_LeastStart`` is three closed motions on one path: of lowest joint speed, from the given start,
and with the largest limit margin.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..base.arguments import Array
from ..base.errors import InputError, SingularityError
from ..model.task import Task
from ..paths.task_path import TaskPath
from ..redundancy import nullspace
from .least_closed_motion import least_closed_motion
from .motion import Motion
from .self_motion import self_motions

_STRIDE = 0.4
"""Distance between starts along a self-motion, rad; for prismatic joints in arm lengths."""

_SPARE = (1.0, 1.1, 1.3, 1.6)
"""Multiples of the required joint-limit margin. The search with a free start demands each in turn,
until its result has the required margin."""

_STEPS = 24
"""Number of points per cycle."""

_ROUNDS = 3
"""Maximum number of starts whose self-motions are searched if r > 1: the given start, then the best
one found so far."""

_IMPROVED = 4
"""Number of motions whose starts are freed: this many with the lowest joint speed, and this many
with the lowest joint speed among those with the required margin."""


class _LeastStart(NamedTuple):
    """Closed motions of minimum joint speed from several starts on one path.

    The first configuration of a motion is its start.

    Attributes
    ----------
    best : Motion
        The motion of lowest joint speed (rms) without a collision and with at least half of the
        joint-limit margin of ``clearest``; ``given`` if no such motion has a lower joint speed.
    given : Motion
        The motion from the given start.
    clearest : Motion
        The motion with the largest joint-limit margin.
    """

    best: Motion
    given: Motion
    clearest: Motion


def least_start(task: Task, path: TaskPath, q0: ArrayLike) -> _LeastStart:
    """Search the self-motions of a start for the start that needs minimum joint speed.

    Motions with collisions, and with less than half of the largest joint-limit margin found, are
    excluded.

    Parameters
    ----------
    task
        Redundant task.
    path
        Closed path.
    q0 : (n,) array
        Start, at the path's first point.

    Raises
    ------
    InputError, SingularityError
        If there is no closed motion from q0.
    """
    given = least_closed_motion(task, path, q0, steps=_STEPS)
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
    return _LeastStart(best, given, clearest)


def _freed(motion: Motion, given: Motion, kept: float) -> Motion:
    """Improve a motion by freeing its start; return ``given`` if no result is better than it.

    ``given`` is the motion from the user's start, and ``kept`` the joint-limit margin that the
    result must have, rad or m. A search with a free start may end below the margin that it
    requires. So searches with larger and larger margins, multiples of ``kept``, follow until the
    result has the margin ``kept``.
    """
    found = (_free(motion, factor * kept) for factor in _SPARE)
    better = (one for one in found if one is not None and _better(one, given, kept))
    return next(better, given)


def _along_self_motions(task: Task, path: TaskPath, given: Motion, turn: Array) -> Iterator[Motion]:
    """Yield the closed motions from starts along the self-motions of the start of ``given``.

    The search from each start begins at the motion from the preceding start. The self-motions
    begin in r directions and in their opposites; each row of the orthogonal matrix ``turn`` (r, r)
    has the coordinates of one direction in a null-space basis. The self-motions are followed beyond
    joint limits too, because they can come back within the limits.
    """
    start = given.q[0]
    target = path.placement(0.0)
    directions = turn @ nullspace(task.jacobian(start)).T
    for walk in self_motions(task, start, target, directions, _STRIDE, limits=False):
        guess: Motion | None = given
        for q in walk:
            guess = _least(task, path, q, guess)
            if guess is not None:
                yield guess


def _least(task: Task, path: TaskPath, q: Array, guess: Motion | None) -> Motion | None:
    """Find the motion from a start q (n,); None if there is none, or q is outside the limits.

    The result is the better of two local minima, found from ``guess`` and from the motion of J⁺.
    """
    found: list[Motion] = []
    if task.limit_margin(q).min() >= 0:
        for beside in {guess, None}:
            with suppress(InputError, SingularityError):
                found.append(least_closed_motion(task, path, q, steps=_STEPS, guess=beside))
    return min(found, key=lambda motion: motion.rms_speed, default=None)


def _free(motion: Motion, margin: float) -> Motion | None:
    """Improve a motion by freeing its start; None if that fails.

    The first search optimises the start too, and keeps ``margin``, rad or m, from the joint limits.
    The second search keeps the start found, and minimises the joint speed without that margin.
    """
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
    """Test whether a motion needs less joint speed than ``given``, and has no collision.

    The joint-limit margin of the motion must be at least ``margin``, rad or m.
    """
    fast = motion.rms_speed < given.rms_speed
    return fast and _margin(motion) >= margin and motion.clearance.touch is None


def _margin(motion: Motion) -> float:
    """Minimum joint-limit margin of a motion, rad or m."""
    return float(motion.limit_margin.min())
