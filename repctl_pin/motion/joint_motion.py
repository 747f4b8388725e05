"""Joints that move, cycle after cycle: their speeds, limits and bodies, and where they go beyond
these."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arguments import Array, as_int, as_matrices, read_only
from ..errors import InputError
from ..robot.bodies import Nearest, bodies_of
from ..robot.length import joint_scale
from ..robot.task import Task

if TYPE_CHECKING:
    from typing_extensions import Self


COARSE = 100
"""Points of a cycle, at most, at which studies and pages look at bodies."""

CLOSED = 1e-5
"""A motion is closed if each cycle ends so near its start, in rad or arm lengths: the rest is
integration error."""


@dataclass(frozen=True, eq=False)
@read_only
class JointMotion:
    """What joints do, whatever path their frame takes.

    Attributes
    ----------
    task : Task
        Whose joints they are.
    t : (T + 1,) array
        Time, s.
    q, qdot : (T + 1, n) arrays
        Joint positions and velocities, rad or m, and per second.
    cycles, steps : int
        T = cycles · steps.
    """

    task: Task
    t: Array
    q: Array
    qdot: Array
    cycles: int
    steps: int

    @property
    def cycle_drift(self) -> Array:
        """``‖q(after cycle k) − q(after cycle k − 1)‖``, k = 1, 2, …: what each cycle adds,
        (cycles,)."""
        ends = self.q[:: self.steps]
        return np.linalg.norm(np.diff(ends, axis=0), axis=1)

    @property
    def closes(self) -> bool:
        """Whether every cycle ends in the configuration it began in.

        To 1e-5 rad, and for prismatic joints to 1e-5 of the arm's length: the rest is integration
        error."""
        gaps = (self.q[:: self.steps] - self.q[0]) / joint_scale(self.task, self.q[0])
        return bool(np.linalg.norm(gaps, axis=1).max() < CLOSED)

    @property
    def speed(self) -> Array:
        """Joint speed ``‖q̇‖`` along the motion: (T + 1,)."""
        return np.linalg.norm(self.qdot, axis=1)

    @property
    def rms_speed(self) -> float:
        """Root mean square over time of the steps' mean joint speed, ``√(Σ ‖Δq‖²/Δt / Σ Δt)``."""
        times = np.diff(self.t)
        return float(
            np.sqrt(np.sum(np.sum(np.diff(self.q, axis=0) ** 2, axis=1) / times) / times.sum())
        )

    @property
    def first_rms_speed(self) -> float:
        """Root mean square of ‖q̇‖ over the first cycle, in which controls can be compared: later,
        J⁺ is elsewhere."""
        return float(np.sqrt(np.mean(self.speed[: self.steps] ** 2)))

    @property
    def peak_speed(self) -> float:
        """Largest joint speed."""
        return float(self.speed.max())

    @property
    def speed_ratio(self) -> float:
        """Largest share of a joint's speed limit that was used; above 1 the path must be slowed
        down."""
        return float(self._speed_shares.max())

    @property
    def fastest_joint(self) -> str:
        """The joint that uses the largest share of its speed limit."""
        return self.task.robot_joints[int(self._speed_shares.max(axis=0).argmax())]

    @property
    def first_overspeed(self) -> tuple[float, str] | None:
        """The first time a joint moves faster than its speed limit: (cycle in fractions, joint
        name), or None."""
        return self._first(self._speed_shares > 1 + 1e-9, -self._speed_shares)

    @property
    def _speed_shares(self) -> Array:
        """The share of its speed limit that each of the robot's joints uses: (T + 1, n)."""
        return np.abs(self.task.joints(self.qdot)) / self.task.joint_limits[2]

    @property
    def limit_margin(self) -> Array:
        """Distance of each of the robot's joints to its nearer limit: (T + 1, n); negative outside,
        inf where none."""
        return self.task.limit_margin(self.q)

    @cached_property
    def body_distance(self) -> Array:
        """Smallest distance between the robot's bodies, or to its surroundings: (T + 1,), m; below
        0 they touch.

        Bodies are the URDF's collision shapes, meshes as their convex hulls. 0 if only hulls touch,
        inf without shapes. See :class:`Bodies`."""
        return bodies_of(self.task).distances(self.q)

    @cached_property
    def nearest_bodies(self) -> tuple[float, Nearest]:
        """When two bodies come nearest, in cycles and fractions of one, and which they are."""
        row = int(np.argmin(self.body_distance))
        return row / self.steps, bodies_of(self.task).nearest(self.q[row])

    @cached_property
    def first_touch(self) -> tuple[float, tuple[str, str]] | None:
        """The first time two bodies touch: (cycle, as :attr:`first_violation` counts; their links),
        or None."""
        touch = self.body_distance < 0
        if not touch.any():
            return None
        row = int(np.argmax(touch))
        return row / self.steps, bodies_of(self.task).nearest(self.q[row]).links

    @property
    def first_violation(self) -> tuple[float, str] | None:
        """The first time a joint leaves its limits: (cycle, joint name), or None.

        The cycle is counted in fractions: 2.5 is the middle of the third.
        """
        return self._first(self.limit_margin < -1e-9, self.limit_margin)

    def _first(self, broken: NDArray[np.bool_], margins: Array) -> tuple[float, str] | None:
        """The first moment at which a joint is too far out, and the joint that is then the farthest
        out; or None."""
        if not broken.any():
            return None
        row = int(np.argmax(broken.any(axis=1)))
        return row / self.steps, self.task.robot_joints[int(np.argmin(margins[row]))]

    @property
    def broken_cycle(self) -> int:
        """Number, from 1, of the cycle in which a joint first leaves its limits; 0 if none does."""
        violation = self.first_violation
        return 0 if violation is None else cycle_of(violation[0], self.cycles)

    def cycle(self, k: int) -> Array:
        """Joint positions of cycle k, counted from 0, both ends included: (steps + 1, n)."""
        k = as_int(k, "the cycle's number")
        if k >= self.cycles:
            raise InputError(
                f"there is no cycle {k}; this motion has {self.cycles}, counted from 0"
            )
        return self.q[k * self.steps : (k + 1) * self.steps + 1]

    def thinned(self, most: int) -> Self:
        """Keep at most so many points of a cycle, the ends of cycles among them."""
        rows = rows_of(self, as_int(most, "most", 1))
        arrays = {field.name: getattr(self, field.name) for field in fields(self)}
        kept: dict[str, Any] = {
            k: v[rows]
            for k, v in arrays.items()
            if isinstance(v, np.ndarray) and len(v) == len(self.q)
        }
        return replace(self, steps=len(rows) // self.cycles, **kept)

    @cached_property
    def coarse(self) -> Self:
        """The same at no more than 100 points per cycle: enough to see how close bodies come."""
        return self.thinned(COARSE)

    def joints(self, values: ArrayLike) -> Array:
        """Turn positions or velocities (..., n) of the task's coordinates ψ into those of the
        robot's joints."""
        (values,) = as_matrices(("values", values, f"{self.task.n}"))
        return self.task.joints(values)


def cycle_of(moment: float, cycles: int) -> int:
    """Number, from 1, of the cycle that a moment is in, which counts cycles in fractions: the end
    is in the last."""
    return min(int(moment) + 1, cycles)


def rows_of(motion: JointMotion, most: int) -> NDArray[np.intp]:
    """Choose rows of a motion, at most so many per cycle, the ends of cycles among them."""
    cycle = np.rint(np.linspace(0, motion.steps, min(motion.steps, most) + 1)).astype(np.intp)[:-1]
    return np.append(
        (np.arange(motion.cycles)[:, None] * motion.steps + cycle).ravel(),
        motion.cycles * motion.steps,
    )


@dataclass(frozen=True)
class Violation:
    """The first time a joint leaves its limits, or two bodies touch.

    Attributes
    ----------
    moment : float
        When, in cycles and fractions of one: 2.5 is the middle of the third.
    cycle : int
        Which cycle that is, from 1.
    names : tuple of str
        The joint, or the two links.
    """

    moment: float
    cycle: int
    names: tuple[str, ...]

    def __str__(self) -> str:
        names, share = " and ".join(self.names), self.moment - self.cycle + 1
        where = f"in cycle {self.cycle}, {share:.0%} of the way round"
        if len(self.names) == 1:
            return f"{names} leaves its limits {where}"
        return f"{names} touch {where if self.moment else 'from the start'}"


def violations_of(motion: JointMotion, bodies: JointMotion | None = None) -> tuple[Violation, ...]:
    """List the first limit that a motion leaves and the first touch of two bodies, whichever comes
    first.

    Parameters
    ----------
    motion
        What is looked at.
    bodies
        The same motion at fewer points, where bodies are to be looked at less often.
    """
    beyond, touch = motion.first_violation, (bodies or motion).first_touch
    found: list[tuple[float, tuple[str, ...]]] = [(beyond[0], beyond[1:])] if beyond else []
    found += [touch] if touch else []
    return tuple(
        Violation(moment, cycle_of(moment, motion.cycles), names) for moment, names in sorted(found)
    )


def refuse_violations(motion: JointMotion, remedy: str) -> None:
    """Refuse to give a robot a motion that leaves its limits or touches itself.

    Raises
    ------
    InputError
        The cycle, the moment and the joint or the links are named.
    """
    found = violations_of(motion)
    if found:
        raise InputError(f"{'; '.join(map(str, found))}: no file for a robot is written; {remedy}")
