"""Time-optimal profile ṡ(s) of a joint path, from rest to rest, by one linear program.

s is the length of the joint path q(s), and ′ = d/ds. A profile is the speed ṡ at the K *stages*,
grid points of s at which the limits are imposed. A segment is the part of the path between two
stops, with its profile. A course is a sequence of segments as a function of time. The linear
program has the unknowns x = ṡ² at the stages; n is the number of joints, and T a number of points
or times.

``JointLimits`` are maximum joint speeds and accelerations (n,) and, if given, torques and jerks, as
numbers. ``Segment`` is a smooth part of a joint path between two stops, with its speed at each
stage. ``_Program`` is the linear program of a profile: bounds on ``x = ṡ²``, and rows for
acceleration and torque.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...base.arguments import MOST_STEPS, Array, read_only
from ...base.errors import InputError
from ...motion.limits import JointLimits
from .limits_along_path import sides_that_bound, strips

BEND = 0.05
"""Change of direction of the joint path, rad, above which a point is a corner."""

SHARP = 0.3
"""Change of direction of the joint path, rad, above which a motion in its own times always stops;
it passes gentler corners if the limits allow."""

STAGES = 450
"""Minimum number of stages of a cycle's profile; between them, limits are exceeded by less than
2 %."""

_LEAST_STAGES = 50
"""Minimum number of stages (grid points of the profile) between two stops."""

MOST_SAMPLES = MOST_STEPS // 5
"""Maximum number of samples of a timed motion; each takes the memory of several steps."""

_LONGEST = 3600.0
"""Time, s, from which a motion is refused if its jerk limits make it so long. Its linear programs
have coefficients of many magnitudes, and take long to solve."""

_BETWEEN = np.array([0.0, 0.5, 1.0 - 1e-9])
"""Points at which limits are checked between two stages, as fractions of the time."""

_RESTING = 1e-4
"""Value of ṡ² at a stage, as a fraction of what its limits allow, below which the arm nearly rests
there."""

_MOST_PROGRAMS = 20
_ENOUGH = 1e-3
"""Relative saving of time by a linear program below which it is the last."""


@dataclass(frozen=True, eq=False)
@read_only
class Segment:
    """A smooth part of a joint path between two stops, with its time-optimal profile.

    Between neighbouring stages, s̈ is constant.

    Attributes
    ----------
    curve
        q(s), a scipy spline or piecewise polynomial.
    s, speed, t : (K,) arrays
        s at the stages, ṡ there, and the time, s, from the segment's start.
    passed : (T,) array
        Time, s, from the segment's start, at which the arm passes each of the T points from which
        the curve was made.
    """

    curve: Any
    s: Array
    speed: Array
    t: Array
    passed: Array

    def law(self, t: Array) -> tuple[Array, Array, Array, Array]:
        """Evaluate the path length s and ṡ, s̈, s⃛, (T,) each, at times (T,), s, from the start."""
        i = np.clip(np.searchsorted(self.t, t, side="right") - 1, 0, len(self.s) - 2)
        push = (self.speed[i + 1] ** 2 - self.speed[i] ** 2) / (2 * (self.s[i + 1] - self.s[i]))
        tau = t - self.t[i]
        s = self.s[i] + self.speed[i] * tau + 0.5 * push * tau**2
        return s, self.speed[i] + push * tau, push, np.zeros(len(t))

    def positions(self, t: Array) -> Array:
        """Evaluate q (T, n) at times (T,), s, from the segment's start."""
        return np.asarray(self.curve(self.law(t)[0]))

    def derivatives(self, t: Array) -> tuple[Array, Array, Array, Array]:
        """Evaluate q, q̇, q̈ and q⃛, each (T, n), at times (T,), s, from the segment's start."""
        s, *rates = self.law(t)
        v, a, j = (rate[:, None] for rate in rates)
        q, q1, q2, q3 = (self.curve(s, k) for k in range(4))
        return q, q1 * v, q2 * v**2 + q1 * a, q3 * v**3 + 3 * q2 * v * a + q1 * j

    def excess(self, limits: JointLimits) -> float:
        """Compute the factor by which to stretch time so that the limits hold; 1 if they do.

        The limits are checked at both ends of every interval between stages, and halfway through
        its time. The limit of jerk is not checked.
        """
        t = (self.t[:-1, None] + np.diff(self.t)[:, None] * _BETWEEN).ravel()
        return most_used(limits, self.derivatives(t)[:3])


