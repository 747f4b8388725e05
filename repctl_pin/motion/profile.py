"""How fast a joint path can be run, from rest to rest: the phase-plane profile ṡ(s), by TOPP-RA."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arguments import Array, read_only
from ..errors import InputError, needed

InverseDynamics = Callable[[Array, Array, Array], Array]
"""q, q̇, q̈ → τ."""

_BEND = 0.05
"""A corner: the joint path turns by more than this, rad, from one side to the other."""

SHARP = 0.3
"""A corner at which a motion in its own times always stops, rad: gentler ones it passes if the
limits are kept."""

STAGES = 450
"""Minimum number of stages of a cycle's profile; between them, limits are exceeded by less than
2 %."""

LEAST_STAGES = 50
"""Stages between two stops, at least."""


@dataclass(frozen=True, eq=False)
@read_only
class Limits:
    """Limits of the joints (n,) and of the tool.

    Attributes
    ----------
    velocity, acceleration, jerk : (n,) arrays
        Per s, s² and s³; no jerk is no limit.
    torque, dynamics
        Efforts (n,), N m or N, and the inverse dynamics that they are compared with.
    tool
        Function of q and q′ (K, n) → (K,): the share of the tool's speed limit that ṡ = 1 uses.
    """

    velocity: Array
    acceleration: Array
    torque: Array | None = None
    dynamics: InverseDynamics | None = None
    jerk: Array | None = None
    tool: Callable[[Array, Array], Array] | None = None

    def most_rate(self, Q: Array, slope: Array) -> Array:
        """Find the largest ṡ within the limits of speed at points of a path: (K,)."""
        used = (np.abs(slope) / self.velocity).max(axis=1)
        if self.tool is not None:
            used = np.maximum(used, self.tool(Q, slope))
        return 1 / np.maximum(used, 1e-9)


@dataclass(frozen=True, eq=False)
@read_only
class Segment:
    """A smooth part of a joint path, from stop to stop, and its profile.

    ``s`` is the length along the joints; between two stages s̈ is constant.

    Attributes
    ----------
    curve
        q(s), by scipy's spline.
    s, speed, t : (K,) arrays
        The stages, ṡ there, and the time from the segment's start.
    passed : (T,) array
        When the points of the path are passed.
    """

    curve: Any
    s: Array
    speed: Array
    t: Array
    passed: Array

    def at(self, t: Array) -> Array:
        """Find s at times (T,) from the segment's start."""
        i = np.clip(np.searchsorted(self.t, t, side="right") - 1, 0, len(self.s) - 2)
        push = (self.speed[i + 1] ** 2 - self.speed[i] ** 2) / (2 * (self.s[i + 1] - self.s[i]))
        tau = t - self.t[i]
        return self.s[i] + self.speed[i] * tau + 0.5 * push * tau**2

    def law(self, t: Array) -> tuple[Array, Array, Array, Array]:
        """Evaluate s, ṡ, s̈ and s⃛ at times (T,) from the segment's start."""
        i = np.clip(np.searchsorted(self.t, t, side="right") - 1, 0, len(self.s) - 2)
        push = (self.speed[i + 1] ** 2 - self.speed[i] ** 2) / (2 * (self.s[i + 1] - self.s[i]))
        return self.at(t), self.speed[i] + push * (t - self.t[i]), push, np.zeros(len(t))

    def derivatives(self, t: Array) -> tuple[Array, Array, Array, Array]:
        """Evaluate q, q̇, q̈ and q⃛ (T, n) at times (T,) from the segment's start."""
        s, *rates = self.law(t)
        v, a, j = (rate[:, None] for rate in rates)
        q, q1, q2, q3 = _spline(self.curve, s)
        return q, q1 * v, q2 * v**2 + q1 * a, q3 * v**3 + 3 * q2 * v * a + q1 * j

    def excess(self, limits: Limits) -> float:
        """By what factor time has to be stretched for the limits to hold at stages and between
        them; 1 if they hold."""
        u = (self.speed[1:] ** 2 - self.speed[:-1] ** 2) / (2 * np.diff(self.s))
        factor = 1.0
        for share in (0.0, 0.5, 1.0):
            s = self.s[:-1] + share * np.diff(self.s)
            x = (1 - share) * self.speed[:-1] ** 2 + share * self.speed[1:] ** 2  # linear in s
            slope, bend = self.curve(s, 1), self.curve(s, 2)
            qdot, qddot = slope * np.sqrt(x)[:, None], bend * x[:, None] + slope * u[:, None]
            factor = max(factor, float((np.abs(qdot) / limits.velocity).max()))
            factor = max(factor, float(np.sqrt((np.abs(qddot) / limits.acceleration).max())))
            factor = max(factor, _torque_used(limits, self.curve(s), qdot, qddot))
            if limits.tool is not None:
                factor = max(factor, float(limits.tool(self.curve(s), qdot).max()))
        return factor


