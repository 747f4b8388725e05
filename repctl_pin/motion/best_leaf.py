"""The best leaf for a closed path: the start, among all that reach the path's first point, with the most room."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arguments import MOST_STEPS, wanted, whole
from ..errors import InputError, SingularityError
from ..redundancy import leaf_margin, nullspace
from ..strategies import RepeatableInverse
from .follow import follow
from .motion import Motion
from .paths import TaskPath, closed_path
from .solve_ik import solve_ik

Array = NDArray[np.float64]

_STRIDE = 0.1
_FINEST = 0.01
_DIRECTIONS = 8
_LEAST_LEAF_MARGIN = 0.1
"""No leaf is preferred to the given one that comes nearer to an algorithmic singularity than this."""


@dataclass(frozen=True)
class Candidate:
    """A start, and what one cycle from it is like.

    Attributes
    ----------
    q0 : (n,) array
        The start, with the frame at the path's first point.
    leaf : (r,) array
        c = h(q0).
    margin : float
        The smaller of the two below, the first as a share of half the joint's range: what is maximised.
    limit_margin : float
        Smallest distance of a joint to its limit over the cycle, rad or m; negative outside.
    leaf_margin : float
        Smallest σ_min(Nᵀ V̂) over the cycle.
    motion : Motion
        The cycle.
    """

    q0: Array
    leaf: Array
    margin: float
    limit_margin: float
    leaf_margin: float
    motion: Motion


@dataclass(frozen=True)
class BestLeaf:
    """The result of :func:`best_leaf`.

    Attributes
    ----------
    best, given : Candidate or None
        The best start found, and the given one; None where the given leaf carries no whole cycle.
    tried : int
        How many starts were looked at.
    """

    best: Candidate
    given: Candidate | None
    tried: int

    @property
    def q0(self) -> Array:
        """The start on the best leaf (n,)."""
        return self.best.q0

    def summary(self) -> str:
        """Say what was gained."""
        return "\n".join(
            [
                f"best of {self.tried} leaves of {self.best.motion.path.name}",
                f"  given start  {_line(self.given)}",
                f"  best start   {_line(self.best)}",
            ]
        )


def best_leaf(inverse: RepeatableInverse, path: TaskPath, q0: ArrayLike, *, steps: int = 96, seed: int = 0) -> BestLeaf:
    """Search the self-motion of the start for the leaf with the most room over the whole cycle.

    Under a repeatable control the joint path of all cycles is known after the first, so limits and
    leaf margin can be looked at before the robot moves. Starts are taken along the self-motion of the given
    one, both ways (for r > 1 in several directions), inside the joint limits; then the best is refined by
    a pattern search. It is never worse than the given one, neither in margin nor in limit margin.

    Parameters
    ----------
    inverse
        A repeatable inverse.
    path
        The closed path.
    q0 : (n,) array
        The start to begin from; it is moved to the path's first point where it is off it.
    steps
        Points of a cycle that are looked at.
    seed
        Of the directions for r > 1.

    Returns
    -------
    BestLeaf
        The best start found and the given one, each with its cycle, limit margin and leaf margin.

    Raises
    ------
    InputError
        If the path's first point is out of reach, or no leaf that was tried carries a whole cycle.
    """
    wanted(inverse, RepeatableInverse, "inverse", "a repeatable inverse, such as design.inverse")
    path = closed_path(path)
    steps, seed = whole(steps, "steps", 1, MOST_STEPS), whole(seed, "seed")
    task, target = inverse.task, path.placement(0.0)
    start = solve_ik(task, task.check(q0, "the start"), target)
    given = _judged(inverse, path, start, steps)
    best, tried = given, 1

    def better(candidate: Candidate | None) -> bool:
        if candidate is None:
            return False
        if best is None:
            return True
        if given is None:
            return candidate.margin > best.margin
        clear = candidate.leaf_margin >= min(_LEAST_LEAF_MARGIN, given.leaf_margin)
        return clear and candidate.margin > best.margin and candidate.limit_margin >= given.limit_margin

    for q in _self_motions(inverse, start, path, seed):
        candidate = _judged(inverse, path, q, steps)
        tried += 1
        if better(candidate):
            best = candidate
    if best is None:
        raise InputError(
            f"none of {tried} leaves through the start carries a whole cycle of {path.name}; "
            "make the path smaller, or design over a larger region"
        )
    size = _STRIDE / 2
    while size >= _FINEST:
        N = nullspace(task.jacobian(best.q0))
        moves = [size * sign * n for n in N.T for sign in (1, -1)]
        found = [_judged(inverse, path, q, steps) for q in (_moved(inverse, best.q0, d, path) for d in moves)
                 if q is not None]  # fmt: skip
        tried += len(moves)
        improved = [c for c in found if better(c)]
        if improved:
            best = max((c for c in improved if c is not None), key=lambda c: c.margin)
        else:
            size /= 2
    return BestLeaf(best, given, tried)


def _judged(inverse: RepeatableInverse, path: TaskPath, q0: Array, steps: int) -> Candidate | None:
    """Follow one cycle from a start; None where it cannot be done."""
    task = inverse.task
    try:
        motion = follow(inverse, path, q0, cycles=1, steps=steps, lock=2)
        N = nullspace(task.jacobians(motion.q))
    except SingularityError:
        return None
    if motion.tracking_error.max() > 1e-3 or motion.drift[0] > 1e-3:
        return None  # it lost the path, or came back another way
    clear = float(leaf_margin(N, inverse.field.gradients(motion.q)).min())
    least = motion.limit_margin.min(axis=0)
    half = np.where(np.isfinite(least), (task.upper - task.lower) / 2, 1.0)
    share = float(np.min(least / half))
    return Candidate(motion.q[0], inverse.leaf(motion.q[0]), min(share, clear), float(least.min()), clear, motion)


def _self_motions(inverse: RepeatableInverse, start: Array, path: TaskPath, seed: int) -> Iterator[Array]:
    """Walk from the start in its null space, the frame held, until a limit or a full turn ends the walk."""
    task = inverse.task
    N = nullspace(task.jacobian(start))
    directions = list(N.T)
    if task.r > 1:
        rng = np.random.default_rng(seed)
        directions += [N @ (v / np.linalg.norm(v)) for v in rng.normal(size=(_DIRECTIONS, task.r))]
    for direction in directions:
        for sign in (1.0, -1.0):
            q, along = start, sign * direction
            for _ in range(int(2 * np.pi / _STRIDE)):
                N = nullspace(task.jacobian(q))
                along = N @ (N.T @ along)
                size = np.linalg.norm(along)
                if size < 1e-6:
                    break
                following = _moved(inverse, q, _STRIDE * along / size, path)
                if following is None:
                    break
                q, along = following, following - q
                yield q


def _moved(inverse: RepeatableInverse, q: Array, step: Array, path: TaskPath) -> Array | None:
    """Take a step of the self-motion; None where it leaves the limits."""
    task = inverse.task
    try:
        return solve_ik(task, q + step, path.placement(0.0), tolerance=1e-11)
    except (InputError, SingularityError):
        return None


def _line(candidate: Candidate | None) -> str:
    if candidate is None:
        return "no whole cycle from there"
    violation = candidate.motion.first_violation
    text = f"limit margin {candidate.limit_margin:.3g}, leaf margin {candidate.leaf_margin:.3g}"
    return text + ("" if violation is None else f"; {violation[1]} leaves its limits")
