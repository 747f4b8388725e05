"""Evaluation of an inverse function over its cell, on poses that the fit did not use.

Formulas use ∂F = ∂F/∂u, with u the coordinates of the cell, E = ∂x/∂u, and C = (EᵀE)^(−1/2), so
that ∂F C and G_d E C are in joint speed per unit of task speed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...arguments import Array, read_only
from ...model.bodies import bodies_of
from ...redundancy import leaf_margin
from ...strategies.strategy import Inverse
from .cell import Cell
from .chart import Chart, Points
from .failures import FailureReason, broken_limit, folded, touching, unreached
from .kinematics import null_bases, solved
from .margins import (
    CandidateFunction,
    LeafMargin,
    distances_of,
    leaf_margins,
    limits_of,
    lowest_distances,
    searched,
    singular_values_of,
    slope_by_differences,
)
from .turning import Turn, expanded

_BLOCK = 4096
_BODIES = 1024
"""Number of held-out poses at which body distances are computed, 0.25 ms each."""

_QUICK_BODIES = 64
"""Number of held-out poses at which a quick evaluation computes body distances."""

_BODY_STARTS, _SPEED_STARTS = 6, 16
"""Numbers of starting poses of the searches for smaller body distances, and for larger joint speeds
and smaller leaf margins."""

_SPREAD = 0.3
"""Minimum distance in u between the starting poses of these searches."""

_REGULAR = 1e-10
"""Value of (σ_min / σ_max)² of J above which joint speeds are evaluated in a search."""

_FOLDED = 0.05
"""Value of σ_min(Nᵀ n̂_ref) below which a function counts as folded."""


@dataclass(frozen=True)
class Evaluation:
    """Figures of a function F over a cell, evaluated on held-out poses.

    The figures of joint speed refer to the poses that the function covers. ∂F = ∂F/∂u, E = ∂x/∂u
    and C = (EᵀE)^(−1/2), with u the coordinates of the cell.

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
        Minimum distance of a joint to its limit, rad or m: over the held-out poses, and over these
        and all poses visited by a search for smaller margins.
    attainable_margin, attainable_margin_worst : float
        Largest limit margin on any leaf, rad or m, at the pose of ``limit_margin`` and at that of
        ``limit_margin_worst``. If it equals that margin, no leaf with a larger one was found.
    smallest_singular_value : float
        Minimum σ_min of J, by search.
    body_distance : float
        Minimum distance between bodies of the robot and its surroundings, m, see
        :class:`rp.Bodies`. It is evaluated at the first 1024 held-out poses and the corners, and if
        no bodies collide there, by a search from the smallest distances; infinite if no bodies move
        relative to each other.
    nearest_bodies : (str, str)
        Links of the two bodies with this distance; ("", "") if there are no bodies.
    leaf_margin : float
        Minimum leaf margin ``σ_min(Nᵀ V̂) = 1 / ‖I − G J‖₂``, by search; V are the gradients of the
        potentials of which F is a leaf. Its inverse, less 1, is the extra joint speed over J⁺ in
        the worst direction. Files of before hold ``σ_min(Nᵀ n̂_ref)``, which is larger, and are
        read without it: NaN.
    residual : float
        Maximum task error, m or rad.
    coverage : float
        Fraction of the held-out poses at which F has a configuration inside the limits, connected
        to the middle of the cell without a fold. Collisions do not reduce it, but are listed in
        ``failures``.
    failures : tuple of FailureReason
        Reasons why the function fails at some poses: held-out ones, corners, or poses found by
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
        """True if F has a configuration inside the limits at every evaluated pose."""
        stopped = any(stop.cause != "collision" for stop in self.failures)
        return self.coverage == 1.0 and self.limit_margin_worst >= 0 and not stopped

    @property
    def covered(self) -> str:
        """Coverage as text: ``100 %`` only if no failure but collisions was found at any pose."""
        if self.everywhere:
            return "100 %"
        if self.coverage == 1.0:
            return "all held-out poses, but not every pose of the cell"
        return f"{np.floor(1e4 * self.coverage) / 100:.2f} % of the held-out poses"


