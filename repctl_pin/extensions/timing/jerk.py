"""Time-optimal profile with bounded jerk along a joint path, by a sequence of linear programs.

The unknown is ``x(s) = ṡ²`` at the *stages*, which are grid points of s, the length of the joint
path q(s). Speed and acceleration limits are linear in x and x′, and jerk is

    ``q⃛ = √x (q‴ x + 3/2 q″ x′ + 1/2 q′ x″)``,

with ′ = d/ds. With the jerk limit J of a joint, ``|q⃛| ≤ J`` is
``|q‴ x + 3/2 q″ x′ + 1/2 q′ x″| ≤ J / √x``. J/√x is convex, so its tangent at the previous solution
x̄, ``J (3/2 x̄^−½ − 1/2 x x̄^−3/2)``, is a lower bound. With this bound, every
solution of the linear program respects the limit at the stages. Between two stages x(s) is a
parabola, so x″ is constant. In the first and last interval, which begin or end at rest, s⃛ is
constant instead, hence ``x ∝ s^4/3`` with s counted from rest.

There are n joints and K stages, hence K − 1 intervals between stages. The m = K − 2 inner stages
are all but the first and the last, where x = 0. The linear program minimises ``cost · z`` within
``A z ≤ b``, where the 2 m unknowns z are x at the inner stages, then x′ there. A row of A and b is
one limit of one joint at one point of an interval. An interval touches two stages, so a row has
four coefficients: those of x at the beginning, x at the end, x′ at the beginning and x′ at the end.

Five arguments recur. ``path`` is q(s) evaluated at the stages, and ``limits`` are those of the
joints. ``ties`` are the indices of two stages that get equal x and x′, so that the profile between
them, a cycle, can be repeated; empty if there is no such cycle. ``weights``, one per interval,
multiply the times of the intervals in the total duration. A weight is the number of traversals of
this cycle for an interval between the ties, and 1 for any other. ``tight``, one number per
interval, at least 1, divides the limits of acceleration and jerk in the interval; it is raised
where a solution exceeds these limits between two stages.

``JointLimits`` are maximum joint speeds and accelerations (n,) and, if given, torques and jerks, as
numbers. ``_JerkSegment`` is a smooth part of a joint path, from rest to rest, timed with bounded
jerk. ``_Path`` is a joint path q(s) and its derivatives at its K stages. ``_Rows`` are rows ``A z ≤
b`` of a linear program, each with four coefficients.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.arguments import Array, read_only
from ...base.errors import InputError
from ...motion.limits import JointLimits
from .limits_along_path import torques_along
from .speed_profile import Segment, most_used, used_fractions

if TYPE_CHECKING:
    from scipy.sparse import csr_array

_GROWTH = 1.5
"""Ratio of the lengths of successive intervals next to rest, where x″ is not bounded."""

_MERGED = 10
"""Maximum number of stages next to rest that are left out."""

_FINEST = 1e-4
"""Minimum length of the first interval, as a fraction of the next regular one."""

_MOST_PROGRAMS = 8
_ENOUGH = 1e-4
"""Relative saving of time by a linear program below which it is the last."""

_TIGHTENED = 2
"""Maximum number of times that limits are tightened where they are exceeded between the stages.
Time is stretched if they are still exceeded."""

_WELL_KEPT = 1.01
"""Maximum used fraction of a limit between the stages for which the limit is not tightened. Up to
it, time is stretched instead; for jerk, by a third of the excess."""

_NEARLY_USED = 0.4
"""A row of the linear program is used if its slack at the last solution is less than this fraction
of its bound; other rows are added if they are violated."""

_BESIDE = 70
"""Number of rows before and after a violated row that are added with it: those of ten intervals
between stages, for seven joints."""

_SLACK = 1e-7
"""Violation of a row that the solver HiGHS tolerates."""

_BETWEEN = np.linspace(0.0, 1.0, 9)
"""Points at which limits are checked between two stages, as fractions of the time."""


@dataclass(frozen=True, eq=False)
@read_only
class _JerkSegment(Segment):
    """A smooth part of a joint path, from rest to rest, timed with bounded jerk.

    s is the length of the joint path; stages are grid points of s at which the limits are imposed.

    Attributes
    ----------
    x, bend : (K,), (K - 1,) arrays
        x = ṡ² at the K stages, and x″ in each interval between them. The first and the last entry
        of ``bend`` are not used: in these intervals, s⃛ is constant.
    """

    x: Array
    bend: Array

    def law(self, t: Array) -> tuple[Array, Array, Array, Array]:
        """Evaluate the path length s and ṡ, s̈, s⃛, (T,) each, at times (T,), s, from the start.

        After a stage s₀, ``s̈ = x′/2 = (x′₀ + x″ u)/2`` with x = ṡ² is linear in ``u = s − s₀``,
        hence u(t) is a sum of exponentials.
        """
        i = np.clip(np.searchsorted(self.t, t, side="right") - 1, 0, len(self.s) - 2)
        h = np.diff(self.s)[i]
        tau = t - self.t[i]
        slope = (
            (self.x[i + 1] - self.x[i]) - self.bend[i] * h**2 / 2
        ) / h  # x′ where the interval begins
        S, C = _exponentials(self.bend[i] / 2 * tau**2)
        u = np.clip(self.speed[i] * tau * S + slope / 2 * tau**2 * C, 0.0, h)
        x = self.x[i] + slope * u + self.bend[i] * u**2 / 2
        rate = np.sqrt(np.maximum(x, 0.0))
        found = (self.s[i] + u, rate, (slope + self.bend[i] * u) / 2, self.bend[i] * rate / 2)
        for k, rest, sign in ((0, 0.0, 1.0), (len(self.s) - 2, self.s[-1], -1.0)):
            rows = i == k
            T = self.t[k + 1] - self.t[k]
            since = (tau if sign > 0 else T - tau)[rows]  # since rest, or until it
            for values, new in zip(found, _cubic(rest, sign, h[rows], T, since), strict=True):
                values[rows] = new
        return found

    def between(self) -> Array:
        """List the times (9 (K − 1),), s, at which limits are checked: 9 in each interval."""
        return (self.t[:-1, None] + np.diff(self.t)[:, None] * _BETWEEN * (1 - 1e-9)).ravel()

    def used(self, limits: JointLimits) -> Array:
        """Compute, per interval, the largest ratio of acceleration or jerk to its limit: (K − 1,).

        The ratio is the largest one over all joints. If it exceeds 1, the linear program is solved
        again with tighter limits in that interval.
        """
        _, *rates = used_fractions(limits, self.derivatives(self.between()))
        share = np.maximum(*(used for _, _, used in rates))
        return np.asarray(share.max(axis=1).reshape(-1, len(_BETWEEN)).max(axis=1))

    def excess(self, limits: JointLimits) -> float:
        """Compute the factor, at least 1, by which to stretch time so that all limits hold.

        The factor is above 1 if a limit is exceeded between two stages: the linear program imposes
        limits at the stages only.
        """
        return most_used(limits, self.derivatives(self.between()))


def _exponentials(z: Array) -> tuple[Array, Array]:
    """Evaluate (``sinh(√z)/√z``, ``(cosh √z − 1)/z``) at an array z of any shape and either sign.

    For z < 0 these are ``sin(√|z|)/√|z|`` and ``(1 − cos √|z|)/|z|``, and their limits for z = 0
    are 1 and ½. Both functions describe a motion whose acceleration is linear in the distance.
    """
    root = np.sqrt(np.abs(z))
    small = root < 1e-2
    safe = np.where(small, 1.0, root)
    grown = np.minimum(safe, 300.0)  # beyond the interval's end, which is clipped
    S = np.where(z > 0, np.sinh(grown), np.sin(safe)) / safe
    C = np.where(z > 0, np.sinh(grown / 2), np.sin(safe / 2)) ** 2 * 2 / safe**2
    return np.where(small, 1 + z / 6 + z**2 / 120, S), np.where(small, 0.5 + z / 24 + z**2 / 720, C)


def with_jerk(
    first: Segment, limits: JointLimits, seams: tuple[int, ...] = (), weight: float = 1.0
) -> _JerkSegment:
    """Find the time-optimal profile ṡ(s) with bounded jerk along a segment's curve q(s).

    The arm rests at both ends. Linear programs improve the profile ``first``.

    Parameters
    ----------
    first
        Segment with a profile without a limit of jerk. Its stages are used, except that some are
        inserted or removed next to rest.
    limits
        Limits to respect, jerk included.
    seams
        Empty, or two points that get equal ṡ and s̈, so that the profile between them can be
        repeated. The seams are indices among the points from which the curve was made, whose times
        are ``first.passed``.
    weight
        Number of times that the profile between the seams will be traversed; the total duration is
        minimised.

    Raises
    ------
    InputError
        If no speed, however low, is within the limits.
    """
    knots = first.s[np.searchsorted(first.t, first.passed)]
    path = _Path.of(first.curve, _graded(first.s, first.curve, limits), limits)
    s = path.s
    ties = tuple(int(np.searchsorted(s, knots[k])) for k in seams)
    weights = np.ones(len(s) - 1)
    if ties:
        weights[ties[0] : ties[1]] = weight
    x = np.minimum(np.interp(s, first.s, first.speed**2), path.from_rest(limits))
    x, slope = x, np.gradient(x, s)
    tight = np.ones(len(s) - 1)
    for _ in range(_TIGHTENED + 1):
        x, slope = _converged(path, limits, x, slope, ties, weights, tight)
        t = np.concatenate([[0.0], np.cumsum(_times(s, x, slope))])
        if not np.isfinite(t).all():
            raise InputError(
                "no speed along this joint path is within the jerk limits: the path is too rough",
                remedy="use a smoother path",
            )
        bend = np.diff(slope) / np.diff(s)
        found = _JerkSegment(first.curve, s, np.sqrt(x), t, _passed(knots, s, t), x, bend)
        used = found.used(limits)
        if used.max() < _WELL_KEPT:
            break
        tight *= np.maximum(used, 1.0)
    return found


def _converged(
    path: _Path,
    limits: JointLimits,
    x: Array,
    slope: Array,
    ties: tuple[int, ...],
    weights: Array,
    tight: Array,
) -> tuple[Array, Array]:
    """Solve linear programs until the duration stops decreasing; return x and x′ at the K stages.

    Each program is linearised at the preceding solution; the first one at x = ``x`` and x′ =
    ``slope``, (K,) each. On the line from one solution to the next, the point of shortest weighted
    duration is taken. ``ties``, ``weights`` (K − 1,) and ``tight`` (K − 1,) are explained at the
    top of this module. InputError is raised if a program has no solution.
    """
    took = np.inf
    for _ in range(_MOST_PROGRAMS):
        new, new_slope = _solved(path, limits, x, slope, ties, weights, tight)
        if np.isfinite(took):
            shares = np.linspace(0, 1, 21)
            times = [
                weights @ _times(path.s, x + a * (new - x), slope + a * (new_slope - slope))
                for a in shares
            ]
            a = shares[int(np.argmin(times))]
            new, new_slope = x + a * (new - x), slope + a * (new_slope - slope)
        before, took = took, float(weights @ _times(path.s, new, new_slope))
        x, slope = (new, new_slope) if not took >= before else (x, slope)
        if before - took < _ENOUGH * took:
            break
    return x, slope


def _passed(knots: Array, s: Array, t: Array) -> Array:
    """Compute the times (T,), s, at which T points of a path, at s = ``knots`` (T,), are passed.

    ``s`` and ``t`` (K,) are the stages and their times. Points that are not stages lie in the first
    or last interval, where s⃛ is constant.
    """
    passed = t[np.minimum(np.searchsorted(s, knots), len(s) - 1)]
    early, late = knots < s[1], knots > s[-2]
    passed[early] = t[1] * np.cbrt(knots[early] / s[1])
    passed[late] = t[-1] - (t[-1] - t[-2]) * np.cbrt((s[-1] - knots[late]) / (s[-1] - s[-2]))
    return passed


def _graded(grid: Array, curve: Any, limits: JointLimits) -> Array:
    """Insert or remove stages next to both ends of ``grid``; return the new stages (K,).

    The arm is at rest at both ends, where x″ is not bounded. The first stage after rest is placed
    at half the distance ``a³ / 6J²`` at which constant jerk J reaches the acceleration a; a and J
    are the limits of s̈ and s⃛ at this end. If that stage is farther away than one interval of the
    grid, up to ten stages are removed; if it is nearer, stages are inserted. ``curve`` is q(s).
    """
    assert limits.jerk is not None

    def stages(way: Array, slope: Array) -> Array:
        used = np.maximum(np.abs(slope), 1e-12)
        reached = float(
            np.min(limits.acceleration / used) ** 3 / np.min(limits.jerk / used) ** 2 / 12
        )
        h, most = way[0], way[min(_MERGED, len(way) // 8)]
        if reached >= h:
            return way[way >= min(reached, most) * (1 - 1e-9)]
        begin = max(reached, _FINEST * h)
        more = begin * _GROWTH ** np.arange(max(1, int(np.log(h / begin) / np.log(_GROWTH))))
        return np.concatenate([more[more < h * (1 - 1e-9)], way])

    half = len(grid) // 2
    first = stages(grid[1:half], curve(0.0, 1))
    last = grid[-1] - stages((grid[-1] - grid[half:-1])[::-1], curve(grid[-1], 1))[::-1]
    return np.concatenate([[0.0], first, last, grid[-1:]])


@dataclass(frozen=True, eq=False)
@read_only
class _Path:
    """A joint path q(s) evaluated at its K stages: the data common to all its linear programs.

    Attributes
    ----------
    s : (K,) array
        The stages.
    third : (K − 1, n) array
        q‴ halfway between the stages.
    most, most_between : (K,), (K − 1,) arrays
        Largest x = ṡ² within the speed limits, at the stages and halfway between them.
    points : tuple
        Three tuples, for the beginning, the middle and the end of all intervals. Each has the
        fraction of the interval (0, ½ or 1), q′ and q″ there, (K − 1, n) each, and the terms (a, b,
        g), (K − 1, n) each, of the joint torques ``τ = a s̈ + b ṡ² + g`` there; None without torque
        limits.
    curve
        q(s), a piecewise polynomial.
    """

    s: Array
    third: Array
    most: Array
    most_between: Array
    points: tuple[tuple[float, Array, Array, tuple[Array, Array, Array] | None], ...]
    curve: Any

    @classmethod
    def of(cls, curve: Any, s: Array, limits: JointLimits) -> _Path:
        """Evaluate a curve q(s) at the stages s (K,), and halfway between them."""
        h = np.diff(s)
        points = []
        for share in (0.0, 0.5, 1.0):
            u = s[:-1] + share * h
            slope, bend = curve(u, 1), curve(u, 2)
            points.append((share, slope, bend, torques_along(limits, curve(u), slope, bend)))
        middle = s[:-1] + h / 2
        most, most_between = (limits.most_rate(curve(u), curve(u, 1)) ** 2 for u in (s, middle))
        return cls(s, curve(middle, 3), most, most_between, tuple(points), curve)

    def from_rest(self, limits: JointLimits) -> Array:
        """Evaluate x = ṡ² at the stages for the largest constant s⃛ from rest at either end: (K,).

        From one end, ``x = (9/2 j)^⅔ s^4/3`` with ``j = min J/|q′|`` over the joints, and s counted
        from that end. The result is the smaller of the two values, from either end. This is a bound
        on the first guess, which was computed without a limit of jerk.
        """
        assert limits.jerk is not None
        both = []
        for end, way in ((self.s[0], self.s), (self.s[-1], self.s[-1] - self.s)):
            j = np.min(limits.jerk / np.maximum(np.abs(self.curve(end, 1)), 1e-12))
            both.append((4.5 * j) ** (2 / 3) * way ** (4 / 3))
        return np.minimum(*both)


def _times(s: Array, x: Array, slope: Array) -> Array:
    """Compute the time of every interval, (K − 1,), s; exact for a parabola x(s).

    ``x`` = ṡ² and ``slope`` = x′ are given at the stages ``s``, (K,) each. The time is
    ``2h/(v₀+v₁) artanh(y)/y`` with ``y² = x″ h² / (2 (v₀+v₁)²)``: h is the length of the interval,
    x″ is the change of x′ divided by h, and v₀ and v₁ are ṡ at both ends. For x″ < 0,
    arctan(|y|)/|y| takes the place of artanh(y)/y. In the first and last interval, s⃛ is constant.
    """
    h = np.diff(s)
    v = np.sqrt(np.maximum(x, 0.0))
    mean = v[1:] + v[:-1]
    z = np.diff(slope) * h / 2 / np.maximum(mean, 1e-300) ** 2
    z[[0, -1]] = 0.0
    root = np.sqrt(np.abs(z))
    safe = np.where(root < 1e-2, 1.0, root)
    curved = np.where(z > 0, np.arctanh(np.where(safe < 1, safe, np.nan)), np.arctan(safe)) / safe
    t = 2 * h / mean * np.where(root < 1e-2, 1 + z / 3 + z**2 / 5, curved)
    t[[0, -1]] *= 1.5  # constant jerk: t = 3 h / v
    return t


def _solved(
    path: _Path,
    limits: JointLimits,
    near: Array,
    near_slope: Array,
    ties: tuple[int, ...],
    weights: Array,
    tight: Array,
) -> tuple[Array, Array]:
    """Solve one linear program, linearised at x̄ = ``near`` (K,); return x and x′ at the K stages.

    The program minimises the linearised duration within all limits. Its unknowns z are x/x̄ at the
    inner stages, and x′ there in units of twice the largest s̈ allowed. ``near_slope`` (K,) is x̄′;
    ``ties``, ``weights`` (K − 1,) and ``tight`` (K − 1,) are explained at the top of this module.
    """
    h, inner, m = np.diff(path.s), slice(1, -1), len(path.s) - 2
    x0 = near[inner]
    slopes = np.maximum(np.abs(path.curve(path.s[inner], 1)), 1e-9)
    unit = 2 * np.min(limits.acceleration / slopes, axis=1)
    parts = zip(*_rows(path, limits, near, tight), strict=True)
    rows = _Rows(*map(np.concatenate, parts)).scaled(np.concatenate([x0, unit]))
    equal = _equalities(path.s, x0, unit, ties)
    spent = weights * h
    cost = np.concatenate([-(spent[1:] + spent[:-1]) / np.sqrt(x0), np.zeros(m)])
    guess = np.concatenate([np.ones(m), near_slope[inner] / unit])
    lower = np.repeat([1e-9, -np.inf], m)
    most = _most_speed(path, limits, x0, tight)
    between = np.stack([lower, np.append(most, np.full(m, np.inf))], axis=1)
    z = _optimum(cost / np.abs(cost).max(), rows, equal, between, guess)
    x, slope = np.zeros(m + 2), np.zeros(m + 2)
    x[inner], slope[inner] = z[:m] * x0, z[m:] * unit
    return x, slope


def _cubic(
    rest: float, sign: float, h: Array, T: float, since: Array
) -> tuple[Array, Array, Array, Array]:
    """Evaluate s, ṡ, s̈, s⃛ in the first or last interval, where s⃛ is constant.

    The interval has the length ``h`` and the duration ``T``, s. ``rest`` is s at that end of the
    interval at which the arm rests: at its beginning if ``sign`` is 1, or at its end if ``sign`` is
    −1. ``since``, of any shape, is the time, s, since or until this rest. All results have the
    shape of ``since``.
    """
    since = np.clip(since, 0.0, T)
    jerk = 6 * h / T**3
    return (rest + sign * jerk * since**3 / 6, jerk * since**2 / 2, sign * jerk * since, jerk)


class _Rows(NamedTuple):
    """R rows ``A z ≤ b`` of a linear program, each with four coefficients.

    Each row constrains the interval between two neighbouring stages, so only x and x′ at these two
    stages have a coefficient. ``coefficients`` and ``columns`` are (R, 4): a column is the index of
    the coefficient's unknown in z. ``bounds`` b is (R,).
    """

    coefficients: Array
    columns: NDArray[np.intp]
    bounds: Array

    def scaled(self, units: Array) -> _Rows:
        """Convert the rows to unknowns ``z / units``, with units (2 m,)."""
        return self._replace(coefficients=self.coefficients * units[self.columns])

    def excess(self, z: Array) -> Array:
        """Evaluate A z − b: (R,); positive where a row is violated."""
        return (self.coefficients * z[self.columns]).sum(axis=1) - self.bounds


def _equalities(s: Array, x0: Array, unit: Array, ties: tuple[int, ...]) -> csr_array:
    """Create the matrix E, with 2 m columns, of the equations ``E z = 0`` between x and x′.

    ``s`` (K,) are the stages. The unknowns z are x = ṡ² at the m inner stages in units of ``x0``
    (m,), and x′ in units of ``unit`` (m,). There is one equation per interval between inner stages,
    on which x is a parabola, and one at either end, where ``x ∝ s^4/3``, hence ``x′ = 4/3 x / s``.
    Two more make x and x′ equal at the two stages of ``ties``, if it is not empty.
    """
    h, m = np.diff(s), len(x0)
    i = np.arange(m - 1)
    columns = np.stack([i, i + 1, m + i, m + i + 1], axis=1)
    whole, half = np.ones(m - 1), -h[1:-1] / 2
    parabola = np.stack([-whole, whole, half, half], axis=1)
    scales = np.concatenate([x0, unit])
    equal, where = [parabola * scales[columns] / x0[:-1, None]], [columns]
    for k, step in ((0, h[0]), (m - 1, -h[-1])):
        equal.append(np.array([[4 / 3 / step * x0[k] / unit[k], -1.0, 0.0, 0.0]]))
        where.append(np.array([[k, m + k, k, k]]))
    if ties:
        a, b = (k - 1 for k in ties)
        for one, other in ((a, b), (m + a, m + b)):
            equal.append(np.array([[1.0, -scales[other] / scales[one], 0.0, 0.0]]))
            where.append(np.array([[one, other, one, one]]))
    return _sparse(np.concatenate(equal), np.concatenate(where), 2 * m)


def _optimum(cost: Array, rows: _Rows, equal: csr_array, between: Array, guess: Array) -> Array:
    """Find the unknowns z (2 m,) that minimise ``cost · z`` within all limits.

    The limits are the inequalities ``A z ≤ b`` of ``rows``, the equations ``E z = 0`` with the
    matrix E = ``equal``, and the lower and upper bounds of each unknown, ``between`` (2 m, 2).

    Few of the many inequalities hold with equality at the optimum. So the first program uses only
    rows that nearly hold with equality at ``guess``, an estimate of z. As long as its solution
    violates other rows, these and neighbouring rows are added, and the program is solved again.
    InputError is raised if there is no solution.
    """
    from scipy.optimize import linprog  # slow to import

    active = np.zeros(len(rows.bounds), bool)
    zero = np.zeros(equal.shape[0])
    while True:
        active |= rows.excess(guess) > -_NEARLY_USED * np.abs(rows.bounds)
        A = _sparse(rows.coefficients[active], rows.columns[active], len(cost))
        b = rows.bounds[active]
        guess = linprog(cost, A, b, equal, zero, between, method="highs").x
        if guess is None:
            raise InputError(
                "no speed along this joint path is within the limits, those of jerk included",
                remedy="use a smoother path, or higher jerk limits",
            )
        broken = rows.excess(guess) > _SLACK
        if not (broken & ~active).any():
            return np.asarray(guess, float)
        active |= np.convolve(broken, np.ones(2 * _BESIDE + 1), "same") > 0


def _rows(
    path: _Path, limits: JointLimits, near: Array, tight: Array
) -> Iterator[tuple[Array, NDArray[np.intp], Array]]:
    """Yield the rows ``A z ≤ b`` for the limits of speed, acceleration, torque and jerk.

    The unknowns z are x = ṡ² and x′ at the inner stages. Each item is a block of R rows: the
    coefficients and columns, (R, 4) each, and bounds (R,). ``near`` (K,) is x̄, at which the jerk
    is linearised, and ``tight`` (K − 1,) divides the limits of acceleration and jerk in each
    interval.
    """
    assert limits.jerk is not None
    tight = tight[1:-1, None]
    stages = _Stages(np.diff(path.s)[1:-1, None], len(limits.acceleration))
    whole = 1 / path.most_between[1:-1, None]
    yield stages.rows(0.5, whole, np.zeros_like(whole)), stages.ends, np.ones(len(stages.ends))
    most = limits.acceleration / tight
    for share, q1, q2, torque in path.points:
        q1, q2 = q1[1:-1], q2[1:-1]
        A = stages.rows(share, q2 / most, q1 / 2 / most)
        yield from stages.both_signs(A, 0.0, np.ones(len(A)))
        if torque is not None and limits.torque is not None:
            a, b, g = (part[1:-1] / limits.torque for part in torque)
            A = stages.rows(share, b, a / 2)
            yield A, stages.columns, (1 - g).ravel()
            yield -A, stages.columns, (1 + g).ravel()
        # jerk, at the stages only
        if share in (0.0, 1.0):
            x = (near[1:-2] if share == 0 else near[2:-1])[:, None]
            third = path.third[1:-1]
            yield from stages.jerk_rows(share, x, (q1, q2, third), np.sqrt(x) / limits.jerk * tight)


class _Stages:
    """The I intervals between inner stages, and the unknowns x and x′ at their ends.

    ``h`` (I, 1) are the lengths of the intervals. ``ends`` (I, 4) has, for each interval, the
    indices among the unknowns z of x at its beginning, x at its end, x′ at its beginning and x′ at
    its end. ``columns`` (I n, 4) repeats each row of ``ends`` for every one of the n joints.
    """

    def __init__(self, h: Array, n: int) -> None:
        self.h = h
        i = np.arange(len(h))
        m = len(h) + 1
        self.ends = np.stack([i, i + 1, m + i, m + i + 1], axis=1)
        self.columns = np.repeat(self.ends, n, axis=0)

    def both_signs(
        self, A: Array, more: Array | float, bounds: Array
    ) -> Iterator[tuple[Array, NDArray[np.intp], Array]]:
        """Yield the rows ``(A + more) z ≤ bounds``, then ``(−A + more) z ≤ bounds``.

        These rows are the two sides of a limit on an absolute value, ``|A z| ≤ bounds − more z``.
        ``A`` and ``more`` (I n, 4) are coefficients of the unknowns whose indices in z are
        ``columns``, and ``bounds`` is (I n,). Each of the two items is a tuple: coefficients
        (I n, 4), ``columns``, and bounds (I n,).
        """
        for sign in (1, -1):
            yield sign * A + more, self.columns, bounds

    def jerk_rows(
        self, share: float, x: Array, slopes: tuple[Array, Array, Array], scale: Array
    ) -> Iterator[tuple[Array, NDArray[np.intp], Array]]:
        """Yield the two blocks of rows for the limits of jerk, linearised at x̄ = ``x`` (I, 1).

        ``slopes`` are q′, q″ and q‴ (I, n) at the fraction ``share`` of each interval, and
        ``scale`` (I, n) is √x̄ divided by the limits. With ``q⃛ = √x (q‴ x + 3/2 q″ x′ + 1/2 q′
        x″)``, the rows are ``√x̄ |q‴ x + …| ≤ limit (3/2 − x/(2 x̄))``.
        """
        q1, q2, q3 = slopes
        A = self.rows(share, scale * q3, scale * 1.5 * q2, scale * q1 / 2)
        tangent = self.rows(share, np.broadcast_to(0.5 / x, q1.shape), np.zeros_like(q1))
        yield from self.both_signs(A, tangent, np.full(len(A), 1.5))

    def rows(self, share: float, a: Array, b: Array, c: Array | float = 0.0) -> Array:
        """Express ``a x + b x′ + c x″`` at one point of each interval in the unknowns at its ends.

        The point is at the fraction ``share`` of the interval, from 0 to 1. ``a``, ``b`` and ``c``
        (I, n) have one factor per interval and joint. As x(s) is a parabola, the sum is linear in x
        and x′ at both ends. Return the coefficients (I n, 4) of these unknowns, in the order of
        ``columns``.
        """
        k = c / self.h - share * (1 - share) / 2 * self.h * a
        return np.stack(
            [a * (1 - share), a * share, b * (1 - share) - k, b * share + k], axis=-1
        ).reshape(-1, 4)


def _most_speed(path: _Path, limits: JointLimits, x0: Array, tight: Array) -> Array:
    """Compute the upper bounds (m,) of x at the inner stages, in units of x̄ = ``x0`` (m,).

    A bound is the smallest of three values: x at the speed limits, 3 x̄ and, at the two stages next
    to rest, the result of :func:`_most_beside_rest` divided by ``tight``.
    """
    most = np.minimum(path.most[1:-1], 3 * x0) / x0
    h = np.diff(path.s)
    for end, step in ((0, h[0]), (-1, -h[-1])):
        beside = _most_beside_rest(path, limits, end, step) / tight[end]
        most[end] = min(most[end], beside / x0[end])
    return most


def _most_beside_rest(path: _Path, limits: JointLimits, end: int, step: float) -> float:
    """Compute the largest x₁, the value of x = ṡ² at the stage next to rest, within the limits.

    The limits are those of acceleration and jerk. ``end`` is 0 or -1, the end of the path at which
    the arm rests, and ``step`` the signed distance h from there to the stage. At the fraction σ of
    this interval, ``x = x₁ σ^4/3``, hence ``q⃛ = x₁^3/2 (q‴ σ² + 2 q″ σ/h + 2/9 q′/h²)`` and
    ``q̈ = x₁ (q″ σ^4/3 + 2/3 q′ σ^1/3 / h)``.
    """
    assert limits.jerk is not None
    sigma = np.linspace(0, 1, 4 * _MERGED + 1)
    q1, q2, q3 = (path.curve(path.s[end] + sigma * step, k) for k in (1, 2, 3))
    sigma = sigma[:, None]
    jerk = q3 * sigma**2 + 2 * q2 * sigma / step + 2 / 9 * q1 / step**2
    push = q2 * sigma ** (4 / 3) + 2 / 3 * q1 * np.cbrt(sigma) / step
    most = (
        np.max(np.abs(jerk) / limits.jerk) ** (-2 / 3),
        1 / np.max(np.abs(push) / limits.acceleration),
    )
    return float(min(most))


def _sparse(coefficients: Array, columns: NDArray[np.intp], width: int) -> csr_array:
    """Create a sparse matrix (R, width) from ``coefficients`` and their ``columns``, (R, 4) each.

    Coefficients of a row that have the same column are added.
    """
    from scipy.sparse import csr_array

    ends = np.arange(0, coefficients.size + 1, 4)
    return csr_array(
        (coefficients.ravel(), columns.ravel(), ends), shape=(len(coefficients), width)
    )
