"""How far a function goes along the symmetric coordinates of its sector, and its chart in all
coordinates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arguments import Array
from ..robot.task import Task
from ..strategies.strategy import Batched
from .chart import Chart
from .kinematics import placed
from .margins import CandidateFunction, Margin, searched
from .monomials import Monomials
from .sector import ANGLE, HEIGHT, Sector

_POSES, _STARTS = 4096, 24
"""Poses at which the spread of a joint is measured, and from which its ends are searched for."""

_CONFIGURATIONS, _STEP = 6, 0.7
"""Configurations at which the symmetry of G_d is tested, and the joint step, rad."""


@dataclass(frozen=True)
class Turn:
    """How far a function goes along a symmetric coordinate.

    Attributes
    ----------
    coordinate, joint : str
        The coordinate, ``angle`` or ``spin``, and the joint that moves the frame along it.
    joint_range : float
        Range of the joint, rad; infinite without limits.
    spread : float
        Difference between the joint's largest and smallest value over the poses at which the
        coordinate is 0, rad.
    reach : float
        Range of the coordinate at which all covered poses are inside the joint's limits, rad: the
        joint's range less the spread, at most a full turn; 0 or less if there is none.
    nearly, most : float
        Ranges, around the same middle, at which 99.9 % and 99 % of them are, rad.
    price : float
        Extra joint speed of the function, less that of the one that goes as far as the joint does;
        0 where no range is given that ends it.
    unasked : float
        Reach of that other function, rad.
    """

    coordinate: str
    joint: str
    joint_range: float
    spread: float
    reach: float
    most: float
    nearly: float = float("nan")
    price: float = 0.0
    unasked: float = float("nan")

    def __str__(self) -> str:
        text = f"{np.degrees(max(self.reach, 0)):.4g}° at every covered pose"
        if self.reach >= 2 * np.pi:
            return text
        shares = [("99.9 %", self.nearly), ("99 %", self.most)]
        more = [
            f"{np.degrees(range_):.4g}° at {share}"
            for share, range_ in shares
            if range_ > self.reach + 0.01
        ]
        text += "".join(f", {part}" for part in more) + " of them" * bool(more)
        text += (
            f"\nended by {self.joint}, which turns {np.degrees(self.joint_range):.4g}° and "
            f"differs by {np.degrees(self.spread):.0f}° over the cell"
        )
        if not np.isfinite(self.unasked):
            return text
        return (
            f"{text}\nthe range asked for costs {100 * max(self.price, 0.0):.2f} % joint speed; "
            f"'all' gives {np.degrees(self.unasked):.4g}°"
        )


_SHARES = (0.999, 0.99)
"""Shares of the covered poses for which a range is given, too."""


def _ends(chart: Chart, joint: int) -> tuple[float, float, Array]:
    """Search for the smallest and the largest value of a joint over the covered poses of a cell;
    and measure the range around their middle of shares of the values."""
    candidate, cell = CandidateFunction.zero(chart), chart.cell
    U = np.concatenate([cell.sample(_POSES, 11), cell.corners()])
    points = candidate.at(U)
    good = points.found & (cell.limit_margin(points.Q).min(axis=1) >= 0)
    if not good.any():
        return np.nan, np.nan, np.full(len(_SHARES), np.nan)
    U, q = U[good], points.Q[good, joint]
    ends = []
    for way in (1.0, -1.0):

        def value(Q: Array, way: float = way) -> Array:
            return np.asarray(way * Q[:, joint : joint + 1], float)

        margin = Margin("joint", value, 0.0, 0.0, 0, _STARTS, 0)
        found = candidate.at(searched(candidate, margin, U[np.argsort(way * q)[:_STARTS]]))
        good = found.found & (cell.limit_margin(found.Q).min(axis=1) >= 0)
        inside = found.Q[good, joint]
        ends.append(way * min((way * q).min(), (way * inside).min(initial=np.inf)))
    return ends[0], ends[1], 2 * np.quantile(np.abs(q - sum(ends) / 2), _SHARES)


def _limits(task: Task, joint: int) -> tuple[float, float]:
    lower, upper, _ = task.joint_limits
    return float(lower[joint]), float(upper[joint])


def centred(chart: Chart) -> tuple[Chart, tuple[Turn, ...]]:
    """Measure how far a chart's function goes along the symmetric coordinates; where it goes as far
    as the joints do, move the middle of its sector there."""
    sector = chart.cell
    if not isinstance(sector, Sector) or not sector.removed:
        return chart, ()
    turns, middles, halves = [], {}, {}
    coefficients = chart.coefficients.copy()
    for one in sector.removed:
        low, high, shares = _ends(chart, one.joint)
        lower, upper = _limits(sector.task, one.joint)
        reach = min(upper - lower - (high - low), 2 * np.pi)
        name = sector.whole.coordinate_names[one.coordinate]
        joint = sector.task.joint_names[one.joint]
        nearly, most = np.minimum(upper - lower - shares, 2 * np.pi).tolist()
        found = (upper - lower, high - low, reach, most, nearly)
        turns.append(Turn(name, joint, *map(float, found)))
        if one.coordinate in sector.free and reach > 0:
            away = (upper + lower - high - low) / 2 if np.isfinite(upper - lower) else 0.0
            middles[one.coordinate], halves[one.coordinate] = one.sign * away, reach / 2
            coefficients[0, one.joint, 0] += away
    moved = sector.turned(middles, halves)
    return Chart(moved, chart.monomials, coefficients), tuple(turns)


def expanded(chart: Chart) -> Chart:
    """Write a chart in all coordinates of its cell: along a symmetric one, q_ref is linear."""
    sector = chart.cell
    if not isinstance(sector, Sector) or not sector.removed:
        return chart
    whole, old = sector.whole, chart.monomials
    new = Monomials(whole.k, max(old.degree, 1))
    columns = np.flatnonzero(whole._active)
    kept = [list(columns).index(i) for i in np.flatnonzero(sector._active)]
    powers = np.zeros((old.size, whole.k), int)
    powers[:, kept] = old.exponents
    at = {tuple(e): i for i, e in enumerate(new.exponents.tolist())}
    coefficients = np.zeros((new.size, *chart.coefficients.shape[1:]))
    coefficients[[at[tuple(e)] for e in powers.tolist()]] = chart.coefficients
    for one in sector.removed:
        linear = (columns == one.coordinate).astype(int)
        coefficients[at[tuple(linear.tolist())], one.joint, 0] = (
            one.sign * sector.widths[one.coordinate]
        )
    return Chart(whole, new, coefficients)


def turn_at(chart: Chart, U: Array) -> Array | None:
    """Measure how far round a function goes, with its tilts anywhere in the sector: (K,) rad, at
    the radius and height of every row of U (K, k). NaN where no pose is covered;
    None without the symmetry of the angle."""
    sector = chart.cell
    if not isinstance(sector, Sector) or ANGLE not in [one.coordinate for one in sector.removed]:
        return None
    joint = next(one.joint for one in sector.removed if one.coordinate == ANGLE)
    others = np.flatnonzero(sector.moved > HEIGHT)
    tilts = np.concatenate([sector.sample(16, 13), sector.corners()])[:, others]
    tilts = np.unique(tilts, axis=0) if len(others) else tilts[:1]
    low, high = np.full(len(U), np.inf), np.full(len(U), -np.inf)
    for tilt in tilts:
        V = U.copy()
        V[:, others] = tilt
        points = chart.solve(V, np.zeros((len(V), sector.task.r)))
        good = points.found & (sector.limit_margin(points.Q).min(axis=1) >= 0)
        low = np.where(good, np.minimum(low, points.Q[:, joint]), low)
        high = np.where(good, np.maximum(high, points.Q[:, joint]), high)
    low[high < low] = np.nan
    lower, upper = _limits(sector.task, joint)
    return np.minimum(upper - lower - (high - low), 2 * np.pi)


def reduced(sector: Sector, desired: Batched) -> Sector:
    """Leave the symmetric coordinates out, where G_d has the symmetry of the arm, too.

    ``G_d E`` must be the same at poses that a symmetry joins.
    """
    task, one = sector.task, sector.whole
    rng = np.random.default_rng(1)
    Q = task.reference + rng.uniform(-0.5, 0.5, (_CONFIGURATIONS, task.n))
    before, kept = _rates(one, desired, Q), []
    for symmetry in sector.symmetries:
        moved = Q + _STEP * np.eye(task.n)[symmetry.joint]
        if np.allclose(_rates(one, desired, moved), before, rtol=1e-7, atol=1e-9):
            kept.append(symmetry)
    return sector.without(kept)


def _rates(sector: Sector, desired: Batched, Q: Array) -> Array:
    """Evaluate ``G_d E`` per m and rad of every coordinate: (K, n, m)."""
    p, R, J = placed(sector.task, Q)
    return desired.batch(Q, J) @ sector._all_twists(sector._measured(p, R), R)