def _spline(curve: Any, s: Array) -> tuple[Array, Array, Array, Array]:
    """Evaluate a cubic spline and its derivatives (K, n) in one go."""
    i = np.clip(np.searchsorted(curve.x, s, side="right") - 1, 0, len(curve.x) - 2)
    u, (d, c, b, a) = (s - curve.x[i])[:, None], curve.c[:, i]
    return a + u * (b + u * (c + u * d)), b + u * (2 * c + 3 * u * d), 2 * c + 6 * u * d, 6 * d


def most_used(limits: Limits, Q: Array, qdot: Array, qddot: Array, qdddot: Array) -> float:
    """By what factor time has to be stretched for a motion (T, n) to keep the limits; 1 if it
    does."""
    factor = max(1.0, float((np.abs(qdot) / limits.velocity).max()))
    factor = max(factor, float(np.sqrt((np.abs(qddot) / limits.acceleration).max())))
    if limits.jerk is not None:
        factor = max(factor, float(np.cbrt((np.abs(qdddot) / limits.jerk).max())))
    if limits.tool is not None:
        factor = max(factor, float(limits.tool(Q, qdot).max()))
    return max(factor, _torque_used(limits, Q, qdot, qddot))


def _torque_used(limits: Limits, Q: Array, qdot: Array, qddot: Array) -> float:
    """By what factor time has to be stretched for the torques of a motion (T, n) to be within
    theirs."""
    factor = 1.0
    if limits.torque is None or limits.dynamics is None:
        return factor
    for q, v, a in zip(Q, qdot, qddot, strict=True):
        weight = limits.dynamics(q, 0 * v, 0 * v)
        moving = limits.dynamics(q, v, a) - weight  # goes with the square of the speed
        available = np.where(moving > 0, limits.torque - weight, limits.torque + weight)
        factor = max(factor, float(np.sqrt((np.abs(moving) / np.maximum(available, 1e-9)).max())))
    return factor


