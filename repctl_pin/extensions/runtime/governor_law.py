"""Law of the governor: speed and acceleration of the next plan, from the state at a tick."""

from __future__ import annotations

from math import ceil, inf, sqrt
from typing import NamedTuple

import numpy as np

from ...arguments import Array
from .course import Course
from .joint_polynomials import Plan

SPEED, ACCELERATION, JERK = 0.985, 0.95, 0.8
"""Fractions of the limits of speed, acceleration and jerk that plans aim at; the remainder is for
the change of G along the path."""

BRAKING = 0.75
"""Fraction of the acceleration limits used to slow down before targets and joint limits."""

REGULAR = 0.01
"""Minimum :func:`regularity` of the configuration in which a plan ends; nearer to a singularity, an
arm at rest could not leave it."""

TINY = 1e-300
"""Replacement for 0 in divisions."""

_EDGE = 1e-12
"""Tolerance for rounding errors of a joint position, rad or m."""


class CommandLimits(NamedTuple):
    """Limits of the commanded joints, and the time steps of the governor.

    Attributes
    ----------
    velocity, acceleration, jerk, lower, upper : (n,) arrays
        Limits, rad or m, and per s, s² and s³; jerk is inf if it is not limited.
    dt : float
        Time step, s.
    stride : float
        Time between two plans, s.
    """

    velocity: Array
    acceleration: Array
    jerk: Array
    lower: Array
    upper: Array
    dt: float
    stride: float


class Now(NamedTuple):
    """State of the arm at the beginning of a plan.

    On the leaf, ``q̇ = B ξ`` and ``q̈ = B ξ̇ + bend``, with ξ the velocity in the coordinates of the
    course.

    Attributes
    ----------
    course : Course
        Placement of the frame, and the coordinates of its straight lines.
    q, qdot, bend : (n,) arrays
        Joint positions, velocities, and accelerations at a constant ξ.
    G : (n, m) array
        The inverse at q.
    B, B_ahead : (n, 6) arrays
        Joint velocities per unit of ξ, at q and where q will be after two strides.
    twist, rate, later : (6,) arrays
        Velocity ξ, its derivative ξ̇, and ξ̇ of the last plan one stride later.
    """

    course: Course
    q: Array
    qdot: Array
    bend: Array
    G: Array
    B: Array
    B_ahead: Array
    twist: Array
    rate: Array
    later: Array

    def joint_rates(self, twist: Array) -> Array:
        """Compute q̇ = B ξ (n,) for a velocity ξ (6,) in the course's coordinates."""
        return self.B @ twist


def _free_acceleration(bounds: CommandLimits, now: Now) -> Array:
    """Compute the acceleration (n,) that is available for a change of the twist.

    It is the limit less ``|bend|``, and at least 30 % of the limit.
    """
    A = bounds.acceleration
    return np.asarray(np.maximum(A - np.abs(now.bend), 0.3 * A))


def fastest(bounds: CommandLimits, now: Now, way: Array) -> tuple[float, float]:
    """Compute the maximum speeds along a displacement ``way`` (6,) in the course's coordinates.

    They are multiples of it per s: the first keeps the speed limits, the second allows a stop
    before the joint limits.
    """
    g, ahead = np.abs(now.B @ way), np.abs(now.B_ahead @ way)
    space = np.where(
        now.joint_rates(way) > 0, bounds.upper - now.q, now.q - bounds.lower
    )
    lag = 2 * bounds.stride
    speeds = [
        arrival_speed(d, BRAKING * a, JERK * jerk, lag)
        for d, a, jerk in np.stack(
            [space, bounds.acceleration, bounds.jerk], 1
        ).tolist()
    ]
    g = np.maximum(g, TINY)
    by_speed = float((SPEED * bounds.velocity / np.maximum(g, ahead)).min())
    return by_speed, float((np.array(speeds) / g).min())


def braking(bounds: CommandLimits, now: Now, g: Array) -> tuple[float, float]:
    """Compute the deceleration before a target, and its maximum rate of change.

    They are multiples of the joint displacement g (n,) to the target, per s² and s³.
    """
    size = np.maximum(np.abs(g), TINY)
    a = BRAKING * float((_free_acceleration(bounds, now) / size).min())
    jerk = BRAKING * JERK * float((bounds.jerk / size).min())
    return min(a, _peak_acceleration(1.0, jerk)), jerk


def closing(now: Now, g: Array) -> tuple[float, float]:
    """Compute the speed and the acceleration towards a target, as multiples of g per s and s².

    ``g`` (n,) is the joint displacement to the target.
    """
    square = max(float(g @ g), TINY)
    speed, a = (float(now.joint_rates(x) @ g) / square for x in (now.twist, now.rate))
    return speed, a


