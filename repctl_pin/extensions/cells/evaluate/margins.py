"""Margins of a candidate function, and a search for the poses of its cell where they are smallest.

There are four kinds of margins: the distance of a joint from its limits, the distance between two
bodies, the distance from a singularity (σ_min of J), and the leaf margin, which is the distance
from an algorithmic singularity. Bodies are those of the robot's links and of its surroundings; the
pairs are two links, or a link and the surroundings, see :class:`rp.Bodies`. The candidate q = F(x)
gives one configuration for each pose of the cell, with coordinates u (k,) from −1 to 1. It is
written in a chart, polynomials in u that approximate a configuration and the null space of J: the
label s is the position of F along the self-motion. Points are configurations with their kinematics
at K poses. A pose has no point if Newton's method finds no configuration of F there (``found`` is
False). A coordinate of the cell is symmetric if a single joint moves the frame along it. The
potentials of a chart are equal to s, and its leaf is the set s = 0.

Letters: n joints, r components of s, k coordinates u, K poses or configurations, P margins of one
kind per configuration, such as one per joint.

``CandidateFunction`` is a candidate for F: a chart, and the coefficients a of the label ``s(u) =
Σ_t a_t T_t(u)``, with monomials T_t. ``Chart`` is coordinates (u, s) of configurations: u gives the
pose, the label s (r,) the position along its self-motion. ``Quantity`` is a margin, or a joint
speed, that a search minimises over the cell of a function.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ....base.arguments import Array, read_only
from ....model.bodies import Bodies, bodies_of
from ....model.native_kinematics import placed
from ....model.task import Task
from ....redundancy import leaf_margin
from ....solvers import StepLengths, descend_in_box
from ..chart.chart import Chart, Points
from ..chart.monomials import Monomials
from ..geometry.cell import Cell
from ..geometry.kinematics import null_bases, regular, rows_of, singular_values
from .reach import unlike_rows

_DIFFERENCE = 3e-4
"""Factor of the direction in joint space that gives the step of central differences of a margin."""

_STEP = 1e-6
"""Step of u in one-sided differences of the leaf margin and of joint speeds."""

_ENDLESS = 1e6
"""Value that replaces the infinite margin of a joint without limits in finite differences."""

_NEARBY, _FAR, _APART = 12, 40, 0.06
"""Number of leaves on either side of a configuration at which a larger margin is searched for, with
``far=False`` and with ``far=True``; and the spacing of these leaves, rad."""

_HALVINGS = 6
"""Number of times that the spacing is halved around the leaf with the largest margin."""

_LENGTHS = StepLengths(first=0.2, longest=0.5, shortest=1e-4, longer=1.5, shorter=3.0, steps=25)
"""Step lengths of the search for small margins, in coordinates u of the cell."""

_RANK = 1e-12
"""Value of σ_min / σ_max at or below which J has lost rank."""

_JUMP = 1.0
"""Change of a joint in one step of u, rad or m, from which on the step is taken for a jump to a
different solution branch."""


_TESTED, _AT_ONCE = 32, 8
"""Numbers of configurations with overlapping convex hulls at which the bodies themselves are tested
for collision: to estimate the fraction that collides, and per step in the search for the
minimum."""

_SURELY = 1e-5
"""Distance above the smallest one, m, beyond which hulls are not measured; tests whether hulls are
nearer are accurate to 1e-6."""


_SAMPLED, _BETWEEN, _EDGES, _LIKELY = 4096, 4096, 1 / 3, 128
"""Numbers of the search for the poses at which pairs of bodies are nearest: Sobol poses; further
poses, of which all coordinates but two are −1 or 1; fraction of the coordinates of the Sobol poses
that are moved to −1 or 1; and poses with the smallest bounds, and the same number of the last
poses, at which the distance of a pair is computed."""

_STARTS, _SPREAD = 3, 0.3
"""Maximum number of poses per pair from which the search starts, and the difference that they must
exceed in some joint, relative to half of its range over the samples."""

_BESIDE, _TRIED = (0.3, 0.1, 0.1, 0.04, 0.04, 0.015, 0.006, 0.002), 8
"""Standard deviations of the random steps from the best pose of a pair, in coordinates of the cell,
one per round of the search; and number of steps per round and coordinate."""

_FARTHER = 0.01
"""A pair is searched for between the sampled poses if its distance at these, m, exceeds the
smallest distance by less than this number."""


class Quantity(ABC):
    """A quantity that :func:`searched` minimises over the cell of a function.

    Subclasses are kinds of margins, and joint speeds relative to the desired inverse. A subclass
    defines :meth:`least`, the value of the quantity at given points, and :meth:`slope` if the
    derivatives of the quantity are known.
    """

    @abstractmethod
    def least(self, at: Points) -> Array:
        """Evaluate the quantity at K points of a function: (K,), infinite where ``found`` is False.

        If a kind of margin has P values per point, the result is the smallest of the P values.
        """

    def slope(self, candidate: CandidateFunction, at: Points) -> Array | None:
        """Evaluate the quantity's gradient with respect to u at K points of a function: (K, k).

        Return None if the derivatives are not known; the caller then uses :func:`differences`.
        """
        return None


@dataclass(frozen=True)
class Margin(Quantity):
    """A kind of margin, such as joint limits, with its required minimum.

    A margin is the distance of a configuration from a limit. The fit penalises margins that are too
    small.

    Attributes
    ----------
    name : str
        Display name.
    measure : function (K, n) → (K, P)
        Evaluates P margins at each of K configurations: the n distances of the joints from their
        limits, or P = 1 body distance or σ_min of J.
    required : float
        Required minimum of the margin.
    slack : float
        Fraction of the required minimum by which a margin may fall short without being penalised.
    watched : int
        Maximum number of poses at which the margin is checked.
    starts : int
        Maximum number of poses from which smaller margins are searched for.
    violators : int
        The fit penalises margins at a set of poses. This is the maximum number of poses with too
        small a margin that one round of the fit adds to this set. ``watched``, ``starts`` and
        ``violators`` are smaller for body distances, which take a hundred times as long to compute
        as limit margins.
    """

    name: str
    measure: Callable[[Array], Array]
    required: float
    slack: float
    watched: int
    starts: int
    violators: int

    def least(self, at: Points) -> Array:
        """Return the smallest of the P margins at each of K points: (K,).

        The result is infinite where there is no point.
        """
        return np.where(at.found, self.measure(at.Q).min(axis=1, initial=np.inf), np.inf)

    def slope(self, candidate: CandidateFunction, at: Points) -> Array:
        """Evaluate the gradient (K, k) of the smallest margin with respect to u, along a function.

        ``at`` are points of the function.
        """
        lowest = self.measure(at.Q).argmin(axis=1)
        return self.slopes(at.Q, candidate.derivative(at))[np.arange(len(lowest)), lowest]

    def slopes(self, Q: Array, D: Array) -> Array:
        """Evaluate the derivatives (K, P, p) of the P margins along p directions in joint space.

        The directions at each configuration of Q (K, n) are the columns of D (K, n, p). Central
        differences are used, so that a margin needs no derivative of its own.
        """
        K, n, p = D.shape
        step = _DIFFERENCE * np.swapaxes(D, 1, 2)
        ends = [
            np.minimum(self.measure((Q[:, None] + w * step).reshape(K * p, n)), _ENDLESS)
            for w in (1.0, -1.0)
        ]
        return np.swapaxes((ends[0] - ends[1]).reshape(K, p, -1), 1, 2) / (2 * _DIFFERENCE)

    def attainable(
        self, chart: Chart, at: Points, *, far: bool = False, enough: float = np.inf
    ) -> Array:
        """Find the largest margin that self-motion attains at the poses of K points ``at``: (K,).

        The fit never requires more than this largest margin at a pose. At each pose, the search
        changes one component of the label s at a time, by up to 0.7 rad in steps of 0.06 rad, and
        refines the best label. With ``far``, the changes are up to 2.4 rad, which for r = 1 covers
        the self-motion inside the limits. The search at a pose ends when its margin is at least
        ``enough``.
        """
        search = _LeafSearch(self, chart, at, enough)
        search.along(_FAR if far else _NEARBY)
        for i in range(1, _HALVINGS + 1):
            search.refine(0.5**i * _APART)
        return search.most


class _LeafSearch:
    """Search for the largest margin that self-motion attains at the poses of K points ``at``.

    Parameters
    ----------
    margin
        The kind of margin.
    chart
        Chart in which labels s select configurations along the self-motion.
    at
        Points, at whose labels the search begins.
    enough
        Margin at which the search at a pose ends.

    Attributes
    ----------
    most : (K,) array
        Largest margin found so far.
    """

    def __init__(self, margin: Margin, chart: Chart, at: Points, enough: float) -> None:
        self._margin, self._chart, self._at, self._enough = margin, chart, at, enough
        self._goals = chart.goals_of(at)
        r = at.n_ref.shape[2]
        self._ways = np.concatenate([np.eye(r), -np.eye(r)])
        self.most, self._best = margin.least(at), at.Q.copy()
        self._s = np.einsum("Knr,Kn->Kr", at.n_ref, at.Q - at.q_ref)

    def along(self, count: int) -> None:
        """Try ``count`` labels in each of 2 r directions, 0.06 rad apart, at each pose.

        The labels begin next to the best one so far, which is at first the label of the point. A
        direction increases or decreases one component of the label. Newton's method for a label
        starts from the solution for the preceding label of the same direction. All directions are
        followed at once; if equal margins are found, the first direction has precedence.
        """
        ways, here, K = self._ways, self._s.copy(), len(self._best)
        Q = np.tile(self._best, (len(ways), 1, 1))
        most, s, best = np.full((len(ways), K), -np.inf), np.tile(here, (len(ways), 1, 1)), Q.copy()
        for i in range(1, count + 1):
            left = np.maximum(self.most, most.max(axis=0)) < self._enough
            way, on = np.nonzero(np.broadcast_to(left, most.shape))
            if not len(on):
                break
            label = here[on] + i * _APART * ways[way]
            least, Q[way, on] = self._solved(on, label, Q[way, on])
            better = least > most[way, on]
            rows = way[better], on[better]
            most[rows], s[rows], best[rows] = least[better], label[better], Q[rows]
        for found in zip(most, s, best, strict=True):
            self._keep(np.arange(K), *found)

    def refine(self, length: float) -> None:
        """Try 2 r labels per pose, each at the distance ``length``, rad, from the best so far.

        One after the other, each component of the label is increased and decreased. A label with a
        larger margin becomes the best one at once, so the next label is tried near it.
        """
        for way in self._ways:
            on = np.flatnonzero(self.most < self._enough)
            if not len(on):
                return
            label = self._s[on] + length * way
            least, Q = self._solved(on, label, self._best[on])
            self._keep(on, least, label, Q)

    def _solved(self, on: NDArray[np.intp], label: Array, Q: Array) -> tuple[Array, Array]:
        """Solve for labels (L, r) at the poses ``on`` (L,) by Newton's method from Q (L, n).

        Return the margins (L,), −inf where there is no solution, and the configurations (L, n).
        """
        goals = rows_of(self._goals, on)
        points = self._chart.solve(self._at.U[on], label, Q, goals=goals, iterations=4)
        return np.where(points.found, self._margin.least(points), -np.inf), points.Q

    def _keep(self, on: NDArray[np.intp], least: Array, label: Array, Q: Array) -> None:
        """Record margins (L,) at the poses ``on`` (L,) where they exceed the largest found so far.

        The labels (L, r) and configurations Q (L, n) of these margins are recorded, too.
        """
        better = least > self.most[on]
        rows = on[better]
        self.most[rows], self._s[rows], self._best[rows] = least[better], label[better], Q[better]


def limits_of(limited: Task | Cell, required: float = 0.0) -> Margin:
    """Make the margin of joint limits: the distance of each joint from its nearer limit, rad or m.

    ``required`` is the required minimum. ``limited`` is a task or a cell. In a cell, a joint that
    alone moves the frame along a symmetric coordinate also moves through the range of this
    coordinate; the margin is then the smallest over this range.
    """
    return Margin(
        "joint limits", limited.limit_margin, required, 0.4, watched=4096, starts=48, violators=96
    )


def distances_of(task: Task, required: float = 0.0) -> Margin:
    """Make the margin of collisions: the smallest distance between convex hulls of bodies, m.

    The smallest distance is taken over all pairs of bodies. ``required`` is the required minimum.
    The distance between two hulls is at most the distance between the bodies in them, and much
    faster to compute.
    """
    distances = bodies_of(task).hull_distances
    return Margin(
        "bodies",
        lambda Q: distances(Q)[:, None],
        required,
        0.25,
        watched=256,
        starts=4,
        violators=16,
    )


def singular_values_of(task: Task, required: float = 0.0) -> Margin:
    """Make the margin of singularities: σ_min of J, with the required minimum ``required``."""

    def measure(Q: Array) -> Array:
        return singular_values(placed(task, Q)[2])[:, -1:]

    return Margin("singularities", measure, required, 0.25, watched=2048, starts=24, violators=96)


def potential_gradients(chart: Chart, at: Points) -> Array:
    """Evaluate the gradients V (K, n, r) of a chart's potentials at points ``at`` of its leaf.

    A controller that follows the function holds these potentials constant.
    """
    _, dU = chart.cell.slopes(chart.cell.placements(at.U)[0], at.R)
    return chart.gradients(at.U, dU, at.J, at.n_ref, at.Q - at.q_ref)


def leaf_margins(chart: Chart, at: Points, N: Array | None = None) -> Array:
    """Evaluate the leaf margin ``σ_min(Nᵀ V̂) = 1 / ‖I − G J‖₂`` (K,) at points of a chart's leaf.

    The orthonormal columns of N span the null space of J, those of V̂ the gradients of the chart's
    potentials, and G is the inverse that holds these potentials constant. The reciprocal of the
    margin, minus 1, is the extra joint speed of G relative to J⁺ in the worst direction of ẋ. The
    margin is 0 where there is no point, or J loses rank. If N (K, n, r) is None, it is computed.
    """
    margin = np.zeros(len(at.U))
    rows = np.flatnonzero(at.found)
    if len(rows):
        on = rows_of(at, rows)
        bases = null_bases(on.J, on.n_ref) if N is None else N[rows]
        values = leaf_margin(bases, potential_gradients(chart, on))
        margin[rows] = np.where(regular(on.J, _RANK), np.nan_to_num(values), 0.0)
    return margin


@dataclass(frozen=True, eq=False)
class LeafMargin(Quantity):
    """Leaf margin of the function s = 0 of a chart: the distance from an algorithmic singularity.

    Attributes
    ----------
    chart : Chart
        Chart of the function.
    """

    chart: Chart

    def least(self, at: Points) -> Array:
        """Evaluate the leaf margin at K points: (K,), infinite where there is no point.

        :func:`leaf_margins`, in contrast, is 0 where there is no point.
        """
        return np.where(at.found, leaf_margins(self.chart, at), np.inf)


def lowest_distances(
    bodies: Bodies, Q: Array, *, required: float = 0.0, quick: bool = False
) -> tuple[Array, float]:
    """Compute body distances (K,), m, at Q (K, n), and the fraction of rows below ``required``, m.

    Only the smallest distance is exact, as from :meth:`Bodies.distances`. In a row without a
    collision, the distance is a lower bound, such as the distance of convex hulls. In a row where
    hulls overlap, the bodies themselves must be tested, which takes forty times as long. So not
    all of these rows are tested. From a sample of them, the fraction is estimated. Then rows with
    the deepest overlap are tested, until no other row can have a smaller distance than the smallest
    one found. In rows with overlap that are not tested, the distance is set to 0.

    With ``quick``, only the 8 rows with the deepest overlap are tested. The fraction counts the
    other rows with overlap as not below ``required``, and the smallest distance may be missed.
    """
    hulls = _nearest_hulls(bodies, Q, required)
    overlap = np.flatnonzero(hulls < 0)
    overlap = overlap[np.argsort(hulls[overlap])]
    distances = np.maximum(hulls, 0.0)
    if quick:
        some = overlap = overlap[:_AT_ONCE]
    else:
        count = min(_TESTED, len(overlap))
        some = overlap[np.linspace(0, len(overlap) - 1, count, dtype=int)]
    distances[some] = bodies.distances(Q[some])
    others = overlap[~np.isin(overlap, some)]
    for start in range(0, len(others), _AT_ONCE):
        rows = others[start : start + _AT_ONCE]
        if distances.min() <= hulls[rows[0]]:
            break
        distances[rows] = bodies.distances(Q[rows])
    below = (distances[some] < required).sum() / max(1, len(some)) * len(overlap)
    below += ((hulls >= 0) & (hulls < required)).sum()
    return distances, float(below / len(Q))


def _nearest_hulls(bodies: Bodies, Q: Array, required: float) -> Array:
    """Compute the distance (K,), m, of the nearest pair of convex hulls at each row of Q (K, n).

    The smallest of the K distances is exact, and so are all that are negative or below
    ``required``, m. The others are lower bounds, which are faster to compute. Each of them exceeds
    the smallest distance.
    """
    first = np.argsort(bodies._hull_bounds(Q))[:_TESTED]
    hulls = np.full(len(Q), np.inf)
    hulls[first] = bodies.hull_distances(Q[first])
    rest = np.flatnonzero(hulls == np.inf)
    enough = max(0.0, required, hulls.min(initial=np.inf)) + _SURELY
    near = bodies._nearer(Q[rest], enough)
    hulls[rest] = enough
    hulls[rest[near]] = bodies.hull_distances(Q[rest[near]])
    return hulls


def nearest_by_pair(candidate: CandidateFunction, seed: int, distance: float) -> Array:
    """Search for the poses at which each pair of bodies is nearest: coordinates (L, k).

    Each pair that can come nearer than ``distance``, m, has a search of its own, with up to three
    results. A common search would find only the nearest pair, such as two links of a wrist, whose
    distance does not change. Poses are drawn at random (with ``seed``), ever closer to the best
    poses so far. At all returned poses, the function exists inside the joint limits.
    """
    cell = candidate.chart.cell
    bodies, rng = bodies_of(cell.task), np.random.default_rng(seed)
    at, inside = _inside(candidate, with_edges(cell, _SAMPLED, seed, rng))
    best, which = _starts_by_pair(bodies, rows_of(at, inside), distance)
    least = np.full(len(best), np.inf)
    tried = best[:, None]
    for width in (*_BESIDE, 0.0):
        found = _distances_of_pairs(candidate, tried, which)
        row = np.arange(len(best)), found.argmin(axis=1)
        better = found[row] < least
        best[better], least[better] = tried[row][better], found[row][better]
        step = width * rng.standard_normal((len(best), _TRIED * cell.k, cell.k))
        step *= rng.random(step.shape) < 0.5  # some coordinates stay, such as those at an edge
        tried = np.clip(best[:, None] + step, -1, 1)
    return best[least < np.inf]


def _starts_by_pair(bodies: Bodies, at: Points, distance: float) -> tuple[Array, NDArray[np.intp]]:
    """Select, from sampled points, poses at which pairs of bodies are near: (L, k) and pairs (L,).

    Each pair that can come nearer than ``distance``, m, has up to three poses; the index of the
    pair stands in the same row of the second array. In these poses, joints that move the pair
    differ. Poses that differ in other joints only, such as that of the spin, have equal distances.
    """
    bounds = bodies._pair_bounds(at.Q)
    moved = np.array([bodies._moved_by(joint) for joint in range(at.Q.shape[1])])
    half = np.maximum(np.ptp(at.Q, axis=0) / 2, _STEP) if len(at.Q) else 1.0
    starts, pairs = [at.U[:0]], []
    for pair in np.flatnonzero(bounds.min(axis=0, initial=np.inf) < distance):
        # the smallest bounds, which may all be on one side, and as many others with the corners
        likely = np.union1d(np.argsort(bounds[:, pair])[:_LIKELY], np.arange(len(at.Q))[-_LIKELY:])
        found = bodies._of_pairs(at.Q[likely], np.full(len(likely), pair))
        likely = likely[np.argsort(found)]
        if found.min() < distance + _FARTHER:
            joints = (at.Q[likely] / half)[:, moved[:, pair]]
            starts.append(at.U[likely][unlike_rows(joints, _SPREAD, _STARTS)])
            pairs += [pair] * len(starts[-1])
    return np.concatenate(starts), np.array(pairs, int)


def _distances_of_pairs(candidate: CandidateFunction, U: Array, pairs: NDArray[np.intp]) -> Array:
    """Compute the distance of one pair of bodies per row of poses U (L, M, k): (L, M), m.

    ``pairs`` (L,) has the index of the pair of each row. The distance is inf where the function
    does not exist inside the joint limits.
    """
    at, inside = _inside(candidate, U.reshape(-1, U.shape[-1]))
    found = np.full(len(at.Q), np.inf)
    bodies = bodies_of(candidate.chart.cell.task)
    found[inside] = bodies._of_pairs(at.Q[inside], pairs.repeat(U.shape[1])[inside])
    return found.reshape(U.shape[:2])


def with_edges(cell: Cell, count: int, seed: int, rng: np.random.Generator) -> Array:
    """Sample poses of a cell, many of them at its edges, where bodies are nearest: (K, k).

    The first ``count`` are Sobol points drawn with ``seed``. About a third of the coordinates of
    these points, selected by ``rng``, is moved to the nearer end, −1 or 1. At the poses after them,
    all coordinates but two are −1 or 1. The last poses are the corners.
    """
    U = cell.sample(count, seed)
    U = np.where(rng.random(U.shape) < _EDGES, np.sign(U), U)
    return np.concatenate([U, _between_corners(cell, rng), cell.corners()])


def _between_corners(cell: Cell, rng: np.random.Generator) -> Array:
    """Sample 4096 poses of which all coordinates but two are −1 or 1: (4096, k).

    The two coordinates are selected at random for each pose, and have random values. Where two
    coordinates of a cell are at their ends, such as radius and height of a sector, bodies may be
    near each other only in a small range of the other coordinates. Fewer poses would miss this
    range.
    """
    U = np.sign(rng.uniform(-1, 1, (_BETWEEN, cell.k)))
    free = rng.random(U.shape).argsort(axis=1) < 2
    return np.where(free, rng.uniform(-1, 1, U.shape), U)


def _inside(candidate: CandidateFunction, U: Array) -> tuple[Points, NDArray[np.bool_]]:
    """Return the points of a function at U (K, k), and a mask (K,) of those inside the limits."""
    at = candidate.at(U)
    margin = candidate.chart.cell.task.limit_margin(at.Q).min(axis=1)
    return at, np.asarray(at.found & (margin >= 0))


@dataclass(frozen=True, eq=False)
@read_only
class CandidateFunction:
    """Candidate for the function F: the configurations of a chart with ``s(u) = Σ_t a_t T_t(u)``.

    The fit chooses the coefficients a that minimise the cost.

    Attributes
    ----------
    chart : Chart
        The chart.
    terms : Monomials
        The N monomials T_t of the cell's coordinates u.
    a : (N, r) array
        Coefficients a_t of the label s, one row per monomial.
    """

    chart: Chart
    terms: Monomials
    a: Array

    @classmethod
    def zero(cls, chart: Chart) -> CandidateFunction:
        """Make the candidate with s = 0, the function of the chart itself."""
        return cls(chart, Monomials(chart.cell.k, 0), np.zeros((1, chart.cell.task.r)))

    def at(self, U: Array, Q: Array | None = None) -> Points:
        """Find the points of the function at poses U (K, k), by Newton's method.

        The method starts from the configurations Q (K, n), by default those of the chart.
        """
        return self.chart.solve(U, self.terms.polynomials(U, self.a), Q)

    def derivative(self, at: Points) -> Array:
        """Evaluate ∂F/∂u (K, n, k) at K points of the function."""
        slopes = self.terms.slopes(self.terms.values(at.U))
        ds = np.einsum("KNk,Nr->Krk", slopes, self.a)
        return self.chart.derivative(at, ds)[0][:, :, : self.chart.cell.k]


def differences(
    candidate: CandidateFunction, at: Points, values: Array, least: Callable[[Points], Array]
) -> Array:
    """Evaluate gradients (K, k) with respect to u by one-sided differences, along a function.

    ``at`` are K points of the function, and ``values`` (K,) are the values of a quantity at these
    points. ``least`` evaluates the quantity at K k further points: from each point, one step into
    the cell along each of the k coordinates. Entries of the gradient are 0 where the function does
    not exist.
    """
    K, k = at.U.shape
    step = np.where(at.U > 0, -_STEP, _STEP)
    U = at.U[:, None] + step[:, :, None] * np.eye(k)
    ends = candidate.at(U.reshape(K * k, k), np.repeat(at.Q, k, axis=0))
    with np.errstate(invalid="ignore"):
        slope = (least(ends).reshape(K, k) - values[:, None]) / step
    return np.where(np.isfinite(slope), slope, 0.0)


def searched(
    candidate: CandidateFunction,
    *starts: tuple[Quantity, Array],
    shortest: float = _LENGTHS.shortest,
) -> Array:
    """Search the cell for poses at which quantities are smallest, by projected gradient descent.

    At the boundary of the cell, steps outward are suppressed. Return the coordinates (L, k) of the
    poses that the descents visited: starting poses, poses at which the quantity was lower than
    before, and poses at which the function does not exist. The last rows are the final poses, one
    per descent, in the order of the starting poses. Starting poses at which the function does not
    exist have no descent, and are left out.

    Parameters
    ----------
    candidate
        The candidate function.
    *starts : (quantity, (K, k) array) pairs
        Quantities to minimise, each with the poses from which its descents start. All descents
        step together, because Newton's method takes hardly longer for many poses than for a few.
    shortest
        Step length in u below which a descent ends.
    """
    quantities = [quantity for quantity, _ in starts]
    here = candidate.at(np.concatenate([U for _, U in starts]))
    which = np.repeat(np.arange(len(starts)), [len(U) for _, U in starts])[here.found]
    here = rows_of(here, here.found)
    tried, visited = here, [here.U]
    ways, moved = np.empty_like(here.U), np.ones(len(here.U), bool)

    def trial(rows: NDArray[np.intp], length: Array) -> Array:
        # after a step that was rejected, the slope is known
        some = rows[moved[rows]]
        if len(some):
            part = rows_of(here, some)
            slope = _slopes_of(quantities, candidate, which[some], part, value[some])
            outward = (np.abs(part.U) >= 1) & (slope * part.U < 0)
            slope = np.where(outward, 0.0, slope)
            ways[some] = slope / np.maximum(np.abs(slope).max(axis=1, keepdims=True), 1e-12)
            moved[some] = False
        return np.clip(here.U[rows] - length[:, None] * ways[rows], -1, 1)

    def evaluate(rows: NDArray[np.intp], U: Array) -> tuple[Array, NDArray[np.bool_]]:
        nonlocal tried
        tried = candidate.at(U, here.Q[rows])
        jump = np.abs(tried.Q - here.Q[rows]).max(axis=1)
        return _least_of(quantities, which[rows], tried), jump < _JUMP

    def accepted(rows: NDArray[np.intp], better: NDArray[np.bool_]) -> None:
        nonlocal here
        here = here.replaced(rows[better], rows_of(tried, better))
        moved[rows[better]] = True
        visited.append(tried.U[better | ~tried.found])

    U, value = here.U.copy(), _least_of(quantities, which, here)
    lengths = replace(_LENGTHS, shortest=shortest)
    descend_in_box(U, value, trial, evaluate, lengths, accepted=accepted)
    return np.concatenate([*visited, U])


def _least_of(quantities: Sequence[Quantity], which: NDArray[np.intp], at: Points) -> Array:
    """Evaluate one quantity at each of K points: (K,).

    ``which`` (K,) has for each point the index of its quantity in ``quantities``.
    """
    values = np.empty(len(which))
    for i, quantity in enumerate(quantities):
        own = which == i
        if own.any():
            values[own] = quantity.least(rows_of(at, own))
    return values


def _slopes_of(
    quantities: Sequence[Quantity],
    candidate: CandidateFunction,
    which: NDArray[np.intp],
    at: Points,
    values: Array,
) -> Array:
    """Evaluate the gradient of one quantity at each of K points, with respect to u: (K, k).

    ``which`` (K,) has for each point the index of its quantity in ``quantities``, and ``values``
    (K,) has the value of this quantity at the point.
    """
    slope, rest = np.empty_like(at.U), np.ones(len(which), bool)
    for i, quantity in enumerate(quantities):
        own = which == i
        exact = quantity.slope(candidate, rows_of(at, own)) if own.any() else None
        if exact is not None:
            slope[own] = exact
            rest &= ~own
    if rest.any():
        each = partial(_least_of, quantities, np.repeat(which[rest], at.U.shape[1]))
        slope[rest] = differences(candidate, rows_of(at, rest), values[rest], each)
    return slope
