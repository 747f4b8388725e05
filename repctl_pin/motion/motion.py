"""What a strategy did on a closed path: a result that judges itself."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arguments import stacks, whole
from ..errors import InputError
from ..regions import Bounded
from ..robot.bodies import Nearest, bodies_of
from ..robot.task import Task
from ..strategies.control_step import speeds
from .paths import TaskPath

Array = NDArray[np.float64]

CLOSED = 1e-6
"""A motion that comes back so near, rad or m, is taken as closed: the rest is the integrator's error."""


COARSE = 100
"""Points of a cycle, at most, at which studies and pages look at bodies."""


@dataclass(frozen=True)
class Motion:
    """What a strategy did on a closed path.

    Norms over joints count a radian and a metre alike where an arm has both kinds of joints.

    Attributes
    ----------
    task, path
        What was moved, and along what.
    t : (T + 1,) array
        Time, s.
    q, qdot : (T + 1, n) arrays
        Joint positions and velocities, rad or m, and per second.
    cycles, steps : int
        T = cycles · steps.
    drift : (cycles,) array
        ``‖q(after cycle k) − q(0)‖``, k = 1, 2, …
    tracking_error : (T + 1,) array
        Distance of the frame from where it should be, m, in the task's coordinates.
    turning_error : (T + 1,) array
        The same for orientation, rad; 0 where the task has none.
    damping : float
        The largest λ that was used near a singularity; 0 where every step was exact.
    region : Bounded, optional
        Ω, where the control was designed: see :attr:`outside`.

    Examples
    --------
    >>> motion.q.shape, motion.drift.shape
    ((201, 3), (2,))
    >>> bool(motion.tracking_error.max() < 1e-6)  # m
    True
    >>> bool(motion.limit_margin.min() > 0)  # rad
    True
    """

    task: Task
    path: TaskPath
    t: Array
    q: Array
    qdot: Array
    cycles: int
    steps: int
    drift: Array
    tracking_error: Array
    turning_error: Array
    damping: float = 0.0
    region: Bounded | None = None

    def __repr__(self) -> str:
        task, cycles = self.task, "1 cycle" if self.cycles == 1 else f"{self.cycles} cycles"
        drift = " … ".join(f"{value:.3g}" for value in dict.fromkeys((self.drift[0], self.drift[-1])))
        return f"<Motion of {task.robot.name} {task.frame}: {self.path.name}, {cycles}, drift {drift}>"

    @property
    def cycle_drift(self) -> Array:
        """``‖q(after cycle k) − q(after cycle k − 1)‖``, k = 1, 2, …: what each cycle adds, (cycles,)."""
        ends = self.q[:: self.steps]
        return np.linalg.norm(np.diff(ends, axis=0), axis=1)

    @property
    def outside(self) -> float | None:
        """Share of the motion that lies outside Ω, where no promise is made; None where there is no Ω."""
        return None if self.region is None else float(np.mean(self.region.ratio(self.q) > 1 + 1e-9))

    @property
    def speed(self) -> Array:
        """Joint speed ``‖q̇‖`` along the motion: (T + 1,)."""
        return np.linalg.norm(self.qdot, axis=1)

    @property
    def rms_speed(self) -> float:
        """Root mean square over time of the steps' mean joint speed, ``√(Σ ‖Δq‖²/Δt / Σ Δt)``."""
        times = np.diff(self.t)
        return float(np.sqrt(np.sum(np.sum(np.diff(self.q, axis=0) ** 2, axis=1) / times) / times.sum()))

    @property
    def peak_speed(self) -> float:
        """Largest joint speed."""
        return float(self.speed.max())

    @property
    def speed_ratio(self) -> float:
        """Largest share of a joint's speed limit that was used; above 1 the path must be slowed down."""
        return float(self._speed_shares.max())

    @property
    def fastest_joint(self) -> str:
        """The joint that uses the largest share of its speed limit."""
        return self.task.robot_joints[int(self._speed_shares.argmax())]

    @property
    def _speed_shares(self) -> Array:
        """The largest share of its speed limit that each of the robot's joints uses: (n,)."""
        return np.max(np.abs(self.task.joints(self.qdot)) / self.task.joint_limits[2], axis=0)

    @property
    def limit_margin(self) -> Array:
        """Distance of each of the robot's joints to its nearer limit: (T + 1, n); negative outside, inf where none."""
        return self.task.limit_margin(self.q)

    @cached_property
    def body_distance(self) -> Array:
        """Least distance between the robot's bodies, or to its surroundings: (T + 1,), m; below 0 they touch.

        Bodies are the URDF's collision shapes, meshes as their convex hulls, 0 where only these touch; inf where there
        are none. See :class:`Bodies`.
        """
        return bodies_of(self.task).distances(self.q)

    @cached_property
    def nearest_bodies(self) -> tuple[float, Nearest]:
        """When two bodies come nearest, in cycles and fractions of one, and which they are."""
        row = int(np.argmin(self.body_distance))
        return row / self.steps, bodies_of(self.task).nearest(self.q[row])

    @cached_property
    def first_touch(self) -> tuple[float, tuple[str, str]] | None:
        """The first time two bodies touch: (cycle, as :attr:`first_violation` counts; their links), or None."""
        touch = self.body_distance < 0
        if not touch.any():
            return None
        row = int(np.argmax(touch))
        return row / self.steps, bodies_of(self.task).nearest(self.q[row]).links

    @property
    def closes(self) -> bool:
        """Whether every cycle ends at the joints it began with, within 1e-6 rad or m."""
        return bool(self.drift.max() < CLOSED)

    @property
    def first_violation(self) -> tuple[float, str] | None:
        """The first time a joint leaves its limits: (cycle, joint name), or None.

        The cycle is counted in fractions: 2.5 is the middle of the third.
        """
        outside = self.limit_margin < -1e-9
        if not outside.any():
            return None
        row = int(np.argmax(outside.any(axis=1)))
        joint = self.task.robot_joints[int(np.argmin(self.limit_margin[row]))]
        return row / self.steps, joint

    @property
    def broken_cycle(self) -> int:
        """Number, from 1, of the cycle in which a joint first leaves its limits; 0 if none does."""
        violation = self.first_violation
        return 0 if violation is None else cycle_of(violation[0], self.cycles)

    def cycle(self, k: int) -> Array:
        """Joint positions of cycle k, counted from 0, both ends included: (steps + 1, n)."""
        k = whole(k, "the cycle's number")
        if k >= self.cycles:
            raise InputError(f"there is no cycle {k}; this motion has {self.cycles}, counted from 0")
        return self.q[k * self.steps : (k + 1) * self.steps + 1]

    def thinned(self, most: int) -> Motion:
        """Keep at most so many points of a cycle, the ends of cycles among them."""
        rows = rows_of(self, whole(most, "most", 1))
        kept = {name: getattr(self, name)[rows] for name in ("t", "q", "qdot", "tracking_error", "turning_error")}
        return replace(self, steps=len(rows) // self.cycles, **kept)

    @cached_property
    def coarse(self) -> Motion:
        """The same at no more than 100 points a cycle: enough to see how near bodies come."""
        return self.thinned(COARSE)

    def slowed(self, factor: float) -> Motion:
        """Let every cycle take ``factor`` times as long: for controls ``q̇ = G ẋ``, whose joint path stays the same."""
        return replace(self, t=self.t[0] + (self.t - self.t[0]) * factor, qdot=self.qdot / factor)

    def retimed(self, limit: ArrayLike | None = None) -> Motion:
        """Slow the motion down where a joint is too fast: the joint path stays the same.

        Scaling ẋ by a positive number scales q̇ of every strategy ``q̇ = G ẋ`` alike. Each step is stretched
        by the largest share of a speed limit that it, or one of its ends, uses; steps below the limits keep
        their time.

        Parameters
        ----------
        limit : float or (n,) array, optional
            Speeds of the robot's joints, rad/s or m/s; by default the arm's own.

        Returns
        -------
        Motion
            With ``speed_ratio`` at most 1 where the limits are the arm's.

        Raises
        ------
        InputError
            If a limit is not above 0, or has the wrong size.
        """
        task = self.task
        most = speeds(task.joint_limits[2] if limit is None else limit, task.n)
        q, qdot = self.joints(self.q), self.joints(self.qdot)
        at_ends = np.maximum((np.abs(qdot) / most).max(axis=1), 1.0)  # (T + 1,)
        times = np.diff(self.t)
        between = (np.abs(np.diff(q, axis=0)) / times[:, None] / most).max(axis=1)  # (T,)
        stretch = np.maximum(np.maximum(at_ends[1:], at_ends[:-1]), between)
        t = self.t[0] + np.concatenate([[0.0], np.cumsum(times * stretch)])
        return replace(self, t=t, qdot=self.qdot / at_ends[:, None])

    def joints(self, values: ArrayLike) -> Array:
        """Turn positions or velocities (..., n) of the task's coordinates ψ into those of the robot's joints."""
        (values,) = stacks(("values", values, f"{self.task.n}"))
        return self.task.joints(values)


def cycle_of(moment: float, cycles: int) -> int:
    """Number, from 1, of the cycle that a moment is in, which counts cycles in fractions: the end is in the last."""
    return min(int(moment) + 1, cycles)


def rows_of(motion: Motion, most: int) -> NDArray[np.intp]:
    """Choose rows of a motion, at most so many a cycle, the ends of cycles among them."""
    cycle = np.rint(np.linspace(0, motion.steps, min(motion.steps, most) + 1)).astype(np.intp)[:-1]
    return np.append((np.arange(motion.cycles)[:, None] * motion.steps + cycle).ravel(), motion.cycles * motion.steps)