def way_of_release(speed: float, a: float, jerk: float) -> float:
    """Compute the way on which an acceleration a > 0 falls to 0; 0 for a deceleration."""
    t = max(a, 0.0) / jerk
    return speed * t + a * t * t / 3


def longest_landing(speed: float, a: float) -> float:
    """Compute the time beyond which a motion to rest overshoots its end.

    The motion is the quintic in time over the distance 1, from a speed and an acceleration. Its
    last derivatives are 0, 0 and ``(60 − 24 T speed − 3 T² a) / T³``, which must not be negative.
    """
    root = 4 * speed * speed + 5 * a
    rate = 2 * speed + sqrt(root) if root >= 0 else 0.0
    return 10 / rate if rate > 0 else inf


def next_rate(bounds: CommandLimits, now: Now, goal: Array) -> Array:
    """Choose the twist's derivative (6,) one stride later, to reach the twist ``goal`` (6,)."""
    T = bounds.stride
    gap = goal - now.twist - T / 2 * now.rate
    g = now.joint_rates(gap)
    size = np.maximum(np.abs(g), TINY)
    space = ACCELERATION * bounds.acceleration - np.sign(g) * now.bend
    by_jerk = _approach_speed(1.0, JERK * float((bounds.jerk / size).min()), T)
    change = min(max(float((space / size).min()), 0.0), by_jerk) * gap - now.rate
    g = np.maximum(np.abs(now.joint_rates(change)), TINY)
    return now.rate + min(1.0, float((JERK * bounds.jerk * T / g).min())) * change


def regularity(J: Array, G: Array) -> float:
    """Evaluate the smallest sine of the angle between a row of J and the other rows of J_V.

    It is ``min_i 1 / (‖row i of J‖ ‖column i of G‖)``, and 0 at a singularity.
    """
    return float(1 / np.sqrt((J**2).sum(axis=1) * (G**2).sum(axis=0)).max())


def stop_time(bounds: CommandLimits, now: Now, twist: Array) -> float:
    """Estimate the minimum time, s, in which the twist decreases to 0, as a cubic in time."""
    g = np.abs(now.joint_rates(twist))
    by_acceleration = 1.5 * g / (ACCELERATION * _free_acceleration(bounds, now))
    by_jerk = 6 * g / (JERK * bounds.jerk)
    return max(float(by_acceleration.max()), sqrt(float(by_jerk.max())))


def shares_used(
    bounds: CommandLimits, history: Array, plan: Plan, begin: float
) -> tuple[float, float, bool]:
    """Compare the samples of a plan with the limits.

    ``history`` (3, n) are the last three samples, which precede the plan. Speeds are counted in
    ``before``, whenever they occur, because a longer stop does not lower them.

    Returns
    -------
    before, after : float
        Largest fractions of the limits that are used before and after the time ``begin``, s.
    inside : bool
        True if the joints stay inside their limits.
    """
    dt = bounds.dt
    Q = np.vstack([history, plan.samples(dt, 1, ceil(plan.time / dt) + 4)])
    lower, upper = bounds.lower - _EDGE, bounds.upper + _EDGE
    inside = bool(((Q[3:] >= lower) & (Q[3:] <= upper)).all())
    first, second, third = (np.abs(np.diff(Q, k, axis=0)) for k in (1, 2, 3))
    speed = float((first[2:] / (bounds.velocity * dt)).max())
    rest = np.maximum(
        (second[1:] / (bounds.acceleration * dt**2)).max(axis=1),
        (third / (bounds.jerk * dt**3)).max(axis=1),
    )
    later = np.arange(1, len(rest) + 1) * dt > begin
    return (
        float(rest[~later].max(initial=speed)),
        float(rest[later].max(initial=0.0)),
        inside,
    )


def arrival_speed(distance: float, a: float, jerk: float, lag: float) -> float:
    """Compute the speed from which a stop, after a delay, ends within a distance.

    The deceleration rises to at most a and falls to 0 at a rate of at most ``jerk``. From a speed v
    this takes ``v² / (2 a) + v a / (2 jerk)``, which increases with a from ``a³ = jerk² distance``.
    """
    if distance <= 0:
        return 0.0
    a = min(a, _peak_acceleration(distance, jerk))
    return _approach_speed(distance, a, lag + a / (2 * jerk))


def _peak_acceleration(distance: float, jerk: float) -> float:
    """Compute the acceleration beyond which a stop within a distance becomes no shorter."""
    return float(np.cbrt(jerk * jerk * distance))


def _approach_speed(distance: float, a: float, lag: float) -> float:
    """Compute the speed from which a deceleration a, after a delay, stops within a distance."""
    if distance <= 0:
        return 0.0
    if lag * lag * a > 1e12 * distance:  # a may be infinite
        return distance / lag
    return a * (sqrt(lag * lag + 2 * distance / a) - lag)
