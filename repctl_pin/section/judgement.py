"""What a function of a cell is worth, on poses that it was not fitted to."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..redundancy import leaf_margin
from ..robot.bodies import bodies_of
from ..strategies.strategy import Batched
from .chart import Chart, Points, attainable
from .kinematics import bases
from .stops import Stop, broken_limit, folded, touching, unreached

Array = NDArray[np.float64]

_BLOCK = 4096
_BODIES = 1024
"""Held-out poses at which distances between bodies are measured: each takes a quarter of a millisecond."""

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
    limit_margin : float
        The least distance of a joint to its limit, rad or m.
    attainable_margin : float
        What the best of the leaves beside it has at that pose: where it is no larger, the arm itself sets the margin.
    smallest_singular_value : float
        The least σ_min of J.
    body_distance : float
        The least distance between bodies, the robot's own and those of its surroundings, m, on the first 1024 poses and
        the corners: see :class:`rp.Bodies`; infinite where there are none that move against each other.
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
    smallest_singular_value: float
    body_distance: float
    nearest_bodies: tuple[str, str]
    leaf_margin: float
    residual: float
    coverage: float
    stops: tuple[Stop, ...]


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


def speeds(desired: Batched, chart: Chart, at: Points, ds: Array | None = None) -> Speeds:
    """Measure a section at points of it."""
    cell, K, r = chart.cell, len(at.U), chart.cell.task.r
    J_V = np.concatenate([at.J, np.swapaxes(at.n_ref, 1, 2)], axis=1)
    _, N, s = bases(at.J, at.n_ref)
    leaf = leaf_margin(N, at.n_ref)
    sound = at.found & (s[:, -1] > 1e-5 * s[:, 0]) & (leaf > 1e-6)
    three = np.full((3, K), np.nan)
    if sound.any():
        good = at.chosen(sound)
        dF, _ = chart.derivative(good, np.zeros((len(good.U), r, cell.k)) if ds is None else ds[sound])
        C = cell.speeds(good.U)
        wanted = desired.batch(good.Q, good.J) @ cell.twists(good.U, good.R) @ C
        own = dF @ C
        three[:, sound] = [((x) ** 2).sum(axis=(1, 2)) for x in (own - wanted, own, wanted)]
    return Speeds(three[0], three[1], three[2], s[:, -1], leaf, np.sign(np.linalg.det(J_V)))


def judge(desired: Batched, chart: Chart, count: int, seed: int) -> Judgement:
    """Judge the section s = 0 of a chart on Sobol points, and on the cell's corners for what stops it."""
    cell = chart.cell
    U = np.concatenate([cell.sample(count, seed), cell.corners()])
    parts, found = [], []
    for start in range(0, len(U), _BLOCK):
        points = chart.solve(U[start : start + _BLOCK], np.zeros((len(U[start : start + _BLOCK]), cell.task.r)))
        parts.append(points)
        found.append(speeds(desired, chart, points))
    names = ("difference", "own", "wanted", "smallest", "leaf", "side")
    every = Speeds(*(np.concatenate([getattr(x, name) for x in found]) for name in names))
    Q, ok, residual = (np.concatenate([getattr(x, name) for x in parts]) for name in ("Q", "found", "residual"))
    middle = chart.solve(np.zeros((1, cell.k)), np.zeros((1, cell.task.r)))
    side = speeds(desired, chart, middle).side[0]
    room = cell.task.limit_margin(Q).min(axis=1)
    ok &= np.isfinite(every.own)
    sheet = ok & (every.side == side) & (every.leaf > _FOLDED)
    covered = sheet & (room >= 0)
    inner = slice(count)
    c = covered[inner]
    near = np.concatenate([middle.Q, Q[covered][:: max(1, len(U) // 7)][:7]])
    stops = [
        broken_limit(cell, U[sheet], Q[sheet], len(U)),
        *unreached(cell, U[~ok], near, len(U)),
        folded(cell, U[ok & ~sheet], len(U)),
    ]
    if not c.any():
        nothing = float("nan")
        none = dict.fromkeys(Judgement.__dataclass_fields__, nothing)
        return Judgement(**none | {"nearest_bodies": ("", ""), "coverage": 0.0, "stops": tuple(s for s in stops if s)})  # type: ignore[arg-type]
    bodies, looked_at = bodies_of(cell.task), np.concatenate([np.arange(min(count, _BODIES)), np.arange(count, len(U))])
    looked_at = looked_at[covered[looked_at]]
    distances = bodies.distances(Q[looked_at])
    nearest = bodies.nearest(Q[looked_at[int(np.argmin(distances))]])
    stops.append(touching(cell, U[looked_at], distances, nearest.links))
    tightest = int(np.argmin(np.where(sheet[inner], room[inner], np.inf)))
    most = attainable(chart, chart.solve(U[tightest][None], np.zeros((1, cell.task.r))))
    difference, own, wanted = every.difference[inner][c], every.own[inner][c], every.wanted[inner][c]
    ratio = own.mean() / wanted.mean()
    spread = (own - ratio * wanted).std() / wanted.mean() / np.sqrt(len(own))  # of a ratio of means
    return Judgement(
        cost=float(difference.mean()),
        cost_error=float(difference.std() / np.sqrt(len(difference))),
        extra_speed=float(np.sqrt(ratio) - 1),
        extra_speed_error=float(spread / (2 * np.sqrt(ratio))),
        extra_speed_worst=float(np.sqrt((own / wanted).max()) - 1),
        limit_margin=float(room[tightest]),
        attainable_margin=float(most[0]),
        smallest_singular_value=float(every.smallest[inner][c].min()),
        body_distance=float(distances.min()),
        nearest_bodies=nearest.links,
        leaf_margin=float(every.leaf[inner][c].min()),
        residual=float(residual[inner][c].max()),
        coverage=float(c.mean()),
        stops=tuple(s for s in stops if s),
    )