def used_fractions(limits: JointLimits, moved: Sequence[Array]) -> Iterator[tuple[str, int, Array]]:
    """Yield (name, k, ratios) for speed, k = 1, acceleration, k = 2, and jerk, k = 3.

    ``ratios`` (T, n) are the absolute values divided by the joints' limits. If time is stretched by
    a factor f, the ratios are divided by f^k. Limits that are not given are left out. ``moved`` are
    q, q̇, q̈ and, to check jerk too, q⃛, each (T, n).
    """
    bounds = (limits.velocity, limits.acceleration, limits.jerk)
    named = zip(("speed", "acceleration", "jerk"), bounds, moved[1:], strict=False)
    for k, (name, most, values) in enumerate(named, 1):
        if most is not None:
            yield name, k, np.abs(values) / most


def most_used(limits: JointLimits, moved: Sequence[Array]) -> float:
    """Compute the factor by which to stretch time so that samples of a motion meet the limits.

    The factor is 1 if all limits are met, and larger otherwise. Limits of torque and of the tool's
    speed are included. ``moved`` are q, q̇, q̈ and, to check jerk too, q⃛, each (T, n).
    """
    used = [float(x.max()) ** (1 / k) for _, k, x in used_fractions(limits, moved)]
    factor, (Q, qdot, qddot) = max(1.0, *used), moved[:3]
    if limits.tool is not None:
        factor = max(factor, float(limits.tool(Q, qdot).max()))
    if limits.torque is None or limits.dynamics is None:
        return factor
    for q, v, a in zip(Q, qdot, qddot, strict=True):
        weight = limits.dynamics(q, 0 * v, 0 * v)
        moving = limits.dynamics(q, v, a) - weight  # goes with the square of the speed
        available = np.where(moving > 0, limits.torque - weight, limits.torque + weight)
        share = float((np.abs(moving) / np.maximum(available, 1e-9)).max())
        factor = max(factor, share**0.5)
    return factor


@dataclass(frozen=True, eq=False)
@read_only
class Course:
    """Sequence of segments as a function of time, with rests between them.

    Attributes
    ----------
    segments
        The segments, in order.
    begins, durations : arrays
        Time at which each segment begins, and its duration, s, one number per segment. If the
        duration differs from the segment's own, the segment is stretched in time.
    """

    segments: Sequence[Segment]
    begins: Array
    durations: Array

    def stretched(self, factor: float) -> Course:
        """Return the course with all times multiplied by a factor; above 1, it becomes slower."""
        return Course(self.segments, self.begins * factor, self.durations * factor)

    def derivatives(self, t: Array) -> Array:
        """Evaluate q and its first three derivatives by time at times (T,), s: (4, T, n).

        The arm is at rest before the start, between two segments, and after the end.
        """
        found = np.zeros((4, len(t), self._joints))
        for rows, segment, own, factor in self._parts(t):
            end = segment.t[-1]
            moved = np.array(segment.derivatives(np.clip(own, 0.0, end)))
            found[:, rows] = moved / factor ** np.arange(4)[:, None, None]
            found[1:, rows[(own < 0) | (own > end)]] = 0.0
        return found

    def positions(self, t: Array) -> Array:
        """Evaluate q (T, n) at times (T,), s, without its derivatives."""
        found = np.zeros((len(t), self._joints))
        for rows, segment, own, _ in self._parts(t):
            found[rows] = segment.positions(np.clip(own, 0.0, segment.t[-1]))
        return found

    @property
    def _joints(self) -> int:
        """Number of joints."""
        return int(self.segments[0].curve.c.shape[2])

    def _parts(self, t: Array) -> Iterator[tuple[NDArray[np.intp], Segment, Array, float]]:
        """Assign times ``t`` (T,), s, to segments: yield one item per segment that has a time.

        A time belongs to the last segment that has begun, or to the first one if none has. An item
        is (indices of its times, the segment, these times on the segment's own clock, the factor by
        which the segment is stretched).
        """
        which = np.maximum(np.searchsorted(self.begins, t, side="right") - 1, 0)
        for k in np.unique(which):
            rows, segment = np.flatnonzero(which == k), self.segments[k]
            factor = float(self.durations[k] / segment.t[-1])
            yield rows, segment, (t[rows] - self.begins[k]) / factor, factor


