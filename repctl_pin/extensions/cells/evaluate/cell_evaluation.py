"""Evaluation of an inverse function over its cell, on poses that the fit did not use.

The function q = F(x) gives one configuration for each pose of the cell, a box of poses with
coordinates u from −1 to 1. Formulas use ∂F = ∂F/∂u, E = ∂x/∂u, and C = (EᵀE)^(−1/2), so that ∂F C
and G_d E C are joint speeds per unit of task speed. G_d is the desired inverse, such as J⁺.
E is the task velocity per unit of each coordinate u. Held-out poses are Sobol points of the cell
that the fit did not use.

A candidate function is written in a chart: s is its position along the self-motion at each pose,
and n_ref the approximate null space of J. At a fold, the leaf turns back along the self-motion, and
is no longer a function of the pose. A function covers a pose if it has a configuration there inside
the joint limits, and no fold separates the pose from the middle of the cell. The potentials of a
chart are equal to s. A leaf is a set of configurations with one value of s; the function F is the
leaf s = 0. A coordinate of a sector, which is a cell around an axis, is symmetric if a single joint
moves the frame along it. Extra joint speed is the joint speed relative to that of G_d, minus 1. The
leaf margin is the distance from an algorithmic singularity, at which the controller of the function
fails.

Letters: n joints, m task coordinates, r = n − m components of s, k coordinates u; K and L are
numbers of poses or configurations. N spans the null space of J; N, V̂ and n̂_ref have orthonormal
columns.

``CandidateFunction`` is a candidate for F: a chart, and the coefficients a of the label ``s(u) =
Σ_t a_t T_t(u)``, with monomials T_t. ``Sample`` is a function F evaluated at K poses of its cell:
configurations, joint speeds and margins. ``Points`` are the configurations Q (K, n) of F at K
poses, with the kinematics there. ``Chart`` is coordinates (u, s) of configurations: u gives the
pose, the label s (r,) the position along its self-motion. ``FailureReason`` is one reason why a
function fails at some poses of its cell: cause, share of the poses, worst pose. ``Turn`` is the
range, rad, over which a function can be used along a symmetric coordinate.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....base.arguments import Array
from ....model.bodies import bodies_of
from ....redundancy import leaf_margin
from ....strategies.strategy import Inverse
from ..chart.chart import Chart, Points
from ..geometry.cell import Cell
from ..geometry.kinematics import joined, null_bases, regular, rows_of, singular_values, solved
from .cell_failures import FailureReason, broken_limit, folded, touching, unreached
from .margins import (
    CandidateFunction,
    LeafMargin,
    Quantity,
    leaf_margins,
    limits_of,
    lowest_distances,
    nearest_by_pair,
    searched,
    singular_values_of,
)
from .reach import unlike_rows
from .symmetric_coordinates import Turn, expanded

_BLOCK = 4096
_BODIES = 1024
"""Number of held-out poses at which body distances are computed, 0.25 ms each."""

_QUICK_BODIES = 64
"""Number of held-out poses at which a quick evaluation computes body distances."""

_SPEED_STARTS = 16
"""Number of starting poses of the searches for larger joint speeds and smaller leaf margins."""

_SPREAD = 0.3
"""Minimum distance in u between the starting poses of these searches."""

_REGULAR = 1e-5
"""Value of σ_min / σ_max of J above which joint speeds are evaluated in a search."""

_FOLDED = 0.05
"""Value of σ_min(Nᵀ n̂_ref) below which a function counts as folded."""


@dataclass(frozen=True)
class Evaluation:
    """Figures of a function F over a cell, on held-out poses and on poses found by search.

    F gives one configuration for each pose of the cell; G_d is the desired inverse, such as J⁺. A
    mean is taken over the held-out poses that F covers. A minimum or maximum "by search" is taken
    over the held-out poses that F covers, the corners, and the poses that a search for worse values
    visited. ∂F = ∂F/∂u, E = ∂x/∂u and C = (EᵀE)^(−1/2), with u the coordinates of the cell. All
    figures but ``coverage`` are NaN if F covers no held-out pose.

    Attributes
    ----------
    cost, cost_error : float
        ``mean ‖(∂F − G_d E) C‖_F²``, and its standard error.
    extra_speed, extra_speed_error : float
        ``√(mean ‖∂F C‖_F² / mean ‖G_d E C‖_F²) − 1``, and its standard error.
    extra_speed_worst : float
        Maximum of ``‖∂F C‖_F / ‖G_d E C‖_F − 1`` over poses, by search.
    extra_speed_direction : float
        Maximum of ``‖∂F/∂x ẋ‖ / ‖G_d ẋ‖ − 1`` over poses and task velocities ẋ, by search; NaN in
        older files.
    limit_margin, limit_margin_worst : float
        Minimum distance of a joint from its limit, rad or m: over the held-out poses, and over
        these together with all poses that a search for smaller margins visited. Negative beyond the
        limit, infinite without limits. A joint that moves the frame along a symmetric coordinate
        with the range ``"all"`` is left out, because this range ends only at the limits of the
        joint. If the range is a full turn, :attr:`Turn.left` is the distance of the joint from its
        limits.
    attainable_margin, attainable_margin_worst : float
        Largest limit margin on any leaf, rad or m, at the pose of ``limit_margin`` and at that of
        ``limit_margin_worst``. Each equals the margin at its pose if no leaf with a larger margin
        was found.
    smallest_singular_value : float
        Minimum σ_min of J, by search.
    body_distance : float
        Minimum distance, m, between two links of the robot, or between a link and the surroundings,
        over the pairs that :class:`rp.Bodies` checks. It is evaluated at the first 1024 held-out
        poses and the corners. If no bodies collide there, the poses at which each pair is nearest
        are searched for. Infinite if no bodies move relative to each other.
    nearest_bodies : (str, str)
        Links of the two bodies with this distance; ("", "") if there are no bodies.
    leaf_margin : float
        Minimum leaf margin ``σ_min(Nᵀ V̂) = 1 / ‖I − G J‖₂``, by search; V are the gradients of the
        potentials of which F is a leaf. Its reciprocal minus 1 is the extra joint speed relative to
        J⁺ in the worst direction. NaN in older files, whose figure ``σ_min(Nᵀ n̂_ref)`` is larger
        and is not read.
    residual : float
        Maximum task error on the covered held-out poses, m or rad.
    coverage : float
        Fraction of the held-out poses at which F has a configuration inside the limits, connected
        to the middle of the cell without a fold. Collisions do not reduce it, but are listed in
        ``failures``.
    failures : tuple of FailureReason
        Reasons why the function fails at some poses: held-out poses, corners, or poses found by a
        search.
    turns : tuple of Turn
        Range of the function along the symmetric coordinates of a sector; empty in a box.
    """

    cost: float
    cost_error: float
    extra_speed: float
    extra_speed_error: float
    extra_speed_worst: float
    limit_margin: float
    attainable_margin: float
    attainable_margin_worst: float
    smallest_singular_value: float
    body_distance: float
    nearest_bodies: tuple[str, str]
    leaf_margin: float
    residual: float
    coverage: float
    failures: tuple[FailureReason, ...]
    limit_margin_worst: float
    extra_speed_direction: float = float("nan")
    turns: tuple[Turn, ...] = ()

    @property
    def everywhere(self) -> bool:
        """True if the function has a configuration inside the limits at every evaluated pose.

        Collisions do not count. If this is False, the function checks the limits at every call.
        """
        stopped = any(stop.cause != "collision" for stop in self.failures)
        return self.coverage == 1.0 and self.limit_margin_worst >= 0 and not stopped

    @property
    def covered(self) -> str:
        """Coverage as text, such as ``99.95 % of the held-out poses``.

        It is ``100 %`` only if the function covers the corners and the poses found by search, too.
        Collisions do not reduce it.
        """
        if self.everywhere:
            return "100 %"
        if self.coverage == 1.0:
            return "all held-out poses, but not every pose"
        return f"{np.floor(1e4 * self.coverage) / 100:.2f} % of the held-out poses"


class Sample(NamedTuple):
    """A function F at K poses of its cell: its configurations, joint speeds and margins there.

    F gives one configuration for each pose u; E = ∂x/∂u, C scales u to unit task speed, and G_d is
    the desired inverse. Joint speeds are per unit of task speed. They are NaN at singularities, at
    folds, and where F does not exist.

    Attributes
    ----------
    U, Q : (K, k) and (K, n) arrays
        Poses, in coordinates of the cell, and configurations.
    residual, limit_margin : (K,) arrays
        Task error, m or rad, and smallest joint-limit margin, rad or m.
    difference, own, desired_square : (K,) arrays
        ``‖(∂F − G_d E) C‖_F²``, ``‖∂F C‖_F²`` and ``‖G_d E C‖_F²``.
    direction : (K,) array
        ``max_ẋ ‖∂F/∂x ẋ‖² / ‖G_d ẋ‖²``.
    smallest, leaf : (K,) arrays
        σ_min of J, and the leaf margin.
    ok, sheet : (K,) arrays of bool
        ``ok`` is True if the function has a configuration and joint speeds at the pose. ``sheet``
        is True if, moreover, no fold is found between the pose and the middle of the cell: both
        have the same sign of det [J; n_refᵀ], and ``σ_min(Nᵀ n̂_ref)`` is above 0.05.
    """

    U: NDArray[Any]
    Q: NDArray[Any]
    residual: NDArray[Any]
    limit_margin: NDArray[Any]
    difference: NDArray[Any]
    own: NDArray[Any]
    desired_square: NDArray[Any]
    direction: NDArray[Any]
    smallest: NDArray[Any]
    leaf: NDArray[Any]
    ok: NDArray[Any]
    sheet: NDArray[Any]

    @property
    def ratio(self) -> Array:
        """Squared joint speed of F relative to that of G_d: ``‖∂F C‖_F² / ‖G_d E C‖_F²`` (K,)."""
        return np.asarray(self.own / self.desired_square, float)

    @property
    def covered(self) -> NDArray[np.bool_]:
        """True where F covers the pose, inside the limits and without a fold: (K,)."""
        return np.asarray(self.sheet & (self.limit_margin >= 0))


def sampled(
    desired: Inverse, candidate: CandidateFunction, U: Array, *, directions: bool = True
) -> Sample:
    """Evaluate a candidate function at the poses U (K, k), in coordinates of the cell.

    ``desired`` is G_d, with which joint speeds are compared. Without ``directions``, joint speeds
    in the worst direction and leaf margins are NaN; this saves a third of the time.
    """
    middle = candidate.at(np.zeros((1, U.shape[1])))
    parts = [U[start : start + _BLOCK] for start in range(0, len(U), _BLOCK)]
    side = _sides(middle)
    return joined([_block(desired, candidate, part, side, directions) for part in parts])


def _sides(at: Points) -> Array:
    """Evaluate the sign of det [J; n_refᵀ] at K points: (K,). The sign changes at a fold."""
    J_V = np.concatenate([at.J, np.swapaxes(at.n_ref, 1, 2)], axis=1)
    return np.asarray(np.sign(np.linalg.det(J_V)))


def _block(
    desired: Inverse, candidate: CandidateFunction, U: Array, side: Array, directions: bool
) -> Sample:
    """Evaluate a candidate function at some poses U (K, k) of a sample.

    ``side`` (1,) is the sign of det [J; n_refᵀ] in the middle of the cell; poses with the other
    sign are beyond a fold. Without ``directions``, joint speeds in the worst direction and leaf
    margins are NaN.
    """
    chart, at = candidate.chart, candidate.at(U)
    N, s = null_bases(at.J, at.n_ref), singular_values(at.J)
    upright = leaf_margin(N, at.n_ref)  # 0 where the function folds
    sound = at.found & (s[:, -1] > 1e-5 * s[:, 0]) & (upright > 1e-6)
    squares, leaf = np.full((4, len(U)), np.nan), np.full(len(U), np.nan)
    if sound.any():
        own, desired_own, _ = chart.joint_speeds(desired, rows_of(at, sound))
        for row, speeds in enumerate((own - desired_own, own, desired_own)):
            squares[row, sound] = (speeds**2).sum(axis=(1, 2))
        if directions:
            squares[3, sound] = _largest_ratio(own, desired_own)
    ok = at.found & np.isfinite(squares[1])
    sheet = ok & (_sides(at) == side) & (upright > _FOLDED)
    margin = chart.cell.limit_margin(at.Q).min(axis=1)
    if directions:
        leaf = leaf_margins(chart, at, N)
    figures = at.Q, at.residual, margin, *squares, s[:, -1], leaf, ok, sheet
    return Sample._make([U, *figures])


def _largest_ratio(A: Array, B: Array) -> Array:
    """Evaluate ``max_v ‖A v‖² / ‖B v‖²`` (K,) of pairs of matrices A and B (K, n, k).

    If A belongs to a function and B to the desired inverse, this is the squared ratio of their
    joint speeds in the worst direction. With ``BᵀB = L Lᵀ`` it is the largest eigenvalue of ``L⁻¹
    AᵀA L⁻ᵀ``.
    """
    L = np.asarray(np.linalg.cholesky(np.swapaxes(B, 1, 2) @ B), float)
    Lt_over_A = solved(L, np.swapaxes(A, 1, 2))
    return np.asarray(np.linalg.eigvalsh(Lt_over_A @ np.swapaxes(Lt_over_A, 1, 2))[:, -1], float)


@dataclass(frozen=True)
class _SpeedRatio(Quantity):
    """Squared ratio of the joint speed of G_d to that of the function s = 0, for :func:`searched`.

    Where it is smallest, the function has the largest extra joint speed.

    Attributes
    ----------
    desired : Inverse
        G_d.
    chart : Chart
        Chart of the function.
    direction : bool
        True for the ratio in the worst direction of ẋ, False for the rms over all directions.
    """

    desired: Inverse
    chart: Chart
    direction: bool

    def least(self, at: Points) -> Array:
        """Evaluate the squared ratio at K points: (K,), infinite where F does not exist.

        The ratio is also infinite where J is singular.
        """
        ratio = np.full(len(at.U), np.inf)
        found = np.flatnonzero(at.found)
        found = found[regular(at.J[found], _REGULAR)]
        if not len(found):
            return ratio
        own, desired, _ = self.chart.joint_speeds(self.desired, rows_of(at, found))
        finite = np.isfinite(own).all(axis=(1, 2))
        found, own, desired = found[finite], own[finite], desired[finite]
        if self.direction:
            ratio[found] = 1 / _largest_ratio(own, desired)
        else:
            ratio[found] = (desired**2).sum(axis=(1, 2)) / (own**2).sum(axis=(1, 2))
        return np.where(np.isfinite(ratio), ratio, np.inf)


def evaluate_cell(
    desired: Inverse, chart: Chart, count: int, seed: int, *, quick: bool, required: float = 0.0
) -> Evaluation:
    """Measure a cell's function F on held-out poses: coverage, cost, joint speeds and margins.

    ``desired`` is the inverse G_d with which F is compared; in ``chart``, F is s = 0. The poses are
    ``count`` held-out poses, drawn with ``seed``, corners of the cell, and poses found by searches
    for the smallest margins, the largest joint speeds and collisions. With ``quick``, only the
    limit margin and σ_min(J) are searched for; attainable margins, the leaf margin and the joint
    speed in the worst direction are NaN. A body distance below ``required``, m, is a failure
    with the cause ``collision``. The ``turns`` of the result, the ranges of F along symmetric
    coordinates, are empty: the fit adds them.
    """
    cell, candidate = chart.cell, CandidateFunction.zero(chart)
    U = np.concatenate([cell.sample(count, seed), cell.corners()])
    at = sampled(desired, candidate, U, directions=not quick)
    visited = _searched(desired, candidate, at, quick)
    low = sampled(desired, candidate, visited, directions=not quick)
    middle = candidate.at(np.zeros((1, cell.k)))
    some = at.Q[at.covered][:: max(1, len(U) // 7)][:7]
    failures = _failures(cell, at, low, np.concatenate([middle.Q, some]))
    held_out = rows_of(at, slice(count))
    inside = rows_of(held_out, held_out.covered)
    if not len(inside.U):
        return _nothing_covered(failures)
    distance, links, stop = _bodies(candidate, at, count, quick, required)
    tested = joined([at, low])
    tested = rows_of(tested, tested.covered)
    return Evaluation(
        **_speed_figures(inside, tested),
        **_limit_figures(candidate, held_out, low, quick),
        smallest_singular_value=float(tested.smallest.min()),
        body_distance=distance,
        nearest_bodies=links,
        leaf_margin=float(tested.leaf.min()),
        residual=float(inside.residual.max()),
        coverage=float(held_out.covered.mean()),
        failures=failures if stop is None else (*failures, stop),
    )


def _nothing_covered(failures: tuple[FailureReason, ...]) -> Evaluation:
    """Make the evaluation of a function that covers no held-out pose: coverage 0, figures NaN.

    The names of the nearest bodies are empty texts.
    """
    figures: dict[str, Any] = dict.fromkeys(Evaluation.__dataclass_fields__, float("nan"))
    figures |= {"nearest_bodies": ("", ""), "coverage": 0.0, "failures": failures, "turns": ()}
    return Evaluation(**figures)


def _speed_figures(inside: Sample, tested: Sample) -> dict[str, Any]:
    """Evaluate cost and extra joint speed: means over ``inside``, maxima over ``tested``.

    ``inside`` are the covered held-out poses. ``tested`` are all covered poses, including corners
    and poses found by searches. The keys are attributes of :class:`Evaluation`: the means ``cost``
    and ``extra_speed`` with their errors, and two maxima. ``extra_speed_worst`` is the maximum over
    poses, with the joint speeds of all directions of motion taken together;
    ``extra_speed_direction`` is the maximum over poses and directions.
    """
    root = np.sqrt(len(inside.U))
    desired_square = inside.desired_square.mean()
    ratio = inside.own.mean() / desired_square
    # of a ratio of means
    spread = (inside.own - ratio * inside.desired_square).std() / desired_square / root
    return {
        "cost": float(inside.difference.mean()),
        "cost_error": float(inside.difference.std() / root),
        "extra_speed": float(np.sqrt(ratio) - 1),
        "extra_speed_error": float(spread / (2 * np.sqrt(ratio))),
        "extra_speed_worst": float(np.sqrt(tested.ratio.max()) - 1),
        "extra_speed_direction": float(np.sqrt(tested.direction.max()) - 1),
    }


def _limit_figures(
    candidate: CandidateFunction, held_out: Sample, low: Sample, quick: bool
) -> dict[str, Any]:
    """Evaluate the smallest limit margin at held-out poses, and at the poses ``low``.

    The limit margin is the distance of the nearest joint from its limit, rad (m for prismatic
    joints). ``low`` are the poses that searches for the smallest margins visited. At the poses of
    both minima, also evaluate the largest limit margin on any leaf; with ``quick``, it is NaN. The
    keys are attributes of :class:`Evaluation`: ``limit_margin`` and ``attainable_margin`` at the
    held-out pose, ``limit_margin_worst`` and ``attainable_margin_worst`` at the pose from ``low``.
    """
    chart = candidate.chart
    worst = int(np.argmin(np.where(low.sheet, low.limit_margin, np.inf)))
    lowest = int(np.argmin(np.where(held_out.sheet, held_out.limit_margin, np.inf)))
    least = float(held_out.limit_margin[lowest])
    most = np.full(2, np.nan)
    if not quick:
        ends = candidate.at(np.stack([held_out.U[lowest], low.U[worst]]))
        most = limits_of(chart.cell).attainable(chart, ends, far=True)
    return {
        "limit_margin": least,
        "attainable_margin": float(most[0]),
        "attainable_margin_worst": float(most[1]),
        "limit_margin_worst": min(least, float(low.limit_margin[worst])),
    }


def _searched(desired: Inverse, candidate: CandidateFunction, at: Sample, quick: bool) -> Array:
    """Search for the poses of a cell at which a function's margins or joint speeds are worst.

    The margins are the limit margin, σ_min(J) and the leaf margin. Searches start from the worst of
    the sampled poses ``at``. Return the coordinates (L, k) of all poses that the searches visited.
    With ``quick``, neither leaf margins nor joint speeds are searched.
    """
    chart, at = candidate.chart, rows_of(at, at.sheet)
    limits, singular = limits_of(chart.cell), singular_values_of(chart.cell.task)
    middle, U = np.zeros((1, at.U.shape[1])), at.U
    starts: list[tuple[Quantity, Array]] = [
        (limits, np.concatenate([middle, _lowest(at.limit_margin, U, limits.starts)])),
        (singular, _lowest(at.smallest, U, singular.starts)),
    ]
    if not quick:
        for values, quantity in (
            (-at.ratio, _SpeedRatio(desired, chart, False)),
            (-at.direction, _SpeedRatio(desired, chart, True)),
            (at.leaf, LeafMargin(chart)),
        ):
            starts.append((quantity, _worst(values, U, _SPEED_STARTS)))
    return searched(candidate, *starts)


def _lowest(values: Array, U: Array, count: int) -> Array:
    """Select the rows of U (K, k) with the lowest values (K,), at most ``count`` of them."""
    return U[np.argsort(values)[:count]]


def _worst(values: Array, U: Array, count: int) -> Array:
    """Select at most ``count`` rows of U (K, k) with the lowest values (K,), not near each other.

    Selected rows differ from each other by more than 0.3 in some coordinate, so that searches from
    these rows do not all find the same pose.
    """
    ordered = U[np.argsort(values)]
    return ordered[unlike_rows(ordered, _SPREAD, count)]


def _failures(cell: Cell, at: Sample, low: Sample, near: Array) -> tuple[FailureReason, ...]:
    """Return the reasons why the function fails, at sampled poses and at poses found by search.

    ``at`` are the sampled poses, ``low`` those found by search. F has no configuration at some
    poses; ``near`` (L, n) are configurations from which Newton's method tries to reach these poses.
    The ``share`` of each reason is the fraction of the sampled poses that fail for it.
    """
    both = joined([at, low])
    on, folds = rows_of(both, both.sheet), rows_of(both, both.ok & ~both.sheet)
    violated = float((at.sheet & (at.limit_margin < 0)).mean())
    failures = [
        broken_limit(cell, on.U, on.Q, violated),
        *unreached(cell, both.U[~both.ok], near, float((~at.ok).mean())),
        folded(cell, folds.U, folds.Q, float((at.ok & ~at.sheet).mean())),
    ]
    return tuple(stop for stop in failures if stop)


def _bodies(
    candidate: CandidateFunction, at: Sample, count: int, quick: bool, required: float
) -> tuple[float, tuple[str, str], FailureReason | None]:
    """Compute the minimum body distance over covered poses of the cell.

    Return the distance, m, the two links at this distance, and the failure by collision, or None if
    the distance is at least ``required``, m. ``at`` has the ``count`` held-out poses, then the
    corners. Body distances are slow to compute: only the first 1024 held-out poses (64 if
    ``quick``) and the corners are evaluated. If nothing collides at these poses, and ``quick`` is
    False, a search follows for the poses at which each pair of bodies is nearest.
    """
    cell = candidate.chart.cell.whole
    bodies = bodies_of(cell.task)
    first = min(count, _QUICK_BODIES if quick else _BODIES)
    checked = np.concatenate([np.arange(first), np.arange(count, len(at.U))])
    checked = checked[at.covered[checked]]
    U, Q, candidate = _all_round(candidate, at.U[checked], at.Q[checked])
    distances, share = lowest_distances(bodies, Q, required=required, quick=quick)
    if 0 <= distances.min() < np.inf and not quick:
        nearer = candidate.at(nearest_by_pair(candidate, 5, float(distances.min())))
        U, Q = np.concatenate([U, nearer.U]), np.concatenate([Q, nearer.Q])
        distances = np.concatenate([distances, bodies.distances(nearer.Q)])
    links = bodies.nearest(Q[int(np.argmin(distances))]).links
    return float(distances.min()), links, touching(cell, U, distances, links, share, required)


def _all_round(
    candidate: CandidateFunction, U: Array, Q: Array
) -> tuple[Array, Array, CandidateFunction]:
    """Move covered poses by random amounts along the symmetric coordinates of a sector.

    A single joint moves the frame along such a coordinate, so U (K, k) and the function leave the
    coordinate out; but body distances depend on it. Return the moved poses (K, k + l), in
    coordinates that include the l symmetric ones, their configurations (K, n), and the candidate
    function of these coordinates. Without symmetric coordinates, the arguments are returned
    unchanged.
    """
    cell, chart = candidate.chart.cell, expanded(candidate.chart)
    U = cell._lifted(U)
    removed = np.flatnonzero(np.isin(cell.whole.moved, cell._removed))
    if not len(removed):
        return U, Q, candidate
    U[:, removed] = np.random.default_rng(5).uniform(-1, 1, (len(U), len(removed)))
    return U, Q + cell._split(U)[1], CandidateFunction.zero(chart)
