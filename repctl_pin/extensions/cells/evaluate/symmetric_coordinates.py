"""Range of a function along the symmetric coordinates (angle, spin) of its sector.

A single joint moves the frame along a symmetric coordinate. The function is designed without this
coordinate, which is removed from the coordinates u of a pose; these go from −1 to 1. The range of
the function along the coordinate ends at the limits of its joint. The user requests a range in rad,
or ``"all"`` for the largest range inside these limits. A computed range is a number, its full width
from end to end, rad. A pose is covered if the function has a configuration there inside the joint
limits. A sector is a cell in cylindrical coordinates, numbered from 0: radius, angle and height
about an axis, two tilts of the tool, and its spin. K poses are the rows of U (K, k). n is the
number of joints, m that of task coordinates.

``Chart`` is coordinates (u, s) of configurations: u gives the pose, the label s (r,) the position
along its self-motion. It consists of two polynomials of u: q_ref approximates a configuration, and
n_ref the null space of J. ``Points`` are the configurations Q (K, n) of a function q = F(u) at K
poses, with the kinematics there. ``Turn`` is the range, rad, over which a function can be used
along a symmetric coordinate. ``Inverse`` is a matrix function G(q) (n, m) with J G = I, evaluated
at q (n,) or Q (K, n).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ....base.arguments import Array, percentage
from ....base.certificate import degrees_below
from ....model.native_kinematics import placed
from ....model.task import Task
from ....strategies.strategy import Inverse
from ..chart.chart import Chart, Points
from ..chart.monomials import Monomials
from ..geometry.cell import Cell
from ..geometry.sector import ANGLE, HEIGHT, SPIN, Sector
from .margins import CandidateFunction, Margin, searched

_POSES, _STARTS = 4096, 24
"""Numbers of poses at which the values of a joint are evaluated, and of those from which smaller
and larger values are searched for."""

_CONFIGURATIONS, _STEP = 6, 0.7
"""Number of configurations at which the symmetry of G_d is tested, and the joint step, rad."""


@dataclass(frozen=True)
class Turn:
    """Range of a function along one symmetric coordinate of a sector.

    Attributes
    ----------
    coordinate, joint : str
        The coordinate, ``angle`` or ``spin``, and the joint that moves the frame along it.
    joint_range : float
        Range of the joint, rad; infinite without limits.
    spread : float
        Difference between the joint's largest and smallest value over the covered poses at which
        the coordinate is 0, rad.
    reach : float
        Range of the coordinate, rad, in which the joint stays within its limits at all covered
        poses. It is ``joint_range − spread``, at most a full turn; 0 or less if there is no such
        range.
    nearly, most : float
        Ranges of the coordinate, rad, in which the joint stays within its limits at 99.9 % and at
        99 % of the covered poses.
    price : float
        Extra joint speed that the requested range costs: that of the function, minus that of a
        function designed for the range ``"all"``; 0.05 is 5 % of the joint speed of G_d. 0 if no
        such function was designed.
    unasked : float
        ``reach`` of the function designed for the range ``"all"``, rad; NaN if no such function was
        designed.
    covered : float
        Fraction of 4096 sampled poses at which the function has a configuration inside the joint
        limits; limits of joints with the range ``"all"`` do not count. NaN in older files.
    as_covered : float
        Range of the coordinate, rad, in which the joint stays within its limits at the fraction
        ``covered`` of the covered poses; NaN in older files.
    bodies : str
        Links that collide just beyond the range of the function; empty if this range ends at the
        joint's limits.
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
    covered: float = float("nan")
    as_covered: float = float("nan")
    bodies: str = ""

    @property
    def left(self) -> float:
        """Smallest distance of the joint from its limits, rad, if the range is a full turn.

        The distance is 0 if the range is less than a full turn, because the range then ends at the
        joint's limits. It is infinite if the joint has no limits.
        """
        full = self.reach >= 2 * np.pi
        return (self.joint_range - self.spread - self.reach) / 2 if full else 0.0

    def __str__(self) -> str:
        text = f"{degrees_below(max(self.reach, 0), 1)}° at every covered pose"
        if self.bodies:
            return f"{text}\nended by bodies: {self.bodies} collide beyond it"
        if self.reach >= 2 * np.pi:
            return text
        if 0 < self.covered < 1 and self.as_covered > self.reach + 0.01:
            text += (
                f", {degrees_below(self.as_covered, 1)}° at {percentage(self.covered)} of them, "
                "as many as F covers of all"
            )
        shares = [("99.9 %", self.nearly), ("99 %", self.most)]
        more = [
            f"{degrees_below(range_, 1)}° at {share}"
            for share, range_ in shares
            if range_ > self.reach + 0.01
        ]
        text += ("\n" + ", ".join(more) + " of them") * bool(more)
        text += (
            f"\nended by {self.joint}, which turns {np.degrees(self.joint_range):.4g}° and "
            f"differs by {np.degrees(self.spread):.0f}° over the sector"
        )
        if not np.isfinite(self.unasked):
            return text
        return (
            f"{text}\nthe range asked for costs {100 * max(self.price, 0.0):.2f} % joint speed; "
            f"'all' gives {degrees_below(self.unasked, 1)}°"
        )


