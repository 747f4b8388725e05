"""The best leaf for a closed path: the start, among all that reach the path's first point, with the
most room."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from ..arguments import MOST_STEPS, Array, as_int, read_only, require_type
from ..errors import InputError, SingularityError
from ..paths.task_path import TaskPath, closed_path
from ..redundancy import leaf_margin, nullspace
from ..robot.length import arm_length, joint_scale
from ..strategies import Bounded, Inverse, Pseudoinverse, RepeatableInverse
from ..strategies.strategy import AN_INVERSE, Batched
from .follow import follow
from .joint_motion import violations_of
from .motion import Motion
from .solve_ik import solve_ik

_STRIDE = 0.1
"""Of the walk along the self-motion, rad; of prismatic joints in lengths of the arm."""

_FINEST = 0.01
_LOST = 1e-3
"""Tracking error and drift, in lengths of the arm and rad, of a cycle that lost the path or came
back another way."""

_ROOM = 0.1
"""Bodies so far apart, in lengths of the arm, have as much room as a joint in the middle of its
range."""

_ALIKE = 0.01
"""Rooms that differ by less are taken as the same."""

_BODY_POINTS = 32
"""Points of a cycle at which bodies are looked at."""

_DIRECTIONS = 8
_LEAST_LEAF_MARGIN = 0.1
"""No leaf is preferred to the given one that comes nearer to an algorithmic singularity than
this."""


@dataclass(frozen=True, eq=False)
@read_only
class Candidate:
    """A start, and what one cycle from it is like.

    Attributes
    ----------
    q0 : (n,) array
        The start, with the frame at the path's first point.
    leaf : (r,) array
        c = h(q0).
    rooms : dict
        How much room ``limits``, ``bodies`` and ``leaf`` leave: the least limit margin as a share
        of half the joint's range, the least distance as a share of a tenth of the arm's length, the
        least leaf margin.
    limit_margin : float
        Smallest distance of a joint to its limit over the cycle, rad or m; negative outside.
    body_distance : float
        Smallest distance between bodies over the cycle, m; inf where there are none.
    leaf_margin : float
        Smallest σ_min(Nᵀ V̂) over the cycle.
    distance : float
        ``(Σ ‖G − G_d‖² / Σ ‖G_d‖²)^½`` over the cycle.
    motion : Motion
        The cycle; ``motion.outside`` is its share outside Ω, where a region was given.
    """

    q0: Array
    leaf: Array
    rooms: dict[str, float]
    limit_margin: float
    body_distance: float
    leaf_margin: float
    distance: float
    motion: Motion

    @property
    def binds(self) -> str:
        """What leaves the least room: ``limits``, ``bodies`` or ``leaf``."""
        return min(self.rooms, key=lambda room: self.rooms[room])

    @property
    def margin(self) -> float:
        """The least room: what is maximised."""
        return self.rooms[self.binds]

    @property
    def order(self) -> tuple[float, ...]:
        """By what starts are compared: fewer kinds of violation, then the least room; where it is
        the same, the next.

        A wrist whose links are always near each other would else hide how near the others come to a
        limit."""
        broken = (self.limit_margin < -1e-9) + (self.body_distance < 0)
        rooms = np.rint(np.sort(list(self.rooms.values())) / _ALIKE)
        return -broken, *rooms.tolist(), self.margin


@dataclass(frozen=True, eq=False)
class BestLeaf:
    """The result of :func:`best_leaf`.

    Attributes
    ----------
    best, given : Candidate or None
        The best start found, and the given one; None if the given leaf carries no whole cycle.
    tried : int
        How many starts were looked at.

    Examples
    --------
    >>> found = rp.best_leaf(design.inverse, path, q0, region=design.region, steps=24)
    >>> found.tried > 1
    True
    >>> np.allclose(task.placement(found.q0).translation, path.point(0.0))
    True
    """

    best: Candidate
    given: Candidate | None
    tried: int

    def __repr__(self) -> str:
        return f"<BestLeaf: best of {self.tried} starts, margin {self.best.margin:.3g}>"

    @property
    def q0(self) -> Array:
        """The start on the best leaf (n,)."""
        return self.best.q0

    def summary(self) -> str:
        """Say what was gained."""
        first = f"best of {self.tried} leaves of {self.best.motion.path.name}"
        return f"{first}\n  given start  {_line(self.given)}\n  best start   {_line(self.best)}"


def best_leaf(
    inverse: RepeatableInverse,
    path: TaskPath,
    q0: ArrayLike,
    *,
    region: Bounded | None = None,
    desired: Inverse | None = None,
    steps: int = 96,
    seed: int = 0,
) -> BestLeaf:
    """Search the self-motion of the start for the leaf with the most room over the whole cycle.

    Under a repeatable control the joint path of all cycles is known after the first, so limits,
    distances between bodies and leaf margin can be checked before the robot moves. Starts are taken
    along the self-motion of the given one, both ways (for r > 1 in several directions), inside the
    joint limits; the best is then refined by a pattern search. It breaks no more limits than the
    given one, and its limit margin is never smaller. With a region, starts whose cycle stays inside
    it are preferred; without one a cycle may go far outside Ω, where the control is no longer near
    G_d.

    Parameters
    ----------
    inverse
        A repeatable inverse.
    path
        The closed path.
    q0 : (n,) array
        The start to begin from; moved to the path's first point if it is off it.
    region
        Ω, such as ``design.region``.
    desired
        G_d, such as ``design.desired``, from which the distance is measured; by default J⁺.
    steps
        Points per cycle that are checked.
    seed
        Of the directions for r > 1.

    Returns
    -------
    BestLeaf
        The best start found and the given one, each with its cycle, its margins, which of them
        binds, and its distance.

    Raises
    ------
    InputError
        If the path's first point is out of reach, or no leaf that was tried carries a whole cycle
        (inside the region).

    Examples
    --------
    >>> found = rp.best_leaf(design.inverse, path, q0, region=design.region, steps=24)
    >>> found.q0.shape
    (3,)
    """
    require_type(
        inverse, RepeatableInverse, "inverse", "a repeatable inverse, such as design.inverse"
    )
    path = closed_path(path)
    steps, seed = as_int(steps, "steps", 1, MOST_STEPS), as_int(seed, "seed")
    task, target = inverse.task, path.placement(0.0)
    if region is not None:
        require_type(region, Bounded, "region", "a region, such as design.region")
    if desired is not None:
        require_type(desired, Batched, "desired", AN_INVERSE)
    G_d = desired or Pseudoinverse(task)
    start = solve_ik(task, task.check(q0, "the start"), target)

    given = best = _judged(inverse, G_d, path, start, region, steps)
    tried = 1

    def better(starts: Iterable[Array | None]) -> Iterator[Candidate]:
        """Those that are better than the best so far."""
        nonlocal tried
        for q in starts:
            tried += 1
            candidate = None if q is None else _judged(inverse, G_d, path, q, region, steps)
            if candidate is None or candidate.motion.outside:
                continue
            if best is not None and candidate.order <= best.order:
                continue
            clear = given is None or (
                candidate.leaf_margin >= min(_LEAST_LEAF_MARGIN, given.leaf_margin)
                and candidate.limit_margin >= given.limit_margin
            )
            if clear:
                yield candidate

    for candidate in better(_self_motions(inverse, start, path, seed)):
        best = candidate
    if best is None:
        raise InputError(
            f"none of {tried} starts at the path's first point carries a whole cycle of {path.name}"
            f"{'' if region is None else ' inside the region'}; "
            "make the path smaller, or design over a larger region"
        )
    size, L = _STRIDE / 2, joint_scale(task, start)
    while size >= _FINEST:
        N = nullspace(task.jacobian(best.q0))
        moves = [size * sign * n / np.linalg.norm(n / L) for n in N.T for sign in (1, -1)]
        improved = list(better([_moved(inverse, best.q0, move, path) for move in moves]))
        if improved:
            best = max(improved, key=lambda c: c.order)
        else:
            size /= 2
    return BestLeaf(best, given, tried)


def _judged(
    inverse: RepeatableInverse,
    desired: Inverse,
    path: TaskPath,
    q0: Array,
    region: Bounded | None,
    steps: int,
) -> Candidate | None:
    """Follow one cycle from a start; None where it cannot be done."""
    task, length = inverse.task, arm_length(inverse.task, q0) or 1.0
    try:
        motion = replace(
            follow(inverse, path, q0, cycles=1, steps=steps, leaf_lock=2), region=region
        )
        N = nullspace(task.jacobians(motion.q))
        G, G_d = inverse.batch(motion.q), desired.batch(motion.q)
    except SingularityError:
        return None
    gap = np.linalg.norm((motion.q[-1] - motion.q[0]) / joint_scale(task, q0))
    if motion.tracking_error.max() > _LOST * length or gap > _LOST:
        return None  # it lost the path, or came back another way
    clear = float(leaf_margin(N, inverse.potentials.gradients(motion.q)).min())
    least, bodies = (
        motion.limit_margin.min(axis=0),
        float(motion.thinned(_BODY_POINTS).body_distance.min()),
    )
    lower, upper, _ = task.joint_limits
    half = np.where(np.isfinite(upper - lower), (upper - lower) / 2, 1.0)
    rooms = {
        "limits": float(np.min(least / half)),
        "bodies": bodies / (_ROOM * length),
        "leaf": clear,
    }
    return Candidate(
        q0=motion.q[0],
        leaf=inverse.leaf(motion.q[0]),
        rooms=rooms,
        limit_margin=float(least.min()),
        body_distance=bodies,
        leaf_margin=clear,
        distance=float(np.linalg.norm(G - G_d) / np.linalg.norm(G_d)),
        motion=motion,
    )


def _self_motions(
    inverse: RepeatableInverse, start: Array, path: TaskPath, seed: int
) -> Iterator[Array]:
    """Walk from the start in its null space, the frame held, until a limit or a full turn ends the
    walk."""
    task, L = inverse.task, joint_scale(inverse.task, start)
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
                size = np.linalg.norm(along / L)
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
    outside = candidate.motion.outside
    text = f"limit margin {candidate.limit_margin:.3g}, leaf margin {candidate.leaf_margin:.3g}"
    text += (
        f", bodies {candidate.body_distance:.3g} m apart"
        if np.isfinite(candidate.body_distance)
        else ""
    )
    text += f" ({candidate.binds} bind)" if candidate.binds != "leaf" else " (the leaf binds)"
    text += f", {candidate.distance:.2g} from G_d" + (
        "" if outside is None else f", {outside:.0%} outside Ω"
    )
    beyond = "; ".join(map(str, violations_of(candidate.motion)))
    return text + (beyond and f"; {beyond}")