@dataclass(frozen=True, eq=False)
@read_only
class _Speeds:
    """Joint speeds of a function at K poses, per unit of task speed, and distances from
    singularities.

    Attributes
    ----------
    difference, own, desired_square : (K,) arrays
        ``‖(∂F − G_d E) C‖_F²``, ``‖∂F C‖_F²`` and ``‖G_d E C‖_F²``; NaN at singularities.
    smallest, upright, leaf : (K,) arrays
        σ_min of J, ``σ_min(Nᵀ n̂_ref)``, which is 0 where the function folds, and the leaf margin.
    side : (K,) array
        Sign of det [J; n_refᵀ]; it changes where the function folds.
    direction : (K,) array
        ``max_ẋ ‖∂F/∂x ẋ‖² / ‖G_d ẋ‖²``; NaN at singularities.
    """

    difference: Array
    own: Array
    desired_square: Array
    smallest: Array
    upright: Array
    leaf: Array
    side: Array
    direction: Array

    @property
    def ratio(self) -> Array:
        """Squared joint speed relative to G_d: ``‖∂F C‖_F² / ‖G_d E C‖_F²``, (K,)."""
        return np.asarray(self.own / self.desired_square, float)


def speeds(desired: Inverse, chart: Chart, at: Points) -> _Speeds:
    """Evaluate the joint speeds of the function s = 0 of a chart at configurations on it."""
    K = len(at.U)
    J_V = np.concatenate([at.J, np.swapaxes(at.n_ref, 1, 2)], axis=1)
    N, s = null_bases(at.J, at.n_ref)
    upright = leaf_margin(N, at.n_ref)
    sound = at.found & (s[:, -1] > 1e-5 * s[:, 0]) & (upright > 1e-6)
    four = np.full((4, K), np.nan)
    if sound.any():
        own, desired_square = _joint_speeds(desired, chart, at.chosen(sound))
        four[:3, sound] = [
            (x**2).sum(axis=(1, 2)) for x in (own - desired_square, own, desired_square)
        ]
        four[3, sound] = _largest_ratio(own, desired_square)
    return _Speeds(
        four[0],
        four[1],
        four[2],
        s[:, -1],
        upright,
        leaf_margins(chart, at),
        np.sign(np.linalg.det(J_V)),
        four[3],
    )


def _joint_speeds(desired: Inverse, chart: Chart, at: Points) -> tuple[Array, Array]:
    """Evaluate ∂F C and G_d E C (K, n, k + l) of the function s = 0 at configurations on it."""
    cell = chart.cell
    dF, _ = chart.derivative(at, np.zeros((len(at.U), cell.task.r, cell.k)))
    C = cell.speeds(at.U)
    return dF @ C, desired.batch(at.Q, at.J) @ cell.twists(at.U, at.R) @ C


def _largest_ratio(A: Array, B: Array) -> Array:
    """Evaluate ``max_v ‖A v‖² / ‖B v‖²`` (K,) of pairs of matrices (K, n, k).

    With ``BᵀB = L Lᵀ`` it is the largest eigenvalue of ``L⁻¹ AᵀA L⁻ᵀ``.
    """
    L = np.asarray(np.linalg.cholesky(np.swapaxes(B, 1, 2) @ B), float)
    Lt_over_A = solved(L, np.swapaxes(A, 1, 2))
    return np.asarray(
        np.linalg.eigvalsh(Lt_over_A @ np.swapaxes(Lt_over_A, 1, 2))[:, -1], float
    )