_SHARES = (0.999, 0.99)
"""Fractions of the covered poses for which the ranges ``nearly`` and ``most`` are computed."""

_INSIDE = 1e-9
"""Distance, rad, at which a range ends inside the joint limit, so that rounding keeps it there."""


def _ends(chart: Chart, joint: int, *, quick: bool) -> tuple[float, float, float, Array]:
    """Compute the smallest and the largest value of a joint, rad, over the covered poses of a cell.

    ``joint`` is the index of the joint that moves the frame along a symmetric coordinate. Return
    (smallest, largest, fraction, widths). ``fraction`` is the fraction of the sampled poses that
    are covered. ``widths`` (3,), rad, are the widths of three intervals, around the mean of the
    smallest and the largest value, that contain 99.9 %, 99 % and ``fraction`` of the values. All
    results are NaN if no pose is covered. With ``quick``, only sampled poses are used; otherwise,
    poses with smaller and larger values are also searched for.
    """
    candidate, cell = CandidateFunction.zero(chart), chart.cell
    U = np.concatenate([cell.sample(_POSES, 11), cell.corners()])
    points = candidate.at(U)
    good = _inside(cell, points)
    if not good.any():
        return np.nan, np.nan, np.nan, np.full(len(_SHARES) + 1, np.nan)
    share = float(good[:_POSES].mean())
    U, q = U[good], points.Q[good, joint]
    ends = [float(q.min()), float(q.max())]
    for i, way in enumerate(() if quick else (1.0, -1.0)):

        def value(Q: Array, way: float = way) -> Array:
            return np.asarray(way * Q[:, joint : joint + 1], float)

        margin = Margin("joint", value, 0.0, 0.0, 0, _STARTS, 0)
        found = candidate.at(searched(candidate, (margin, U[np.argsort(way * q)[:_STARTS]])))
        inside = found.Q[_inside(cell, found), joint]
        ends[i] = way * min(way * ends[i], (way * inside).min(initial=np.inf))
    widths = 2 * np.quantile(np.abs(q - sum(ends) / 2), [*_SHARES, share])
    return ends[0], ends[1], share, widths


def _inside(cell: Cell, points: Points) -> NDArray[np.bool_]:
    """Test at which of K points the function exists inside the joint limits: (K,)."""
    margin = cell.limit_margin(points.Q).min(axis=1)
    return np.asarray(points.found & (margin >= 0))


def _limits(task: Task, joint: int) -> tuple[float, float]:
    """Return the lower and the upper limit of a joint of the task, rad; infinite without limits."""
    return float(task.lower[joint]), float(task.upper[joint])


def centred(chart: Chart, *, quick: bool = False) -> tuple[Chart, tuple[Turn, ...]]:
    """Compute the range of a chart's function along each symmetric coordinate of its sector.

    A coordinate with the range ``"all"`` gets the computed range: the middle of the sector is moved
    along the coordinate, and the half-width of the coordinate is set. Return the chart over the
    changed sector, and one range per symmetric coordinate. A chart without removed coordinates is
    returned unchanged, with no ranges. With ``quick``, ranges are those of sampled poses, without a
    search for poses that reduce them.
    """
    sector = chart.cell
    if not sector.removed:
        return chart, ()
    assert isinstance(sector, Sector), "no other cell has symmetries"
    turns, middles, halves = [], {}, {}
    coefficients = chart.coefficients.copy()
    for one in sector.removed:
        low, high, covered, widths = _ends(chart, one.joint, quick=quick)
        lower, upper = _limits(sector.task, one.joint)
        reach = min(upper - lower - (high - low) - 2 * _INSIDE, 2 * np.pi)
        name = sector.whole.coordinate_names[one.coordinate]
        joint = sector.task.joint_names[one.joint]
        ranges = np.minimum(upper - lower - widths, 2 * np.pi).tolist()
        nearly, most, as_covered = np.maximum(ranges, reach).tolist()
        joint_range, spread = float(upper - lower), float(high - low)
        shares = {"nearly": nearly, "covered": covered, "as_covered": as_covered}
        turns.append(Turn(name, joint, joint_range, spread, float(reach), most, **shares))
        if one.coordinate in sector.free and reach > 0:
            away = (upper + lower - high - low) / 2 if np.isfinite(upper - lower) else 0.0
            middles[one.coordinate], halves[one.coordinate] = one.sign * away, reach / 2
            if one.coordinate != SPIN or not sector.tilted:  # the placement is moved
                coefficients[0, one.joint, 0] += away
    moved = sector.turned(middles, halves)
    return Chart(moved, chart.monomials, coefficients), tuple(turns)