def require_possible(Q: Array, limits: JointLimits, rate: float) -> None:
    """Raise InputError if the limits make every motion through Q (T, n) too long.

    A motion is too long if its samples, ``rate`` per second, do not fit in memory, or if the limits
    of jerk make it longer than an hour. In a time t from rest, a joint with the limits v, a and j
    of speed, acceleration and jerk moves by at most ``v t``, ``a t²/2`` and ``j t³/6``. From these
    lengths follows a lower bound of the duration, without computing the profile.
    """
    away = np.abs(Q - Q[0]).max(axis=0)
    times = [away / limits.velocity, np.sqrt(2 * away) / np.sqrt(limits.acceleration)]
    if limits.jerk is not None:
        times.append(np.cbrt(6 * away) / np.cbrt(limits.jerk))
    least = float(np.max(times))
    require_samples(least * rate, least, rate, "at least ")
    if limits.jerk is not None and (slowest := float(np.max(times[-1]))) > _LONGEST:
        raise InputError(
            f"the jerk limits allow no motion shorter than {slowest:.3g} s, more than an hour",
            remedy="raise the jerk limits",
        )


def require_samples(count: float, seconds: float, rate: float, least: str = "") -> None:
    """Raise InputError if a motion of ``count`` samples is too long for memory.

    ``seconds``, the duration, and ``rate``, the samples per second, are quoted in the message;
    ``least`` is the text before the duration, "at least " if it is a lower bound.
    """
    if not count < MOST_SAMPLES:
        raise InputError(
            f"the motion lasts {least}{seconds:.3g} s, which at {rate:g} samples per second is "
            f"more than {MOST_SAMPLES:,} samples",
            remedy="lower the rate, or raise the joint limits",
        )