@dataclass(frozen=True)
class _SpeedRatio:
    """Joint speed of G_d divided by that of the function s = 0, squared; a search minimises it.

    Attributes
    ----------
    desired : Inverse
        G_d.
    chart : Chart
        Chart of the function.
    direction : bool
        True if the ratio is that for the worst direction of ẋ, instead of the rms over directions.
    """

    desired: Inverse
    chart: Chart
    direction: bool

    def least(self, at: Points) -> Array:
        """Evaluate the squared ratio (K,); infinite where the function does not exist."""
        ratio = np.full(len(at.U), np.inf)
        squares = np.linalg.eigvalsh(at.J @ np.swapaxes(at.J, 1, 2))
        found = np.flatnonzero(at.found & (squares[:, 0] > _REGULAR * squares[:, -1]))
        if not len(found):
            return ratio
        own, desired = _joint_speeds(self.desired, self.chart, at.chosen(found))
        finite = np.isfinite(own).all(axis=(1, 2))
        found, own, desired = found[finite], own[finite], desired[finite]
        if self.direction:
            ratio[found] = 1 / _largest_ratio(own, desired)
        else:
            ratio[found] = (desired**2).sum(axis=(1, 2)) / (own**2).sum(axis=(1, 2))
        return np.where(np.isfinite(ratio), ratio, np.inf)

    def slope(self, candidate: CandidateFunction, at: Points) -> Array:
        """Evaluate the gradient (K, k) of the squared ratio with respect to u, by differences.

        It is 0 where the function does not exist.
        """
        return slope_by_differences(self, candidate, at)


@dataclass(frozen=True, eq=False)
@read_only
class _Sampled:
    """Configurations and figures of a candidate function at K poses.

    Attributes
    ----------
    U, Q : (K, k) and (K, n) arrays
        Poses, in coordinates of the cell, and configurations.
    speeds : Speeds
        Joint speeds.
    residual, limit_margin : (K,) arrays
        Task error, m or rad, and smallest joint-limit margin, rad or m.
    ok, sheet : (K,) arrays of bool
        ``ok`` is True if the function exists at the pose. ``sheet`` is True if no fold
        separates the pose from the middle of the cell: the same sign of det [J; n_refᵀ], and
        ``σ_min(Nᵀ n̂_ref)`` above 0.05.
    """

    U: Array
    Q: Array
    speeds: _Speeds
    residual: Array
    limit_margin: Array
    ok: NDArray[np.bool_]
    sheet: NDArray[np.bool_]


def _sampled(
    desired: Inverse, candidate: CandidateFunction, U: Array, side: float
) -> _Sampled:
    """Evaluate a candidate function at poses U (K, k).

    ``side`` is the sign of det [J; n_refᵀ] in the middle of the cell.
    """
    parts, found = [], []
    for start in range(0, len(U), _BLOCK):
        parts.append(candidate.at(U[start : start + _BLOCK]))
        found.append(speeds(desired, candidate.chart, parts[-1]))
    every = _Speeds(
        *(
            np.concatenate([getattr(x, name) for x in found])
            for name in _Speeds.__dataclass_fields__
        )
    )
    Q, ok, residual = (
        np.concatenate([getattr(x, name) for x in parts])
        for name in ("Q", "found", "residual")
    )
    ok &= np.isfinite(every.own)
    margin = candidate.chart.cell.limit_margin(Q).min(axis=1)
    return _Sampled(
        U,
        Q,
        every,
        residual,
        margin,
        ok,
        ok & (every.side == side) & (every.upright > _FOLDED),
    )


