"""Search along a self-motion for the start whose leaf has the best margins on a closed path.

A self-motion is a curve of configurations with the frame at one pose. A repeatable inverse with the
potentials h keeps the arm on a leaf, the set h(q) = c. Each start selects a leaf, and so the joint
path of all cycles. The leaf margin ``σ_min(Nᵀ V̂)`` is the distance from a singularity of the
inverse: N spans the null space of J, and V̂ the gradients of h, orthonormalised. Ω is the region of
joint space for which the inverse was designed. The desired inverse G_d, usually the pseudoinverse
J⁺, is the one that the repeatable inverse approximates. A cycle has three relative margins, each a
minimum over the cycle: the smallest, over all joints, of the joint-limit margin divided by half the
joint's range; the body distance divided by a tenth of the arm length; and the leaf margin.

``Bounded`` is a region of joint space that computes how far inside or outside configurations lie.
``_LeafCandidate`` is a start configuration, with the margins of the cycle that begins there.
``_Search`` is a search among starts on one path.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..base.arguments import (
    MOST_STEPS,
    Array,
    as_int,
    percentage,
    read_only,
    require_choice,
    require_type,
)
from ..base.errors import InputError, SingularityError
from ..model.chain_formulas import Placement
from ..model.length import arm_length, joint_scale
from ..model.task import Task
from ..paths.task_path import TaskPath, closed_path
from ..redundancy import leaf_margin, nullspace
from ..solvers import newton_rows
from ..strategies import Bounded, Pseudoinverse, RepeatableInverse
from ..strategies.strategy import AN_INVERSE, Inverse
from .follow import followed
from .joint_motion import violations_of
from .leaf_lock import LeafLock
from .motion import Motion
from .self_motion import self_motions, self_moved
from .solve_ik import random_configurations, solve_ik

_STRIDE = 0.1
"""Step length of the search along the self-motion, rad; for prismatic joints in arm lengths."""

_FINEST = 0.01
"""Smallest step of the pattern search, rad; for prismatic joints in arm lengths."""

_LOST = 1e-3
"""Tracking error, in arm lengths, or drift, in rad or arm lengths, above which a cycle counts as
failed."""

_UNIT_DISTANCE = 0.1
"""Body distance, in arm lengths, that has the relative margin 1."""

_ALIKE = 0.01
"""Difference of relative margins below which they count as equal."""

_BODY_POINTS = 32
"""Number of points per cycle at which body distances are computed."""

_DIRECTIONS = 8
"""Number of random directions of the self-motion for r > 1."""

_RANDOM = 8
"""Number of random starts of lowest joint speed, in addition to starts along self-motions."""

_LEAST_LEAF_MARGIN = 0.1
"""Leaf margin that is sufficient for a start, even if the given start has a larger one."""

_STARTS, _STEPS = 96, 16
"""Numbers of random configurations among which low joint speed is sought, and of points per cycle
at which it is."""

_LONGEST, _EXACT = 0.4, 1e-9
"""Longest step of any joint, and the task error at which a pose is reached; m or rad."""

_ITERATIONS, _CORRECTIONS = 40, 2
"""Maximum numbers of Newton steps to the path, and from each point of the path to the next."""

_JUMP = 1.0
"""Change of a joint between two points, rad or m, at which a motion is given up."""

_APART = 0.3
"""Smallest norm of the difference of two random starts, rad or m."""


@dataclass(frozen=True, eq=False)
@read_only
class _LeafCandidate:
    """A start configuration, with the margins of the cycle that begins there.

    All later cycles have the same margins, because the motion stays on the leaf of its start.

    Attributes
    ----------
    q0 : (n,) array
        Start configuration, with the frame at the path's first point.
    relative_margins : dict
        Minimum margins over the cycle, without unit: ``limits``, the smallest, over all joints, of
        the joint-limit margin divided by half the joint's range; ``bodies``, the body distance
        divided by a tenth of the arm length; and ``leaf``, the leaf margin.
    limit_margin : float
        Minimum joint-limit margin over the cycle and all joints, rad or m; negative if a limit is
        exceeded.
    body_distance : float
        Minimum body distance over the cycle, m; inf without bodies.
    leaf_margin : float
        Minimum σ_min(Nᵀ V̂) over the cycle.
    distance : float
        Relative distance from the desired inverse, ``(Σ ‖G − G_d‖² / Σ ‖G_d‖²)^½`` over the cycle.
    motion : Motion
        Motion of the cycle; ``motion.outside`` is the fraction of its samples outside Ω, None if no
        region Ω was given.
    """

    q0: Array
    relative_margins: dict[str, float]
    limit_margin: float
    body_distance: float
    leaf_margin: float
    distance: float
    motion: Motion

    @property
    def binds(self) -> str:
        """Name of the smallest relative margin, ``limits``, ``bodies`` or ``leaf``.

        A better start must increase this margin.
        """
        return min(self.relative_margins, key=lambda margin: self.relative_margins[margin])

    @property
    def margin(self) -> float:
        """Smallest relative margin, which the search maximises."""
        return self.relative_margins[self.binds]

    @property
    def order(self) -> tuple[float, ...]:
        """Sort key: of two candidates, the better one has the larger key.

        First, the candidate with fewer kinds of violations is better; there are two kinds, exceeded
        joint limits and collisions. Then the smallest relative margins, rounded to 0.01, are
        compared. If these are equal, the next smallest ones are compared. So the other margins
        count, too, where two wrist links that are always close give all candidates the same
        smallest margin. Last, the smallest margins are compared unrounded.
        """
        broken = (self.limit_margin < -1e-9) + (self.body_distance < 0)
        relative_margins = np.rint(np.sort(list(self.relative_margins.values())) / _ALIKE)
        return -broken, *relative_margins.tolist(), self.margin


@dataclass(frozen=True, eq=False)
class BestLeaf:
    """Result of :func:`best_leaf`: the best start found, and the given one for comparison.

    Attributes
    ----------
    best, given : _LeafCandidate, _LeafCandidate or None
        The best start found and the given one, with their margins; ``best.motion.rms_speed`` is the
        joint speed. ``given`` is None if no full cycle can begin at the given start.
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

    best: _LeafCandidate
    given: _LeafCandidate | None
    tried: int

    def __repr__(self) -> str:
        return f"<BestLeaf: best of {self.tried} starts, margin {self.best.margin:.3g}>"

    @property
    def q0(self) -> Array:
        """Start configuration (n,) on the best leaf.

        Start the motion there to stay on that leaf.
        """
        return self.best.q0

    def summary(self) -> str:
        """Summarise the margins of the given and of the best start, in three lines of text."""
        first = f"best of {self.tried} leaves of {self.best.motion.path.name}"
        return f"{first}\n  given start  {_line(self.given)}\n  best start   {_line(self.best)}"