class Profile:
    """Timing of a few cycles, traversals of the closed path: segments with pauses between them.

    Parameters
    ----------
    runs, stays
        The segments in order, and the pause before each, s.
    stops
        Indices, among the points of the joint path, at which the segments begin; then the index at
        which the last segment ends.
    ends
        Indices, among the same points, at which the cycles begin; then the index at which the last
        cycle ends.
    limits
        Limits of the joints, from which ``stretch`` is computed.

    Attributes
    ----------
    course : Course
        The segments as a function of time.
    marks : (cycles + 1,) array
        Times at which the cycles begin, then the time at which the last cycle ends, s. If a cycle
        begins with a pause, the pause follows after this time.
    stretch : float
        Factor by which time must be stretched so that the limits also hold between the stages.
    converged : bool
        True if there is a third cycle, and the second begins and ends at equal speed, so that it
        can be repeated.
    phase : (array, array)
        For all stages of all segments: the length s of the joint path from its beginning to the
        stage, and the speed ṡ there.
    """

    def __init__(
        self,
        runs: list[Segment],
        stays: list[float],
        stops: list[int],
        ends: list[int],
        limits: JointLimits,
    ) -> None:
        took = np.array([run.t[-1] for run in runs])
        starts = np.cumsum(stays) + np.concatenate([[0.0], np.cumsum(took)[:-1]])
        self.course = Course(runs, starts, took)
        marks, speeds = [0.0], [0.0]
        for k in ends[1:]:
            j = int(np.searchsorted(stops, k, side="left")) - 1
            passed = runs[j].passed[[k - stops[j]]]
            marks.append(float(starts[j] + passed[0]))
            speeds.append(float(runs[j].law(passed)[1][0]))
        self.marks = np.array(marks)
        self.stretch = max(run.excess(limits) for run in runs)
        top = max(float(run.speed.max()) for run in runs)
        self.converged = len(ends) > 3 and abs(speeds[1] - speeds[2]) < 1e-6 * top
        lengths = np.cumsum([0.0] + [run.s[-1] for run in runs])
        self.phase = (
            np.concatenate([x + run.s for x, run in zip(lengths, runs, strict=False)]),
            np.concatenate([run.speed for run in runs]),
        )


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A timed motion as a function of time: a course of cycles, the second of which is repeated.

    A motion of many equal cycles is timed for three: one speeds up, one is steady, one slows down.

    Attributes
    ----------
    course
        The timed cycles: three if one is repeated.
    lead
        Time at rest before the course begins, s.
    begin, period : float
        Time in the course at which the second cycle begins, and its duration, s.
    more : int
        Number of additional repetitions of the second cycle; 0 for none.
    """

    course: Course
    lead: float
    begin: float
    period: float
    more: int

    def derivatives(self, t: Array) -> Array:
        """Evaluate q, q̇, q̈ and q⃛, stacked (4, T, n), at times (T,), s, from the motion's start.

        Times in a repeated cycle are mapped to the second cycle.
        """
        clock = t - self.lead
        if self.more:
            again = np.floor((clock - self.begin) / self.period)
            clock = clock - self.period * np.clip(again, 0, self.more)
        return self.course.derivatives(clock)


def corners_of(Q: Array, candidates: Iterable[int], bend: float) -> list[int]:
    """List the indices of the corners of a joint path Q (T, n), at which the arm has to stop.

    Changes of direction by more than 60° from one step to the next are corners at any point.
    Gentler ones, above ``bend``, rad, are found only among the indices ``candidates``, the corners
    of the frame's path.
    """
    steps = np.diff(Q, axis=0)
    sizes = np.linalg.norm(steps, axis=1)
    cosine = np.einsum("ij,ij->i", steps[1:], steps[:-1]) / np.maximum(
        sizes[1:] * sizes[:-1], 1e-300
    )
    found = set((np.flatnonzero(cosine < 0.5) + 1).tolist())  # cusps
    marks = sorted({0, len(Q) - 1, *candidates})
    for before, at, after in zip(marks[:-2], marks[1:-1], marks[2:], strict=True):
        into = _tangent(Q[max(before, at - 3) : at + 1][::-1])
        out = _tangent(Q[at : min(after, at + 3) + 1])
        if np.arccos(np.clip(-into @ out, -1, 1)) > bend:
            found.add(at)
    return sorted(found)


def _tangent(points: Array) -> Array:
    """Compute the unit tangent (n,) at the first of a few points (k, n) of a curve.

    It is the tangent of the polynomial through the points, or 0 if all points coincide.
    """
    x = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    if x[-1] == 0:
        return np.zeros(points.shape[1])
    slope = np.linalg.solve(np.vander(x / x[-1], increasing=True), points)[1]
    return slope / max(np.linalg.norm(slope), 1e-300)


def fastest(Q: Array, limits: JointLimits, stages: float = STAGES) -> Segment:
    """Compute the time-optimal profile of a smooth joint path Q (T, n), from rest to rest.

    The number of stages is at least ``stages``, and at least 50; every point of Q is a stage. In
    the result, ``passed`` (T,) are the times at which the points Q are passed. Limits of jerk are
    ignored.

    Raises
    ------
    InputError
        If no speed is within the limits: the path is too rough, or a joint's torque limit is too
        small to hold the arm.
    """
    from scipy.interpolate import CubicSpline  # slow to import

    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(Q, axis=0), axis=1))])
    finer = int(np.ceil(max(stages, _LEAST_STAGES) / (len(s) - 1)))
    grid = np.interp(np.arange(finer * (len(s) - 1) + 1) / finer, np.arange(len(s)), s)
    found = fastest_along(CubicSpline(s, Q, bc_type="not-a-knot"), grid, limits)
    return replace(found, passed=found.t[::finer])


def fastest_along(curve: Any, grid: Array, limits: JointLimits) -> Segment:
    """Compute the time-optimal profile of a curve q(s), from rest to rest, by a linear program.

    The unknowns are ``x = ṡ²`` at the stages; ``s̈ = x′/2`` is constant between neighbouring
    stages. The limits of speed bound x; those of acceleration and torque are linear in x at both
    ends of an interval. The program maximises the sum of x.

    ``curve`` is a scipy spline or piecewise polynomial, and ``grid`` (K,) are the stages. In the
    result, ``passed`` are the times of the stages. InputError is raised if no speed is within the
    limits.
    """
    program = _program(curve, grid, limits)
    found = program.best(np.ones(len(grid)))
    # Along a rough path the largest sum of x can rest at a stage: weigh x by the time it saves.
    if not (found[1:-1] > _RESTING).all():
        found = _without_rests(program, found)
    t = np.concatenate([[0.0], np.cumsum(program.times(found))])
    return Segment(curve, grid, np.sqrt(found * program.scale), t, t)


@dataclass(frozen=True, eq=False)
@read_only
class _Program:
    """Linear program of a profile with K stages.

    Its unknowns are ``y = x / scale``, with x = ṡ²; ``0 ≤ y ≤ top`` are the limits of speed, and
    ``low ≤ A y ≤ high`` those of acceleration and torque.

    Attributes
    ----------
    grid, scale, top : (K,) arrays
        Stages, unit of each x, and largest y. ``top`` is 0 at both ends, where the arm rests.
    A : (L, K) sparse array
        Matrix of L rows with two entries each; a row is the limit of one joint at one end of an
        interval.
    low, high : (L,) arrays
        Bounds of the rows.
    limits
        The limits of the joints, for error messages.
    """

    grid: Array
    scale: Array
    top: Array
    A: Any
    low: Array
    high: Array
    limits: JointLimits

    def best(self, weights: Array) -> Array:
        """Find the y (K,) within the limits that maximises ``weights · y``, with weights (K,)."""
        from scipy.optimize import Bounds, LinearConstraint, milp  # slow to import

        rows, bounds = LinearConstraint(self.A, self.low, self.high), Bounds(0.0, self.top)
        x = milp(-weights, bounds=bounds, constraints=rows, options={"presolve": False}).x
        if x is None:
            raise _no_speed(self.limits)
        return np.asarray(np.maximum(x, 0.0))

    def times(self, y: Array) -> Array:
        """Compute the times that the intervals between stages take, (K − 1,), s, from y (K,)."""
        speed = np.sqrt(y * self.scale)
        return np.asarray(2 * np.diff(self.grid) / np.maximum(speed[1:] + speed[:-1], 1e-300))


def _program(curve: Any, grid: Array, limits: JointLimits) -> _Program:
    """Create the linear program of a curve q(s) with stages ``grid`` (K,).

    The unknown of a stage is x divided by a scale, so that all unknowns are of similar size. The
    scale is the smaller of two values. The first is the largest x within the speed limits. The
    second is an estimate of the x that the arm reaches at the stage with the largest acceleration,
    from rest at the nearer end of the curve. Limits that cannot be the tightest at their stage are
    left out.
    """
    Q, slope, bend = curve(grid), curve(grid, 1), curve(grid, 2)

    # scale x by what the limits of speed, and the acceleration from rest at the nearer end, allow
    most = limits.most_rate(Q, slope) ** 2
    push = np.min(limits.acceleration / np.maximum(np.abs(slope), 1e-9), axis=1).max()
    way = np.minimum(grid - grid[0], grid[-1] - grid)
    scale = np.minimum(most, 2 * push * np.maximum(way, np.diff(grid).min()))

    # leave out the sides of strips that others hide
    along, across, low, high = strips(limits, Q, slope, bend)
    unit = np.minimum(most, 2 * push * (grid[-1] - grid[0]))
    used = sides_that_bound(along * push, across * unit[:, None], low, high, most / unit)
    if not used.any(axis=(1, 2)).all():
        raise _no_speed(limits)
    low = np.where(used[..., 0], low, -np.inf)
    high = np.where(used[..., 1], high, np.inf)

    A, low, high = _rows(grid, scale, along, across, low, high)
    # the arm is at rest at both ends
    top = most / scale
    top[[0, -1]] = 0.0
    return _Program(grid, scale, top, A, low, high, limits)


def _rows(
    grid: Array, scale: Array, along: Array, across: Array, low: Array, high: Array
) -> tuple[Any, Array, Array]:
    """Make the rows ``low ≤ A y ≤ high`` of a program, with y = x / scale and x = ṡ².

    A row is a strip, ``low ≤ along s̈ + across x ≤ high``, at one end of an interval between
    stages. There, ``s̈ = (x₁ − x₀) / 2h``, where h is the interval's length, and x₀ and x₁ are x at
    its two ends. Strips without a finite bound give no row. ``along``, ``across``, ``low`` and
    ``high`` (K, S) have S strips per stage. ``grid`` and ``scale`` (K,) are the stages and the unit
    of each x. Return the sparse matrix A (L, K), and low and high (L,), for all L rows.
    """
    from scipy.sparse import csr_array  # slow to import

    used = np.isfinite(low) | np.isfinite(high)
    rows = []
    for end in (0, 1):
        i, joint = np.nonzero(used[end : len(grid) - 1 + end])
        at = (i + end, joint)
        per_x = along[at] / (2 * (grid[i + 1] - grid[i]))
        pair = np.stack([-per_x, per_x], axis=1)
        pair[:, end] += across[at]
        rows.append((pair, np.stack([i, i + 1], axis=1), low[at], high[at]))
    values, columns, low, high = (np.concatenate(parts) for parts in zip(*rows, strict=True))
    values *= scale[columns]
    ends = np.arange(0, values.size + 1, 2)
    A = csr_array((values.ravel(), columns.ravel(), ends), shape=(len(values), len(grid)))
    return A, low, high


def _without_rests(program: _Program, found: Array) -> Array:
    """Improve a solution ``found`` (K,) of a program, in which the arm rests at inner stages.

    Solutions are y = x / scale. The program maximises the sum of x, so x can be 0 at inner stages
    in its solution. Here each x is weighted by the time that a larger x would save at its stage.
    Return a solution y (K,) of shorter duration. InputError is raised if the arm still rests at an
    inner stage.
    """
    reach = np.gradient(program.grid)
    for _ in range(_MOST_PROGRAMS):
        new = program.best(reach / np.sqrt(program.scale) / np.maximum(found, _RESTING) ** 1.5)
        mixed = [found + share * (new - found) for share in np.linspace(0, 1, 21)]
        took = program.times(found).sum()
        found = min(mixed, key=lambda x: program.times(x).sum())
        if program.times(found).sum() > (1 - _ENOUGH) * took:
            break
    if not (found[1:-1] > 0).all():
        raise _no_speed(program.limits)
    return found


def _no_speed(limits: JointLimits) -> InputError:
    """Create the error for a joint path on which no speed is within the limits."""
    why = "the path is too rough"
    if limits.torque is not None:
        why = "the torque limits do not hold the arm at some point of the path"
    return InputError(
        f"no speed along this joint path is within the limits: {why}; use another path, "
        "or higher limits"
    )
