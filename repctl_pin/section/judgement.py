"""What a function of a cell is worth, on poses that it was not fitted to."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array
from ..redundancy import leaf_margin
from ..robot.bodies import bodies_of
from ..strategies.strategy import Batched
from .chart import Chart, Points
from .kinematics import bases
from .margins import Margin, Section, distances_of, limits_of, searched
from .stops import Stop, broken_limit, folded, touching, unreached

_BLOCK = 4096
_BODIES = 1024
"""Held-out poses at which distances between bodies are measured: each takes a quarter of a millisecond."""

_NEAR = 0.05
"""A distance between bodies, m, below which still nearer ones are searched for."""

_FOLDED = 0.05
"""The leaf margin at which a section counts as folded."""


@dataclass(frozen=True)
class Judgement:
    """Figures on held-out poses. Those of speed are over the poses that the function covers.

    Attributes
    ----------
    cost, cost_error : float
        ``mean ‖(∂F − G_d E) C‖²``, and its standard error.
    extra_speed, extra_speed_error : float
        ``√(mean ‖∂F C‖² / mean ‖G_d E C‖²) − 1``, and its standard error.
    extra_speed_worst : float
        The largest ``‖∂F C‖ / ‖G_d E C‖ − 1`` of one pose.
    limit_margin, limit_margin_worst : float
        The least distance of a joint to its limit, rad or m: at the held-out poses, and at the worst pose that a search
        from the lowest of them, and from the corners, has found.
    attainable_margin, attainable_margin_worst : float
        What the best of the leaves beside it has at the lowest of the held-out poses, and at that worst pose: where it
        is no larger, the arm sets the margin.
    smallest_singular_value : float
        The least σ_min of J.
    body_distance : float
        The least distance between bodies, the robot's own and those of its surroundings, m, on the first 1024 poses,
        the corners, and poses that a search from there has found: see :class:`rp.Bodies`; infinite where there are
        none that move against each other.
    nearest_bodies : (str, str)
        Whose they are; ("", "") where there are none.
    leaf_margin : float
        The least ``σ_min(Nᵀ n̂_ref)``.
    residual : float
        The largest task error, m or rad.
    coverage : float
        The share of poses with joints inside the limits, on one sheet. Bodies that touch are among the stops, and
        do not count here.
    stops : tuple of Stop
        What stops it elsewhere, and at the corners.
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
    stops: tuple[Stop, ...]
    limit_margin_worst: float

    @property
    def everywhere(self) -> bool:
        """Whether no pose was found, held-out or by search, without joints inside the limits."""
        return self.coverage == 1.0 and self.limit_margin_worst >= 0


@dataclass(frozen=True)
class Speeds:
    """Joint speeds at points of a section, per unit of task speed, and where the section is sound.

    Attributes
    ----------
    difference, own, wanted : (K,) arrays
        ``‖(∂F − G_d E) C‖²``, ``‖∂F C‖²`` and ``‖G_d E C‖²``; NaN where it is not sound.
    smallest, leaf : (K,) arrays
        σ_min of J, and the leaf margin.
    side : (K,) array
        The sign of det [J; n_refᵀ].
    """

    difference: Array
    own: Array
    wanted: Array
    smallest: Array
    leaf: Array
    side: Array


def speeds(desired: Batched, chart: Chart, at: Points) -> Speeds:
    """Measure the section s = 0 at points of it."""
    cell, K, r = chart.cell, len(at.U), chart.cell.task.r
    J_V = np.concatenate([at.J, np.swapaxes(at.n_ref, 1, 2)], axis=1)
    _, N, s = bases(at.J, at.n_ref)
    leaf = leaf_margin(N, at.n_ref)
    sound = at.found & (s[:, -1] > 1e-5 * s[:, 0]) & (leaf > 1e-6)
    three = np.full((3, K), np.nan)
    if sound.any():
        good = at.chosen(sound)
        dF, _ = chart.derivative(good, np.zeros((len(good.U), r, cell.k)))
        C = cell.speeds(good.U)
        wanted = desired.batch(good.Q, good.J) @ cell.twists(good.U, good.R) @ C
        own = dF @ C
        three[:, sound] = [(x**2).sum(axis=(1, 2)) for x in (own - wanted, own, wanted)]
    return Speeds(three[0], three[1], three[2], s[:, -1], leaf, np.sign(np.linalg.det(J_V)))


@dataclass(frozen=True)
class _Looked:
    """A section at some poses.

    Attributes
    ----------
    U, Q : (K, k) and (K, n) arrays
    speeds : Speeds
    residual, room : (K,) arrays
        The task error, and the least joint-limit margin.
    ok, sheet : (K,) arrays of bool
        Where it exists, and where it is the sheet of the middle.
    """

    U: Array
    Q: Array
    speeds: Speeds
    residual: Array
    room: Array
    ok: NDArray[np.bool_]
    sheet: NDArray[np.bool_]


