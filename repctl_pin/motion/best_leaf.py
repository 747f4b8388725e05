"""Search for the best leaf of a closed path: the start with the largest smallest margin."""

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
from .leaf_lock import LeafLock
from .motion import Motion
from .solve_ik import solve_ik

_STRIDE = 0.1
"""Step of the walk along the self-motion, rad; for prismatic joints in arm lengths."""

_FINEST = 0.01
"""Smallest step of the pattern search, in the same units."""

_LOST = 1e-3
"""Tracking error and drift from which a cycle counts as failed, in arm lengths and rad."""

_UNIT_DISTANCE = 0.1
"""Body distance with relative margin 1, in arm lengths."""

_ALIKE = 0.01
"""Relative margins that differ by less count as equal."""

_BODY_POINTS = 32
"""Number of points per cycle at which body distances are computed."""

_DIRECTIONS = 8
"""Number of random directions of the self-motion for r > 1."""

_LEAST_LEAF_MARGIN = 0.1
"""Minimum leaf margin of a leaf that is preferred to the given one."""


@dataclass(frozen=True, eq=False)
@read_only
class Candidate:
    """A start, with the margins of one cycle from it.

    Attributes
    ----------
    q0 : (n,) array
        Start configuration, with the frame at the path's first point.
    leaf : (r,) array
        Level c = h(q0).
    relative_margins : dict
        Relative margins of ``limits``, ``bodies`` and ``leaf``: the minimum limit margin relative
        to half the joint's range, the minimum body distance relative to a tenth of the arm's
        length, and the minimum leaf margin.
    limit_margin : float
        Minimum joint-limit margin over the cycle, rad or m; negative outside.
    body_distance : float
        Minimum body distance over the cycle, m; inf without bodies.
    leaf_margin : float
        Minimum σ_min(Nᵀ V̂) over the cycle.
    distance : float
        Relative distance ``(Σ ‖G − G_d‖² / Σ ‖G_d‖²)^½`` over the cycle.
    motion : Motion
        Motion of the cycle; ``motion.outside`` is its share outside Ω if a region was given.
    """

    q0: Array
    leaf: Array
    relative_margins: dict[str, float]
    limit_margin: float
    body_distance: float
    leaf_margin: float
    distance: float
    motion: Motion

    @property
    def binds(self) -> str:
        """Active margin, the smallest one: ``limits``, ``bodies`` or ``leaf``."""
        return min(self.relative_margins, key=lambda room: self.relative_margins[room])

    @property
    def margin(self) -> float:
        """Smallest relative margin, which the search maximises."""
        return self.relative_margins[self.binds]

    @property
    def order(self) -> tuple[float, ...]:
        """Sort key: fewest violation kinds, then smallest relative margins.

        Equal smallest margins are followed by the next one: otherwise two wrist links that are
        always close to each other would hide the margins of the other joints."""
        broken = (self.limit_margin < -1e-9) + (self.body_distance < 0)
        relative_margins = np.rint(np.sort(list(self.relative_margins.values())) / _ALIKE)
        return -broken, *relative_margins.tolist(), self.margin