class Profile:
    """Runs one after the other, with stays between them, over a few cycles.

    Attributes
    ----------
    marks : (cycles + 1,) array
        When each cycle begins and the last ends, s; before any stay there.
    stretch : float
        The factor that time needs for the limits to hold between the stages too.
    converged : bool
        Whether the second cycle begins as it ends, so that it can be repeated.
    phase : tuple of (K,) arrays
        Length travelled, and its rate.
    """

    def __init__(
        self,
        runs: list[Segment],
        stays: list[float],
        stops: list[int],
        ends: list[int],
        limits: Limits,
    ) -> None:
        self.runs = runs
        took = np.array([run.t[-1] for run in runs])
        self.starts = np.cumsum(stays) + np.concatenate([[0.0], np.cumsum(took)[:-1]])
        marks, speeds = [0.0], [0.0]
        for k in ends[1:]:
            j = int(np.searchsorted(stops, k, side="left")) - 1
            passed = runs[j].passed[[k - stops[j]]]
            marks.append(float(self.starts[j] + passed[0]))
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

    def positions(self, clock: Array) -> Array:
        """Joints (T, n) at times (T,); at rest before the start and after the end."""
        which = np.clip(
            np.searchsorted(self.starts, clock, side="right") - 1, 0, len(self.runs) - 1
        )
        Q = np.empty((len(clock), self.runs[0].curve(0.0).size))
        for j in np.unique(which):
            rows, run = which == j, self.runs[j]
            Q[rows] = run.curve(run.at(np.clip(clock[rows] - self.starts[j], 0.0, run.t[-1])))
        return Q

    def derivatives(self, clock: Array) -> Array:
        """Joints and their first three derivatives (4, T, n) at times (T,); at rest before and
        after the profile."""
        which = np.clip(
            np.searchsorted(self.starts, clock, side="right") - 1, 0, len(self.runs) - 1
        )
        found = np.zeros((4, len(clock), self.runs[0].curve(0.0).size))
        for j in np.unique(which):
            rows, run = which == j, self.runs[j]
            t = clock[rows] - self.starts[j]
            found[:, rows] = run.derivatives(np.clip(t, 0.0, run.t[-1]))
            found[1:, np.flatnonzero(rows)[(t < 0) | (t > run.t[-1])]] = 0.0
        return found


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A profile as a function of time, its second cycle repeated.

    Attributes
    ----------
    profile
        Phase-plane profile of a few cycles.
    factor
        By which its time is stretched.
    lead
        Time at rest before it, s.
    begin, period : float
        When the second cycle begins, and how long it takes, s.
    more : int
        How often it is repeated.
    """

    profile: Profile
    factor: float
    lead: float
    begin: float
    period: float
    more: int

    def derivatives(self, t: Array) -> Array:
        """Evaluate q and its first three derivatives (4, T, n) at times (T,) of the motion's
        samples."""
        clock = t - self.lead
        if self.more:
            again = np.floor((clock - self.begin) / self.period)
            clock = clock - self.period * np.clip(again, 0, self.more)
        found = self.profile.derivatives(clock / self.factor)
        return found / self.factor ** np.arange(4)[:, None, None]


def corners_of(Q: Array, candidates: Iterable[int], bend: float = _BEND) -> list[int]:
    """Find the points (T, n) of a joint path where its direction jumps: among the candidates, and
    cusps anywhere."""
    steps = np.diff(Q, axis=0)
    sizes = np.linalg.norm(steps, axis=1)
    cosine = np.einsum("ij,ij->i", steps[1:], steps[:-1]) / np.maximum(
        sizes[1:] * sizes[:-1], 1e-300
    )
    found = set((np.flatnonzero(cosine < 0.5) + 1).tolist())  # cusps
    marks = sorted({0, len(Q) - 1, *candidates})
    for before, at, after in zip(marks[:-2], marks[1:-1], marks[2:], strict=True):
        into, out = (
            _tangent(Q[max(before, at - 3) : at + 1][::-1]),
            _tangent(Q[at : min(after, at + 3) + 1]),
        )
        if np.arccos(np.clip(-into @ out, -1, 1)) > bend:
            found.add(at)
    return sorted(found)


def _tangent(points: Array) -> Array:
    """Unit tangent of a curve at the first of a few points (k, n)."""
    x = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    if x[-1] == 0:
        return np.zeros(points.shape[1])
    slope = np.linalg.solve(np.vander(x / x[-1], increasing=True), points)[1]
    return slope / max(np.linalg.norm(slope), 1e-300)


def fastest(Q: Array, limits: Limits, stages: float = STAGES) -> Segment:
    """Find the time-optimal profile along a smooth joint path (T, n), from rest to rest, in at
    least ``stages`` stages.

    Raises
    ------
    InputError
        If no speed at all is within the limits: a joint's torque does not hold the arm.
    """
    needed("toppra", by="a motion from rest to rest")
    import toppra
    from toppra.algorithm import TOPPRA
    from toppra.constraint import (
        JointAccelerationConstraint,
        JointTorqueConstraint,
        JointVelocityConstraint,
        JointVelocityConstraintVarying,
    )

    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(Q, axis=0), axis=1))])
    curve = toppra.SplineInterpolator(s, Q, bc_type="not-a-knot")
    finer = int(np.ceil(max(stages, LEAST_STAGES) / (len(s) - 1)))
    grid = np.interp(np.arange(finer * (len(s) - 1) + 1) / finer, np.arange(len(s)), s)
    velocity = JointVelocityConstraint(np.minimum(limits.velocity, 1e6))
    if limits.tool is not None:
        velocity = JointVelocityConstraintVarying(lambda s: _speeds_at(limits, curve, s))
    constraints = [velocity, JointAccelerationConstraint(limits.acceleration)]
    if limits.torque is not None:
        torque = np.stack([-limits.torque, limits.torque], axis=1)
        constraints.append(JointTorqueConstraint(limits.dynamics, torque, np.zeros(len(torque))))
        constraints[-1].set_discretization_type(1)
    solver = TOPPRA(
        constraints, curve, grid, solver_wrapper="seidel", parametrizer="ParametrizeConstAccel"
    )
    _, speed, _ = solver.compute_parameterization(0.0, 0.0)
    if speed is None or not np.isfinite(speed).all() or not (speed[1:-1] > 0).all():
        torque_bound = limits.torque is not None
        why = (
            "the torque limits do not hold the arm somewhere"
            if torque_bound
            else "the path is too rough"
        )
        raise InputError(f"no speed along this joint path is within the limits: {why}")
    t = np.concatenate([[0.0], np.cumsum(2 * np.diff(grid) / (speed[1:] + speed[:-1]))])
    return Segment(curve.cspl, grid, speed, t, t[::finer])


def _speeds_at(limits: Limits, curve: Any, s: float) -> Array:
    """Lower and upper speeds (n, 2) of the joints at s with which the tool keeps its limit too."""
    slope = curve(np.array([s]), 1)
    rate = limits.most_rate(curve(np.array([s])), slope)
    speeds = np.minimum(np.minimum(limits.velocity, 1e6), np.abs(slope[0]) * rate + 1e-12)
    return np.stack([-speeds, speeds], axis=1)