def _look(desired: Batched, section: Section, U: Array, side: float) -> _Looked:
    """Look at a section at poses U (K, k)."""
    parts, found = [], []
    for start in range(0, len(U), _BLOCK):
        parts.append(section.at(U[start : start + _BLOCK]))
        found.append(speeds(desired, section.chart, parts[-1]))
    every = Speeds(*(np.concatenate([getattr(x, name) for x in found]) for name in Speeds.__dataclass_fields__))
    Q, ok, residual = (np.concatenate([getattr(x, name) for x in parts]) for name in ("Q", "found", "residual"))
    ok &= np.isfinite(every.own)
    room = section.chart.cell.task.limit_margin(Q).min(axis=1)
    return _Looked(U, Q, every, residual, room, ok, ok & (every.side == side) & (every.leaf > _FOLDED))


def judge(desired: Batched, chart: Chart, count: int, seed: int) -> Judgement:
    """Judge the section s = 0 of a chart on Sobol points, and on the cell's corners for what stops it."""
    cell, section, limits = chart.cell, Section.zero(chart), limits_of(chart.cell.task)
    middle = section.at(np.zeros((1, cell.k)))
    side = float(speeds(desired, chart, middle).side[0])
    at = _look(desired, section, np.concatenate([cell.sample(count, seed), cell.corners()]), side)
    U, every, held_out = at.U, at.speeds, slice(count)
    covered = at.sheet & (at.room >= 0)
    c = covered[held_out]
    near = np.concatenate([middle.Q, at.Q[covered][:: max(1, len(U) // 7)][:7]])
    start = np.concatenate([middle.U, U[at.sheet][np.argsort(at.room[at.sheet])[: limits.starts]]])
    low = _look(desired, section, _lowest(section, limits, start), side)
    beyond = np.concatenate([U[at.sheet], low.U[low.sheet]]), np.concatenate([at.Q[at.sheet], low.Q[low.sheet]])
    stops = [
        broken_limit(cell, *beyond, float((at.sheet & ~covered).mean())),
        *unreached(cell, U[~at.ok], near, len(U)),
        folded(cell, U[at.ok & ~at.sheet], len(U)),
    ]
    if not c.any():
        nothing = float("nan")
        none = dict.fromkeys(Judgement.__dataclass_fields__, nothing)
        return Judgement(**none | {"nearest_bodies": ("", ""), "coverage": 0.0, "stops": tuple(s for s in stops if s)})  # type: ignore[arg-type]
    distances, links, stop = _bodies(section, at, covered, count)
    stops.append(stop)
    worst = int(np.argmin(np.where(low.sheet, low.room, np.inf)))
    lowest = int(np.argmin(np.where(at.sheet, at.room, np.inf)[held_out]))
    least = float(at.room[lowest])
    most = limits.attainable(chart, section.at(np.stack([U[lowest], low.U[worst]])), far=True)
    difference, own, wanted = every.difference[held_out][c], every.own[held_out][c], every.wanted[held_out][c]
    ratio = own.mean() / wanted.mean()
    spread = (own - ratio * wanted).std() / wanted.mean() / np.sqrt(len(own))  # of a ratio of means
    return Judgement(
        cost=float(difference.mean()),
        cost_error=float(difference.std() / np.sqrt(len(difference))),
        extra_speed=float(np.sqrt(ratio) - 1),
        extra_speed_error=float(spread / (2 * np.sqrt(ratio))),
        extra_speed_worst=float(np.sqrt((own / wanted).max()) - 1),
        limit_margin=least,
        attainable_margin=float(most[0]),
        attainable_margin_worst=float(most[1]),
        smallest_singular_value=float(every.smallest[held_out][c].min()),
        body_distance=float(distances),
        nearest_bodies=links,
        leaf_margin=float(every.leaf[held_out][c].min()),
        residual=float(at.residual[held_out][c].max()),
        coverage=float(c.mean()),
        stops=tuple(s for s in stops if s),
        limit_margin_worst=min(least, float(low.room[worst])),
    )


def _lowest(section: Section, margin: Margin, U: Array) -> Array:
    """Where a search from poses U (K, k) down a margin ends: (L, k), U itself among them."""
    return np.concatenate([U, searched(section, margin, U)[-len(U) :]])


def _bodies(
    section: Section, at: _Looked, covered: NDArray[np.bool_], count: int
) -> tuple[float, tuple[str, str], Stop | None]:
    """Measure the least distance between bodies, and whose they are; where they touch."""
    cell, margin, bodies = section.chart.cell, distances_of(section.chart.cell.task), bodies_of(section.chart.cell.task)
    looked_at = np.concatenate([np.arange(min(count, _BODIES)), np.arange(count, len(at.U))])
    looked_at = looked_at[covered[looked_at]]
    U, Q = at.U[looked_at], at.Q[looked_at]
    distances = bodies.distances(Q)
    share = float((distances < 0).mean())
    if distances.min() < _NEAR:
        nearer = section.at(_lowest(section, margin, U[np.argsort(distances)[: margin.starts]]))
        inside = nearer.found & (cell.task.limit_margin(nearer.Q).min(axis=1) >= 0)
        U, Q = np.concatenate([U, nearer.U[inside]]), np.concatenate([Q, nearer.Q[inside]])
        distances = np.concatenate([distances, bodies.distances(nearer.Q[inside])])
    links = bodies.nearest(Q[int(np.argmin(distances))]).links
    return float(distances.min()), links, touching(cell, U, distances, links, share)
