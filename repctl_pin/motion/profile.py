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

STAGES = 450
"""Stages of a cycle's profile, at least: so many keep the limits exceeded by less than 2 % between
them."""

_LEAST_STAGES = 50
"""Stages between two stops, at least."""


@dataclass(frozen=True, eq=False)
@read_only
class Limits:
    """What the joints may do: speed and acceleration (n,), and torque where its dynamics are
    given."""

    velocity: Array
    acceleration: Array
    torque: Array | None = None
    dynamics: InverseDynamics | None = None


@dataclass(frozen=True, eq=False)
@read_only
class Run:
    """A smooth part of a joint path, from stop to stop, and its profile.

    ``s`` is the length along the joints; between two stages s̈ is constant.

    Attributes
    ----------
    curve
        q(s), by scipy's spline.
    s, speed, t : (K,) arrays
        The stages, ṡ there, and the time from the run's start.
    """

    curve: Any
    s: Array
    speed: Array
    t: Array

    def at(self, t: Array) -> Array:
        """Find s at times (T,) from the run's start."""
        i = np.clip(np.searchsorted(self.t, t, side="right") - 1, 0, len(self.s) - 2)
        push = (self.speed[i + 1] ** 2 - self.speed[i] ** 2) / (2 * (self.s[i + 1] - self.s[i]))
        tau = t - self.t[i]
        return self.s[i] + self.speed[i] * tau + 0.5 * push * tau**2

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
            if limits.torque is not None and limits.dynamics is not None:
                for q, v, a in zip(self.curve(s), qdot, qddot, strict=True):
                    weight = limits.dynamics(q, 0 * v, 0 * v)
                    moving = limits.dynamics(q, v, a) - weight  # goes with the square of the speed
                    room = np.where(moving > 0, limits.torque - weight, limits.torque + weight)
                    factor = max(
                        factor, float(np.sqrt((np.abs(moving) / np.maximum(room, 1e-9)).max()))
                    )
        return factor


class Profile:
    """Runs one after the other, with stays between them, over a few cycles.

    Attributes
    ----------
    marks : (cycles + 1,) array
        When each cycle begins and the last ends, s; before any stay there.
    stretch : float
        The factor that time needs for the limits to hold between the stages too.
    settled : bool
        Whether the second cycle begins as it ends, so that it can be repeated.
    phase : tuple of (K,) arrays
        Length travelled, and its rate.
    """

    def __init__(
        self, runs: list[Run], stays: list[float], stops: list[int], ends: list[int], limits: Limits
    ) -> None:
        self.runs = runs
        took = np.array([run.t[-1] for run in runs])
        self.starts = np.cumsum(stays) + np.concatenate([[0.0], np.cumsum(took)[:-1]])
        marks, speeds = [0.0], [0.0]
        for k in ends[1:]:
            j = int(np.searchsorted(stops, k, side="left")) - 1
            stage = (k - stops[j]) * (len(runs[j].s) - 1) // (stops[j + 1] - stops[j])
            marks.append(float(self.starts[j] + runs[j].t[stage]))
            speeds.append(float(runs[j].speed[stage]))
        self.marks = np.array(marks)
        self.stretch = max(run.excess(limits) for run in runs)
        top = max(float(run.speed.max()) for run in runs)
        self.settled = len(ends) > 3 and abs(speeds[1] - speeds[2]) < 1e-6 * top
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


def corners_of(Q: Array, candidates: Iterable[int]) -> list[int]:
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
        if np.arccos(np.clip(-into @ out, -1, 1)) > _BEND:
            found.add(at)
    return sorted(found)


def _tangent(points: Array) -> Array:
    """Unit tangent of a curve at the first of a few points (k, n)."""
    x = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    if x[-1] == 0:
        return np.zeros(points.shape[1])
    slope = np.linalg.solve(np.vander(x / x[-1], increasing=True), points)[1]
    return slope / max(np.linalg.norm(slope), 1e-300)


def fastest(Q: Array, limits: Limits, stages: float = STAGES) -> Run:
    """Find the time-optimal profile along a smooth joint path (T, n), from rest to rest, in so many
    stages or more.

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
    )

    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(Q, axis=0), axis=1))])
    curve = toppra.SplineInterpolator(s, Q, bc_type="not-a-knot")
    finer = int(np.ceil(max(stages, _LEAST_STAGES) / (len(s) - 1)))
    grid = np.interp(np.arange(finer * (len(s) - 1) + 1) / finer, np.arange(len(s)), s)
    velocity = JointVelocityConstraint(np.minimum(limits.velocity, 1e6))
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
    return Run(curve.cspl, grid, speed, t)