@dataclass(frozen=True, eq=False)
class BestLeaf:
    """The result of :func:`best_leaf`.

    Attributes
    ----------
    best, given : Candidate or None
        The best start found, and the given one; None if the given leaf allows no full cycle.
    tried : int
        Number of starts evaluated.

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
        """Start configuration on the best leaf (n,)."""
        return self.best.q0

    def summary(self) -> str:
        """Summarise the given and the best start."""
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
    """Search the self-motion of the start for the leaf with the largest margins over a cycle.

    With a repeatable inverse, the joint path of all cycles is known after the first, so limits,
    body distances and leaf margin can be checked before the robot moves. Starts are sampled along
    the self-motion of the given one, in both directions (for r > 1 in several), within the joint
    limits; the best is then refined by a pattern search. It has no more violations than the given
    one, and its limit margin is never smaller. With a region, starts whose cycle stays inside it
    are preferred; without one a cycle can go far outside Ω, where the inverse is no longer close to
    G_d.

    Parameters
    ----------
    inverse
        A repeatable inverse.
    path
        The closed path.
    q0 : (n,) array
        Given start, moved to the path's first point if necessary.
    region
        Design region Ω, such as ``design.region``.
    desired
        Desired inverse G_d, such as ``design.desired``, for the distance; by default J⁺.
    steps
        Number of steps per cycle.
    seed
        Random seed of the directions for r > 1.

    Returns
    -------
    BestLeaf
        The best start found and the given one, each with its cycle, its margins, the active one,
        and its distance.

    Raises
    ------
    InputError
        If the path's first point is out of reach, or no leaf tried allows a full cycle (inside the
        region).

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

    given = best = _evaluated(inverse, G_d, path, start, region, steps)
    tried = 1

    def better(starts: Iterable[Array | None]) -> Iterator[Candidate]:
        """Yield the starts that are better than the best so far."""
        nonlocal tried
        for q in starts:
            tried += 1
            candidate = None if q is None else _evaluated(inverse, G_d, path, q, region, steps)
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
            f"none of the {tried} leaves tried along the self-motion of the start allows "
            f"a full cycle of {path.name}{'' if region is None else ' inside the region'}; "
            "use a smaller path or a larger design region"
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


def _evaluated(
    inverse: RepeatableInverse,
    desired: Inverse,
    path: TaskPath,
    q0: Array,
    region: Bounded | None,
    steps: int,
) -> Candidate | None:
    """Follow one cycle from a start and evaluate its margins; None if it fails."""
    task, length = inverse.task, arm_length(inverse.task, q0) or 1.0
    try:
        motion = replace(
            follow(inverse, path, q0, cycles=1, steps=steps, integrator=LeafLock(2)), region=region
        )
        N = nullspace(task.jacobians(motion.q))
        G, G_d = inverse.batch(motion.q), desired.batch(motion.q)
    except SingularityError:
        return None
    gap = np.linalg.norm((motion.q[-1] - motion.q[0]) / joint_scale(task, q0))
    if motion.tracking_error.max() > _LOST * length or gap > _LOST:
        return None  # the motion left the path, or did not close
    clear = float(leaf_margin(N, inverse.potentials.gradients(motion.q)).min())
    least = motion.limit_margin.min(axis=0)
    bodies = float(motion.thinned(_BODY_POINTS).body_distance.min())
    lower, upper, _ = task.joint_limits
    half = np.where(np.isfinite(upper - lower), (upper - lower) / 2, 1.0)
    relative_margins = {
        "limits": float(np.min(least / half)),
        "bodies": bodies / (_UNIT_DISTANCE * length),
        "leaf": clear,
    }
    return Candidate(
        q0=motion.q[0],
        leaf=inverse.leaf(motion.q[0]),
        relative_margins=relative_margins,
        limit_margin=float(least.min()),
        body_distance=bodies,
        leaf_margin=clear,
        distance=float(np.linalg.norm(G - G_d) / np.linalg.norm(G_d)),
        motion=motion,
    )


def _self_motions(
    inverse: RepeatableInverse, start: Array, path: TaskPath, seed: int
) -> Iterator[Array]:
    """Sample the self-motion of the start, up to a joint limit or a full turn."""
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
    """Take a step of the self-motion; None if it leaves the limits."""
    task = inverse.task
    try:
        return solve_ik(task, q + step, path.placement(0.0), tolerance=1e-11)
    except (InputError, SingularityError):
        return None


def _line(candidate: Candidate | None) -> str:
    if candidate is None:
        return "no full cycle from this start"
    outside = candidate.motion.outside
    text = f"limit margin {candidate.limit_margin:.3g}, leaf margin {candidate.leaf_margin:.3g}"
    if np.isfinite(candidate.body_distance):
        text += f", body distance {candidate.body_distance:.3g} m"
    text += f" (smallest: {candidate.binds}), {candidate.distance:.2g} from G_d"
    if outside is not None:
        text += f", {outside:.0%} outside Ω"
    violations = "; ".join(map(str, violations_of(candidate.motion)))
    return f"{text}; {violations}" if violations else text