def narrowed(chart: Chart, ranges: dict[int, tuple[float, float]]) -> Chart:
    """Return the chart of the same function over a part of its sector.

    ``ranges`` has, for each symmetric coordinate to cut, the new ends (low, high) of its range, rad
    from the middle; the key is the number of the coordinate in the sector. Cut coordinates no
    longer have the range ``"all"``.
    """
    sector = chart.cell
    assert isinstance(sector, Sector), "no other cell has symmetries"
    coefficients = chart.coefficients.copy()
    middles = {i: (low + high) / 2 for i, (low, high) in ranges.items()}
    halves = {i: (high - low) / 2 for i, (low, high) in ranges.items()}
    for one in sector.removed:
        if one.coordinate in ranges and (one.coordinate != SPIN or not sector.tilted):
            coefficients[0, one.joint, 0] += one.sign * middles[one.coordinate]
    moved = sector.turned(middles, halves)
    moved = moved.without(moved.removed, [i for i in moved.free if i not in ranges])
    return Chart(moved, chart.monomials, coefficients)


def expanded(chart: Chart) -> Chart:
    """Rewrite the chart of a sector in all its coordinates, the removed symmetric ones included.

    Body distances depend on the removed coordinates, so they are evaluated with the new chart. In
    the new chart, q_ref is linear in the removed coordinates. Charts without removed coordinates
    are returned unchanged.
    """
    sector = chart.cell
    if not sector.removed:
        return chart
    whole, old = sector.whole, chart.monomials
    new = Monomials(whole.k, max(old.degree, 1))
    at = {tuple(e): i for i, e in enumerate(new.exponents.tolist())}
    powers = np.zeros((old.size, whole.k), int)
    powers[:, np.isin(whole.moved, sector.moved)] = old.exponents
    coefficients = np.zeros((new.size, *chart.coefficients.shape[1:]))
    coefficients[[at[tuple(e)] for e in powers.tolist()]] = chart.coefficients
    for one in sector.removed:
        q_ref = coefficients[:, one.joint, 0]
        linear = (whole.moved == one.coordinate).astype(int)
        q_ref[at[tuple(linear.tolist())]] = one.sign * sector.widths[one.coordinate]
        q_ref[0] += one.sign * whole._offset[one.coordinate]
    return Chart(whole, new, coefficients)


def turn_at(chart: Chart, U: Array) -> Array | None:
    """Compute the width of the range of the angle, rad, at K pairs of radius and height: (K,).

    Within the range, the joint that turns the arm stays within its limits at every tilt and spin
    that is sampled. The pairs are those in the rows of U (K, k), coordinates in the sector; tilts
    and spin in U are ignored.
    The width is NaN where no pose is covered. Return None if the symmetry of the angle is not used.
    """
    sector = chart.cell
    if ANGLE not in sector._removed:
        return None
    joint = next(one.joint for one in sector.removed if one.coordinate == ANGLE)
    others = np.flatnonzero(sector.moved > HEIGHT)
    tilts = np.concatenate([sector.sample(16, 13), sector.corners()])[:, others]
    tilts = np.unique(tilts, axis=0) if len(others) else tilts[:1]
    low, high = np.full(len(U), np.inf), np.full(len(U), -np.inf)
    for tilt in tilts:
        V = U.copy()
        V[:, others] = tilt
        points = chart.solve(V)
        good, values = _inside(sector, points), points.Q[:, joint]
        low[good] = np.minimum(low, values)[good]
        high[good] = np.maximum(high, values)[good]
    low[high < low] = np.nan
    lower, upper = _limits(sector.task, joint)
    return np.minimum(upper - lower - (high - low), 2 * np.pi)


def reduced(cell: Cell, desired: Inverse) -> Cell:
    """Return a cell without the coordinates u along which the arm and G_d are symmetric.

    A design without these coordinates is faster. The desired inverse G_d is symmetric along a
    coordinate if its values, joint velocities per m or rad of each task coordinate, do not change
    when the joint that moves the frame along this coordinate moves. A box is returned unchanged.
    """
    if not isinstance(cell, Sector):
        return cell
    task, one = cell.task, cell.whole
    rng = np.random.default_rng(1)
    Q = task.reference + rng.uniform(-0.5, 0.5, (_CONFIGURATIONS, task.n))
    before, kept = _rates(one, desired, Q), []
    for symmetry in cell.symmetries:
        moved = Q + _STEP * np.eye(task.n)[symmetry.joint]
        if np.allclose(_rates(one, desired, moved), before, rtol=1e-7, atol=1e-9):
            kept.append(symmetry)
    return cell.without(kept)


def _rates(cell: Cell, desired: Inverse, Q: Array) -> Array:
    """Evaluate G_d at Q (K, n): joint velocity per m or rad of each task coordinate, (K, n, m)."""
    p, R, J = placed(cell.task, Q)
    return desired.batch(Q, J) @ cell._all_twists(cell._measured(p, R), R)