def evaluate_cell(
    desired: Inverse, chart: Chart, count: int, seed: int, *, quick: bool
) -> Evaluation:
    """Measure a cell's function F on held-out poses: coverage, cost, joint speeds and margins.

    The poses are ``count`` Sobol points, the corners of the cell, and poses found by search.

    The held-out poses are Sobol points. A quick evaluation searches neither for the largest joint
    speeds nor for the smallest distances between bodies.
    """
    cell, candidate, limits = (
        chart.cell,
        CandidateFunction.zero(chart),
        limits_of(chart.cell),
    )
    middle = candidate.at(np.zeros((1, cell.k)))
    side = float(speeds(desired, chart, middle).side[0])
    at = _sampled(
        desired,
        candidate,
        np.concatenate([cell.sample(count, seed), cell.corners()]),
        side,
    )
    U, every, held_out = at.U, at.speeds, slice(count)
    covered = at.sheet & (at.limit_margin >= 0)
    c = covered[held_out]
    low = _sampled(desired, candidate, _searched(desired, candidate, at, quick), side)
    failures = _failures(
        cell,
        at,
        low,
        np.concatenate([middle.Q, at.Q[covered][:: max(1, len(U) // 7)][:7]]),
    )
    if not c.any():
        figures: dict[str, Any] = dict.fromkeys(
            Evaluation.__dataclass_fields__, float("nan")
        )
        figures |= {"nearest_bodies": ("", ""), "coverage": 0.0, "failures": failures}
        return Evaluation(**figures)
    distance, links, stop = _bodies(candidate, at, covered, count, quick)
    worst = int(np.argmin(np.where(low.sheet, low.limit_margin, np.inf)))
    lowest = int(np.argmin(np.where(at.sheet, at.limit_margin, np.inf)[held_out]))
    least = float(at.limit_margin[lowest])
    most = limits.attainable(
        chart, candidate.at(np.stack([U[lowest], low.U[worst]])), far=True
    )
    difference, own, desired_square = (
        every.difference[held_out][c],
        every.own[held_out][c],
        every.desired_square[held_out][c],
    )
    ratio = own.mean() / desired_square.mean()
    spread = (
        (own - ratio * desired_square).std() / desired_square.mean() / np.sqrt(len(own))
    )  # of a ratio of means
    both = [(x, x.sheet & (x.limit_margin >= 0)) for x in (at, low)]

    def most_of(name: str) -> float:
        """Return the maximum of an attribute of :class:`_Speeds`, a squared ratio of joint speeds,
        as extra joint speed: its square root minus 1."""
        largest = max(
            getattr(x.speeds, name)[good].max(initial=0.0) for x, good in both
        )
        return float(np.sqrt(largest) - 1)

    return Evaluation(
        cost=float(difference.mean()),
        cost_error=float(difference.std() / np.sqrt(len(difference))),
        extra_speed=float(np.sqrt(ratio) - 1),
        extra_speed_error=float(spread / (2 * np.sqrt(ratio))),
        extra_speed_worst=most_of("ratio"),
        extra_speed_direction=most_of("direction"),
        limit_margin=least,
        attainable_margin=float(most[0]),
        attainable_margin_worst=float(most[1]),
        smallest_singular_value=float(
            min(x.speeds.smallest[good].min(initial=np.inf) for x, good in both)
        ),
        body_distance=distance,
        nearest_bodies=links,
        leaf_margin=float(
            min(x.speeds.leaf[good].min(initial=np.inf) for x, good in both)
        ),
        residual=float(at.residual[held_out][c].max()),
        coverage=float(c.mean()),
        failures=failures if stop is None else (*failures, stop),
        limit_margin_worst=min(least, float(low.limit_margin[worst])),
    )


def _searched(
    desired: Inverse, candidate: CandidateFunction, at: _Sampled, quick: bool
) -> Array:
    """Search for poses with smaller limit margins, smaller σ_min(J), smaller leaf margins, and
    larger joint speeds.

    The searches start from the worst of the sampled poses. Return all poses visited (L, k). A quick
    evaluation does not search for leaf margins and joint speeds.
    """
    limits, singular = (
        limits_of(candidate.chart.cell),
        singular_values_of(candidate.chart.cell.task),
    )
    U, speeds = at.U[at.sheet], at.speeds
    near = np.argsort(at.limit_margin[at.sheet])[: limits.starts]
    tried = [
        searched(
            candidate, limits, np.concatenate([np.zeros((1, U.shape[1])), U[near]])
        )
    ]
    tried.append(
        searched(
            candidate,
            singular,
            U[np.argsort(speeds.smallest[at.sheet])[: singular.starts]],
        )
    )
    if not quick:
        for direction, ratio in ((False, speeds.ratio), (True, speeds.direction)):
            start = _worst(-ratio[at.sheet], U, _SPEED_STARTS)
            tried.append(
                searched(
                    candidate, _SpeedRatio(desired, candidate.chart, direction), start
                )
            )
        start = _worst(speeds.leaf[at.sheet], U, _SPEED_STARTS)
        tried.append(searched(candidate, LeafMargin(candidate.chart), start))
    return np.concatenate(tried)


def _worst(values: Array, U: Array, count: int) -> Array:
    """Select the rows of U (K, k) with the lowest values (K,), at most ``count`` of them.

    Selected rows differ from each other by more than 0.3 in some coordinate.
    """
    kept: list[Array] = []
    for u in U[np.argsort(values)]:
        if all(np.abs(u - other).max() > _SPREAD for other in kept):
            kept.append(u)
        if len(kept) == count:
            break
    return np.array(kept).reshape(-1, U.shape[1])


def _failures(
    cell: Cell, at: _Sampled, low: _Sampled, near: Array
) -> tuple[FailureReason, ...]:
    """Return the reasons why the function fails, at sampled poses and at poses found by search.

    ``near`` (L, n) are configurations from which a reachability test starts. The ``share`` of each
    reason refers to the sampled poses.
    """
    U, Q = (
        np.concatenate([getattr(x, name) for x in (at, low)]) for name in ("U", "Q")
    )
    ok, sheet = (
        np.concatenate([getattr(x, name) for x in (at, low)])
        for name in ("ok", "sheet")
    )
    failures = [
        broken_limit(
            cell, U[sheet], Q[sheet], float((at.sheet & (at.limit_margin < 0)).mean())
        ),
        *unreached(cell, U[~ok], near, float((~at.ok).mean())),
        folded(cell, U[ok & ~sheet], float((at.ok & ~at.sheet).mean())),
    ]
    return tuple(stop for stop in failures if stop)


def _bodies(
    candidate: CandidateFunction,
    at: _Sampled,
    covered: NDArray[np.bool_],
    count: int,
    quick: bool,
) -> tuple[float, tuple[str, str], FailureReason | None]:
    """Compute the minimum body distance over covered poses of the cell.

    Return the distance, m, the two links, and the failure by collision; None without collision.
    """
    cell, margin, bodies = (
        candidate.chart.cell.whole,
        distances_of(candidate.chart.cell.task),
        bodies_of(candidate.chart.cell.task),
    )
    first = min(count, _QUICK_BODIES if quick else _BODIES)
    checked = np.concatenate([np.arange(first), np.arange(count, len(at.U))])
    checked = checked[covered[checked]]
    U, Q, candidate = _all_round(candidate, at.U[checked], at.Q[checked])
    distances, share = lowest_distances(bodies, Q, quick=quick)
    least = float(distances.min())
    if 0 <= least < np.inf and not quick:
        ends = searched(candidate, margin, _worst(distances, U, _BODY_STARTS))[
            -_BODY_STARTS:
        ]
        nearer = candidate.at(ends)
        inside = nearer.found & (cell.task.limit_margin(nearer.Q).min(axis=1) >= 0)
        U, Q = (
            np.concatenate([U, nearer.U[inside]]),
            np.concatenate([Q, nearer.Q[inside]]),
        )
        distances = np.concatenate([distances, bodies.distances(nearer.Q[inside])])
    links = bodies.nearest(Q[int(np.argmin(distances))]).links
    return float(distances.min()), links, touching(cell, U, distances, links, share)


def _all_round(
    candidate: CandidateFunction, U: Array, Q: Array
) -> tuple[Array, Array, CandidateFunction]:
    """Move poses by random amounts along the symmetric coordinates of a sector.

    Body distances, unlike other figures, depend on these coordinates. Return the coordinates in the
    sector with all its coordinates, the configurations (K, n), and the candidate function over that
    sector. In other cells nothing is changed.
    """
    cell, chart = candidate.chart.cell, expanded(candidate.chart)
    U = np.array([cell._lifted(u) for u in U]).reshape(-1, cell.whole.k)
    removed = np.flatnonzero(np.isin(cell.whole.moved, cell._removed))
    if not len(removed):
        return U, Q, candidate
    U[:, removed] = np.random.default_rng(5).uniform(-1, 1, (len(U), len(removed)))
    return U, Q + cell._split(U)[1], CandidateFunction.zero(chart)
