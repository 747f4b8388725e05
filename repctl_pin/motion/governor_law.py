"""Law of the governor: how fast to move, and how to accelerate, from the state at a tick."""

from __future__ import annotations

from math import ceil, sqrt
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ..arguments import Array
from ..robot.task import Task
from .joint_polynomials import Plan

SPEED, ACCELERATION, JERK = 0.985, 0.95, 0.8
"""Shares of the limits that plans aim at; the rest is for what changes along the path."""

BRAKING = 0.75
"""Share of the acceleration limits with which the arm slows down before targets and limits."""

REGULAR = 0.01
"""Minimum sine of the angle between a row of J and the span of the other rows of J_V where a plan
ends: nearer to a singularity, an arm at rest could not leave it."""

TINY = 1e-300
"""In place of 0 in divisions."""

_EDGE = 1e-12
"""Rounding of a joint position, rad or m."""


class Bounds(NamedTuple):
    """Limits of the commanded joints: (n,) each, rad or m; jerk infinite without.

    Attributes
    ----------
    velocity, acceleration, jerk, lower, upper : (n,) arrays
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
    """State at the beginning of a plan: ``q̈ = G ξ̇ + bend``.

    Attributes
    ----------
    task : Task
    place : pinocchio.SE3
        Placement of the frame.
    q, qdot, bend : (n,) arrays
    G, G_ahead : (n, m) arrays
        The inverse at q, and two strides ahead.
    twist, rate, later : (6,) arrays
        The frame's twist ξ, its derivative, and that of the last plan after a stride.
    """

    task: Task
    place: pin.SE3
    q: Array
    qdot: Array
    bend: Array
    G: Array
    G_ahead: Array
    twist: Array
    rate: Array
    later: Array

    def joint_rates(self, twist: Array) -> Array:
        """Compute q̇ = G ẋ for a twist of the frame."""
        return self.G @ task_rate(self.task, self.place, twist)

    def joint_rates_ahead(self, twist: Array) -> Array:
        """Compute q̇ for the same twist two strides ahead."""
        return self.G_ahead @ task_rate(self.task, self.place, twist)


class Goal(NamedTuple):
    """Direction (6,) of the frame, the share of it asked for per s, and whether it is a target."""

    way: Array
    speed: float
    lands: bool


class Fastest(NamedTuple):
    """Largest speeds along a direction, shares of it per s, by the speed limits and by the joint
    limits ahead."""

    by_speed: float
    by_limit: float


def task_rate(task: Task, place: pin.SE3, twist: Array) -> Array:
    """Extract ẋ (m,) from a frame's twist at a placement."""
    if task.kind != "axis":
        return twist[task.rows]
    return np.concatenate([twist[:3], place.rotation[:, :2].T @ twist[3:]])


def frame_twist(task: Task, place: pin.SE3, rate: Array) -> Array:
    """Convert ẋ (m,) to a twist (6,), with 0 for what the task does not control."""
    twist = np.zeros(6)
    if task.kind == "axis":
        twist[:3], twist[3:] = rate[:3], place.rotation[:, :2] @ rate[3:]
    else:
        twist[task.rows] = rate
    return twist


def free_acceleration(bounds: Bounds, now: Now) -> Array:
    """Evaluate the acceleration (n,) that the bend of the path leaves."""
    A = bounds.acceleration
    return np.asarray(np.maximum(A - np.abs(now.bend), 0.3 * A))


def fastest(bounds: Bounds, now: Now, way: Array) -> Fastest:
    """Find the largest speeds along a direction, in shares of it per s."""
    g, ahead = np.abs(now.joint_rates(way)), np.abs(now.joint_rates_ahead(way))
    space = np.where(now.joint_rates(way) > 0, bounds.upper - now.q, now.q - bounds.lower)
    lag = 2 * bounds.stride
    speeds = [
        approach_speed(d, BRAKING * a, lag)
        for d, a in zip(space.tolist(), bounds.acceleration.tolist(), strict=True)
    ]
    g = np.maximum(g, TINY)
    by_speed = float((SPEED * bounds.velocity / np.maximum(g, ahead)).min())
    return Fastest(by_speed, float((np.array(speeds) / g).min()))


def next_rate(bounds: Bounds, now: Now, goal: Array) -> Array:
    """Choose the derivative of the twist after the next stride, on the way to another twist."""
    T = bounds.stride
    gap = goal - now.twist - T / 2 * now.rate
    g = now.joint_rates(gap)
    size = np.maximum(np.abs(g), TINY)
    space = ACCELERATION * bounds.acceleration - np.sign(g) * now.bend
    by_jerk = approach_speed(1.0, JERK * float((bounds.jerk / size).min()), T)
    change = min(max(float((space / size).min()), 0.0), by_jerk) * gap - now.rate
    g = np.maximum(np.abs(now.joint_rates(change)), TINY)
    return now.rate + min(1.0, float((JERK * bounds.jerk * T / g).min())) * change


def regularity(J: Array, G: Array) -> float:
    """Evaluate the smallest sine of the angle between a row of J and the other rows of J_V.

    ``1 / (‖row i of J‖ ‖column i of G‖)``; 0 is singular."""
    return float(1 / np.sqrt((J**2).sum(axis=1) * (G**2).sum(axis=0)).max())


def stop_time(bounds: Bounds, now: Now, twist: Array) -> float:
    """Estimate the shortest time, s, in which a cubic brings a twist to 0."""
    g = np.abs(now.joint_rates(twist))
    by_acceleration = 1.5 * g / (ACCELERATION * free_acceleration(bounds, now))
    by_jerk = 6 * g / (JERK * bounds.jerk)
    return max(float(by_acceleration.max()), sqrt(float(by_jerk.max())))


def shares_used(
    bounds: Bounds, history: Array, plan: Plan, begin: float
) -> tuple[float, float, bool]:
    """Measure the samples of a plan, which follow the last three (3, n).

    Speeds count as before ``begin``: a longer stop does not lower them.

    Returns
    -------
    before, after : float
        Largest shares of the limits that are used before and after a time.
    inside : bool
        Whether the joints stay inside their limits.
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
    return float(rest[~later].max(initial=speed)), float(rest[later].max(initial=0.0)), inside


def approach_speed(distance: float, a: float, lag: float) -> float:
    """Speed from which a deceleration a after a delay stops within a distance."""
    if distance <= 0:
        return 0.0
    if lag * lag * a > 1e12 * distance:  # a may be infinite
        return distance / lag
    return a * (sqrt(lag * lag + 2 * distance / a) - lag)