def best_leaf(
    inverse: RepeatableInverse,
    path: TaskPath,
    q0: ArrayLike,
    *,
    region: Bounded | None = None,
    desired: Inverse | None = None,
    by: Literal["limits", "speed"] = "limits",
    steps: int = 96,
    seed: int = 0,
) -> BestLeaf:
    """Search the self-motion of a start for the start with the best margins or the lowest speed.

    Each start selects a leaf, the set h(q) = c on which the motion stays. With a repeatable
    inverse, the joint path of all cycles is known after the first, so limits, body distances and
    leaf margin can be checked before the robot moves. Starts are sampled within the joint limits
    along the self-motion of the given start, in both directions; for r > 1, in several directions.
    The best start is then refined by a pattern search. There are two kinds of violations, exceeded
    joint limits and collisions; the result has no more kinds of violations than the given start.
    For ``by="limits"``, the limit margin of the result is at least that of the given start.
    With a region, only starts whose cycle stays inside the region replace the given start. Without
    a region, a cycle can go far outside the region of the design, where the inverse is no longer
    close to G_d.

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
        Desired inverse G_d, such as ``design.desired``, from which the distance of the inverse is
        evaluated; by default J⁺.
    by
        ``"limits"`` maximises the smallest of the three relative margins of the cycle (joint
        limits, bodies, leaf). ``"speed"`` minimises the joint speed (rms) over leaves without
        collisions whose joint-limit margin is at least half of the margin that ``"limits"`` finds.
        If no such leaf is found, the result is that of ``"limits"``. For ``"speed"``, random starts
        on all self-motions of the first point are tried too.
    steps
        Number of steps per cycle.
    seed
        Random seed of the directions for r > 1, and of the random starts.

    Returns
    -------
    BestLeaf
        The best start found and the given one. Each has the motion of one cycle, its margins, the
        name of the smallest relative margin, and the distance from G_d.

    Raises
    ------
    InputError
        If the path's first point is out of reach, or no leaf that was tried allows a full cycle.
        With a region, leaves other than the given one count only if the cycle stays inside.

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
    require_choice(by, ("limits", "speed"), "criterion")
    steps = as_int(steps, "steps", 1, MOST_STEPS)
    seed = as_int(seed, "seed")
    task, target = inverse.task, path.placement(0.0)
    if region is not None:
        require_type(region, Bounded, "region", "a region, such as design.region")
    if desired is not None:
        require_type(desired, Inverse, "desired", AN_INVERSE)
    G_d = desired or Pseudoinverse(task)
    start = solve_ik(task, task.check(q0, "the start"), target)

    search = _Search(inverse, G_d, path, region, steps)
    search.begin(start)
    best = search.given
    for walk in self_motions(task, start, target, _directions(task, start, seed), _STRIDE):
        best = search.improved(best, walk, search.clearer)
    if best is None:
        raise InputError(
            f"none of the {search.tried} leaves tried along the self-motion of the start allows "
            f"a full cycle of {path.name}{'' if region is None else ' inside the region'}; "
            "use a smaller path or a larger design region"
        )
    best = search.refined(best, search.clearer)
    if by == "speed":
        best = _fastest(search, best, seed)
    return BestLeaf(best, search.given, search.tried)


_Better: TypeAlias = "Callable[[_LeafCandidate, _LeafCandidate], bool]"
"""Function that tells whether the first candidate is better than the second."""


@dataclass(eq=False)
class _Search:
    """Search among starts on one path, which are compared with the given start.

    A start is allowed if it has a full cycle inside the region, with a leaf margin of at least 0.1,
    or of at least that of the given start.

    Attributes
    ----------
    inverse, desired, path, region, steps
        Arguments of :func:`best_leaf`: the repeatable inverse, G_d, the path, Ω or None, and the
        number of steps per cycle.
    given : _LeafCandidate or None
        The given start with its margins; None if its leaf allows no full cycle.
    seen : list of _LeafCandidate
        Starts with a full cycle inside the region, with their margins.
    tried
        Number of starts evaluated.
    """

    inverse: RepeatableInverse
    desired: Inverse
    path: TaskPath
    region: Bounded | None
    steps: int
    given: _LeafCandidate | None = None
    seen: list[_LeafCandidate] = field(default_factory=list)
    tried: int = 0

    def begin(self, start: Array) -> None:
        """Evaluate the given start (n,), with which the others are compared."""
        self.given = self.evaluated(start)
        self.tried = 1
        if self.given is not None and not self.given.motion.outside:
            self.seen.append(self.given)

    def allowed(self, starts: Iterable[Array | None]) -> Iterator[_LeafCandidate]:
        """Evaluate starts (n,), and yield the allowed ones as candidates.

        A None in ``starts`` stands for a start that cannot be reached; it counts as tried.
        """
        for q in starts:
            self.tried += 1
            candidate = None if q is None else self.evaluated(q)
            if candidate is None or candidate.motion.outside:
                continue
            if self.given is None or candidate.leaf_margin >= min(
                _LEAST_LEAF_MARGIN, self.given.leaf_margin
            ):
                self.seen.append(candidate)
                yield candidate

    def clearer(self, one: _LeafCandidate, other: _LeafCandidate) -> bool:
        """Test whether ``one`` is better than ``other``, by :attr:`_LeafCandidate.order`.

        Fewer kinds of violations are better; if equal, larger relative margins are. The joint-limit
        margin of ``one`` must also be at least that of the given start.
        """
        return one.order > other.order and (
            self.given is None or one.limit_margin >= self.given.limit_margin
        )

    def improved(
        self, best: _LeafCandidate | None, starts: Iterable[Array | None], better: _Better
    ) -> _LeafCandidate | None:
        """Compare the candidate ``best`` with the allowed ones of ``starts``; return the best.

        The ``starts`` are configurations (n,). None in ``starts`` is a start that cannot be
        reached. If ``best`` is None, only the ``starts`` are compared, and the result is None if
        none of them is allowed. ``better(a, b)`` tells whether candidate a is better than b.
        """
        for candidate in self.allowed(starts):
            best = candidate if best is None or better(candidate, best) else best
        return best

    def refined(self, best: _LeafCandidate, better: _Better) -> _LeafCandidate:
        """Improve the start ``best`` by a pattern search along its self-motions.

        The neighbours of the best candidate are one step away, forward or back, along the vectors
        of a null-space basis of J. The best candidate is replaced by a better neighbour; if there
        is none, the step is halved, until it is shorter than 0.01. Steps are in rad, or in arm
        lengths for prismatic joints. ``better(a, b)`` tells whether candidate a is better than b.
        """
        target = self.path.placement(0.0)
        size = _STRIDE / 2
        while size >= _FINEST:
            around = _around(self.inverse.task, best.q0, target, size)
            found = self.improved(best, around, better) or best
            size = size / 2 if found is best else size
            best = found
        return best

    def evaluated(self, q0: Array) -> _LeafCandidate | None:
        """Follow one cycle from q0 (n,) and evaluate its margins; return None if the cycle fails.

        A cycle fails at a singularity, if the frame leaves the path, or if it does not close.
        """
        task = self.inverse.task
        length = arm_length(task, q0) or 1.0
        # one cycle, and the inverse along it
        try:
            motion = followed(
                self.inverse, self.path, q0, cycles=1, steps=self.steps, integrator=LeafLock(2)
            )
            motion = replace(motion, region=self.region)
            N = nullspace(task.jacobians(motion.q))
            G = self.inverse.batch(motion.q)
            G_d = self.desired.batch(motion.q)
        except SingularityError:
            return None
        # a cycle that does not close is no candidate
        gap = np.linalg.norm((motion.q[-1] - motion.q[0]) / joint_scale(task, q0))
        if motion.tracking_error.max() > _LOST * length or gap > _LOST:
            return None  # the motion left the path, or did not close
        # its margins, relative to their units
        clear = float(leaf_margin(N, self.inverse.potentials.gradients(motion.q)).min())
        least = motion.limit_margin.min(axis=0)
        bodies = motion._clearance_from(_BODY_POINTS).distance
        width = task.upper - task.lower
        half = np.where(np.isfinite(width), width / 2, 1.0)
        return _LeafCandidate(
            q0=motion.q[0],
            relative_margins={
                "limits": float(np.min(least / half)),
                "bodies": bodies / (_UNIT_DISTANCE * length),
                "leaf": clear,
            },
            limit_margin=float(least.min()),
            body_distance=bodies,
            leaf_margin=clear,
            distance=float(np.linalg.norm(G - G_d) / np.linalg.norm(G_d)),
            motion=motion,
        )


def _fastest(search: _Search, best: _LeafCandidate, seed: int) -> _LeafCandidate:
    """Find the start of lowest joint speed (rms) with at least half the limit margin of ``best``.

    Starts with collisions are excluded; if no other is found, ``best`` is returned. All starts seen
    so far are compared with random ones, and the best is refined. ``seed`` is the random seed.
    """
    least_margin = max(best.limit_margin, 0.0) / 2

    def keeps(one: _LeafCandidate) -> bool:
        return one.limit_margin >= least_margin and one.body_distance >= 0

    def faster(one: _LeafCandidate, other: _LeafCandidate) -> bool:
        quicker = one.motion.rms_speed < other.motion.rms_speed
        return keeps(one) and (quicker or not keeps(other))

    task, path = search.inverse.task, search.path
    beside = _fast_starts(task, path, _RANDOM, margin=least_margin, seed=seed)
    for candidate in [*search.seen, *search.allowed(beside)]:
        best = candidate if faster(candidate, best) else best
    return search.refined(best, faster)


def _fast_starts(
    task: Task, path: TaskPath, count: int, *, margin: float, seed: int
) -> list[Array]:
    """Find starts (n,) from which J⁺ follows one cycle of a path with low joint speed.

    The inverse kinematics of the first point is solved from random configurations, so the starts
    can lie on any self-motion of that pose. Searches along the self-motion of one start do not
    reach all self-motions.

    Parameters
    ----------
    task
        Redundant task.
    path
        Closed path.
    count
        Maximum number of starts; the first has the lowest joint speed.
    margin
        Joint-limit margin that the motion must have, rad or m.
    seed
        Random seed of the configurations.
    """
    random = random_configurations(task, _STARTS, np.random.default_rng(seed))
    first = path.placement(0.0)
    Q = _reached(task, random, first, _ITERATIONS)
    Q = Q[_inside(task, Q, first, margin)]
    starts, energy = Q, np.zeros(len(Q))
    for s in np.linspace(0, 1, _STEPS + 1)[1:]:
        target = path.placement(float(s))
        ahead = _reached(task, Q, target, _CORRECTIONS)
        on = np.abs(ahead - Q).max(axis=1, initial=0.0) < _JUMP
        on &= _inside(task, ahead, target, margin, near=1e-2)
        energy = (energy + ((ahead - Q) ** 2).sum(axis=1))[on]
        starts, Q = starts[on], ahead[on]
    kept: list[Array] = []
    for q in starts[np.argsort(energy)]:
        if len(kept) < count and all(np.linalg.norm(q - x) > _APART for x in kept):
            kept.append(q)
    return kept


def _reached(task: Task, Q: Array, target: Placement, iterations: int) -> Array:
    """Move configurations Q (K, n) towards a target by up to ``iterations`` Newton steps with J⁺.

    Return the K configurations (K, n), also those that do not reach the target.
    """

    def correction(Q: Array, on: NDArray[np.intp]) -> Array:
        J = task.jacobians(Q)
        e = task.errors(Q, [target] * len(Q))
        with np.errstate(all="ignore"):
            return np.einsum("Knm,Km->Kn", np.linalg.pinv(J, rcond=1e-6), e)

    if not len(Q):
        return Q
    return newton_rows(correction, Q, longest=_LONGEST, tolerance=_EXACT, iterations=iterations)[0]


def _inside(
    task: Task, Q: Array, target: Placement, margin: float, *, near: float = 1e-6
) -> NDArray[np.bool_]:
    """Test which of K configurations Q (K, n) reach a target and keep a margin from joint limits.

    Return a mask (K,). The target is reached if no entry of the task error exceeds ``near``, m or
    rad. ``margin`` is the distance to keep from all joint limits, rad or m.
    """
    error = np.abs(task.errors(Q, [target] * len(Q))).max(axis=1, initial=0.0)
    return np.asarray((error < near) & (task.limit_margin(Q).min(axis=1, initial=np.inf) >= margin))


def _around(task: Task, q: Array, target: Placement, size: float) -> Iterator[Array | None]:
    """Yield the neighbours of q (n,), one step away along the self-motions.

    There is one step forward and one back along each vector of a null-space basis of J. The frame
    stays at the target. ``size`` is the length of the step, in rad, or in arm lengths for
    prismatic joints. None is yielded in place of a neighbour that is outside the joint limits or
    does not reach the target.
    """
    N = nullspace(task.jacobian(q))
    L = joint_scale(task, q)
    for n in N.T:
        for sign in (1, -1):
            yield self_moved(task, q, size * sign * n / np.linalg.norm(n / L), target)


def _directions(task: Task, start: Array, seed: int) -> list[Array]:
    """Choose null vectors (n,) of J at the start along which to search.

    The result is an orthonormal basis of the null space and, if r > 1, eight random null vectors,
    drawn with the random seed ``seed``.
    """
    N = nullspace(task.jacobian(start))
    if task.r == 1:
        return list(N.T)
    rng = np.random.default_rng(seed)
    random = rng.normal(size=(_DIRECTIONS, task.r))
    return [*N.T, *(N @ (v / np.linalg.norm(v)) for v in random)]


def _line(candidate: _LeafCandidate | None) -> str:
    """Format the margins and violations of a candidate on one line.

    None stands for a start whose leaf allows no full cycle; the line says so.
    """
    if candidate is None:
        return "no full cycle from this start"
    outside = candidate.motion.outside
    text = f"limit margin {candidate.limit_margin:.3g}, leaf margin {candidate.leaf_margin:.3g}"
    if np.isfinite(candidate.body_distance):
        text += f", body distance {candidate.body_distance:.3g} m"
    text += f" (smallest: {candidate.binds}), {candidate.distance:.2g} from G_d"
    if outside is not None:
        text += f", {percentage(outside)} outside Ω"
    violations = "; ".join(map(str, violations_of(candidate.motion)))
    return f"{text}; {violations}" if violations else text
