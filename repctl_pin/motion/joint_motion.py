"""Joint motions over several cycles: speeds, limit margins, body distances and violations.

A violation is a joint beyond its limit, or a collision of two bodies. A time in cycles has
fractions: 2.5 is the middle of the third cycle. J⁺ is the pseudoinverse, the usual controller.

``Clearance`` is the minimum body distance of a motion, and its first collision. ``Nearest`` is the
closest pair of bodies at a configuration, and its distance, m. ``JointMotion`` is a joint motion
over several cycles: q, q̇ (T + 1, n) at times t, without the path of the frame. ``Violation`` is
the first violation of a joint limit or the first collision, with its time and its joint or links.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..base.arguments import Array, as_int, read_only
from ..base.errors import InputError
from ..model.bodies import Nearest, bodies_of
from ..model.clearance import Clearance
from ..model.length import joint_scale
from ..model.task import Task

if TYPE_CHECKING:
    from typing_extensions import Self


_COARSE = 100
"""Maximum number of points per cycle at which studies and pages compute body distances."""

TOO_FAST = 1 + 1e-9
"""Ratio of joint speed to limit above which a joint counts as too fast."""

CLOSED = 1e-5
"""Maximum distance of the ends of a cycle that counts as closed, rad or arm lengths; it allows for
integration errors."""


@dataclass(frozen=True, eq=False)
@read_only
class JointMotion:
    """Joint motion over several cycles, independent of the path of the frame.

    A time in cycles has fractions: 2.5 is the middle of the third cycle.

    Attributes
    ----------
    task : Task
        Task of the joints.
    t : (T + 1,) array
        Time, s.
    q, qdot : (T + 1, n) arrays
        Joint positions and velocities, rad or m, and per second.
    cycles, steps : int
        Number of cycles, and of steps per cycle: T = cycles · steps.
    """

    task: Task
    t: Array
    q: Array
    qdot: Array
    cycles: int
    steps: int

    @property
    def cycle_drift(self) -> Array:
        """Joint displacement per cycle, (cycles,), rad or m.

        ``‖q(after cycle k) − q(after cycle k − 1)‖``, k = 1, 2, … This displacement shows whether
        the drift of a controller grows or fades. The displacement is 0 for a repeatable controller.
        """
        ends = self.q[:: self.steps]
        return np.linalg.norm(np.diff(ends, axis=0), axis=1)

    @property
    def closes(self) -> bool:
        """True if every cycle ends in the configuration in which the motion began.

        The tolerance is 1e-5 rad, or 1e-5 arm lengths for prismatic joints, to allow for
        integration errors.
        """
        return bool(self._gaps.max() < CLOSED)

    @property
    def first_closes(self) -> bool:
        """True if the first cycle ends in its start configuration; see :attr:`closes`."""
        return bool(self._gaps[1] < CLOSED)

    @property
    def _gaps(self) -> Array:
        """Distance in joint space of the end of each cycle from the start: (cycles + 1,), rad.

        Prismatic joints count in arm lengths. The first entry, 0, is that of the start itself.
        """
        gaps = (self.q[:: self.steps] - self.q[0]) / joint_scale(self.task, self.q[0])
        return np.linalg.norm(gaps, axis=1)

    @property
    def speed(self) -> Array:
        """Joint speed ``‖q̇‖`` along the motion: (T + 1,), rad/s or m/s."""
        return np.linalg.norm(self.qdot, axis=1)

    @property
    def rms_speed(self) -> float:
        """Joint speed, rms over time: ``√(Σ ‖Δq‖²/Δt / Σ Δt)``, rad/s or m/s.

        The sums are over the steps, with the mean velocity Δq/Δt of each step.
        """
        times = np.diff(self.t)
        return float(
            np.sqrt(np.sum(np.sum(np.diff(self.q, axis=0) ** 2, axis=1) / times) / times.sum())
        )

    @property
    def first_rms_speed(self) -> float:
        """Joint speed ‖q̇‖, rms over the samples of the first cycle, rad/s or m/s.

        Controllers are compared over the first cycle, because a controller that drifts, such as
        J⁺, is at other configurations later.
        """
        return float(np.sqrt(np.mean(self.speed[: self.steps] ** 2)))

    @property
    def peak_speed(self) -> float:
        """Maximum joint speed ‖q̇‖, rad/s or m/s."""
        return float(self.speed.max())

    @property
    def speed_ratio(self) -> float:
        """Maximum ratio of a joint's speed to its limit, over all joints and samples.

        If the ratio is above 1, multiply the motion's duration by it to keep the speed limits, for
        example with :meth:`Motion.slowed`.
        """
        return float(self._speed_shares.max())

    @property
    def fastest_joint(self) -> str:
        """Name of the joint with the largest ratio of speed to limit."""
        return self.task.joint_names[int(self._speed_shares.max(axis=0).argmax())]

    @property
    def first_overspeed(self) -> tuple[float, str] | None:
        """First violation of a speed limit: (time in cycles, joint name), or None."""
        return self._first(self._speed_shares > TOO_FAST, -self._speed_shares)

    @property
    def worst_overspeed(self) -> tuple[float, str, float] | None:
        """Largest violation of a speed limit: (time in cycles, joint name, speed / limit), or None.

        The ratio is :attr:`speed_ratio`.
        """
        shares = self._speed_shares
        row, joint = divmod(int(shares.argmax()), shares.shape[1])
        ratio = float(shares[row, joint])
        return (row / self.steps, self.task.joint_names[joint], ratio) if ratio > TOO_FAST else None

    @property
    def _speed_shares(self) -> Array:
        """Ratio of speed to limit for each of the robot's joints: (T + 1, n); 0 without a limit."""
        return np.abs(self.qdot) / self.task.velocity_limit

    @property
    def limit_margin(self) -> Array:
        """Distance of each of the robot's joints to its nearer limit: (T + 1, n), rad or m.

        It is negative outside the limits, and inf for a joint without limits.
        """
        return self.task.limit_margin(self.q)

    @cached_property
    def body_distance(self) -> Array:
        """Minimum body distance at each sample: (T + 1,), m; below 0 in a collision.

        The minimum is over pairs of the robot's own bodies, and pairs of one of them and a body of
        the surroundings. Bodies are the URDF's collision shapes; a mesh of the robot is replaced by
        its convex hull. The distance is 0 if the hulls overlap but the meshes do not collide, and
        inf if there is no pair to measure. Some pairs are not measured, such as two links that a
        joint connects; :class:`Bodies` lists them.
        """
        distances = bodies_of(self.task).distances(self.q)
        distances.setflags(write=False)
        return distances

    @cached_property
    def clearance(self) -> Clearance:
        """Minimum body distance and first collision, at the samples and between them.

        Between two samples, the joints move on a straight line. Distances are measured at about 100
        samples per cycle. Bounds on the distances show where more samples are needed. For a few
        pairs of links, such as those whose convex hulls always overlap, no distance is measured;
        they are tested for collisions where the bounds do not exclude one.
        """
        return self._clearance_from(_COARSE)

    def _clearance_from(self, most: int) -> Clearance:
        """Compute :attr:`clearance`, with distances at about ``most`` samples per cycle."""
        return bodies_of(self.task)._along(self.q, rows_of(self, most))

    @property
    def nearest_bodies(self) -> tuple[float, Nearest]:
        """Minimum body distance: (time in cycles, distance and links of the two bodies)."""
        found = self.clearance
        return found.at / self.steps, Nearest(found.distance, found.links)

    @property
    def first_touch(self) -> tuple[float, tuple[str, str]] | None:
        """First collision: (time in cycles, names of the two links), or None.

        The collision may lie between two samples.
        """
        touch = self.clearance.touch
        return None if touch is None else (touch[0] / self.steps, touch[1])

    @property
    def first_violation(self) -> tuple[float, str] | None:
        """First violation of position limits: (time in cycles, joint name), or None.

        A drifting controller often exceeds a limit only after many cycles.
        """
        return self._first(self.limit_margin < -1e-9, self.limit_margin)

    def _first(self, broken: NDArray[np.bool_], margins: Array) -> tuple[float, str] | None:
        """Find the first violation: (time in cycles, joint name), or None.

        ``broken`` (T + 1, n) is a mask: True where a joint violates a limit. The joint named is the
        one with the smallest of ``margins`` (T + 1, n) at the first sample with a violation.
        """
        if not broken.any():
            return None
        row = int(np.argmax(broken.any(axis=1)))
        return row / self.steps, self.task.joint_names[int(np.argmin(margins[row]))]

    @property
    def broken_cycle(self) -> int:
        """Number, from 1, of the first cycle in which a joint exceeds a position limit, or 0."""
        violation = self.first_violation
        return 0 if violation is None else cycle_of(violation[0], self.cycles)

    def cycle(self, k: int) -> Array:
        """Return the joint positions of cycle k, counted from 0, with both ends: (steps + 1, n)."""
        k = as_int(k, "the cycle number")
        if k >= self.cycles:
            raise InputError(
                f"there is no cycle {k}; this motion has {self.cycles} cycles, counted from 0"
            )
        return self.q[k * self.steps : (k + 1) * self.steps + 1]

    def thinned(self, most: int) -> Self:
        """Return the motion with at most ``most`` steps per cycle, by leaving out samples.

        The ends of the cycles are kept.
        """
        rows = rows_of(self, as_int(most, "most", 1))
        arrays = {field.name: getattr(self, field.name) for field in fields(self)}
        kept: dict[str, Any] = {
            k: v[rows]
            for k, v in arrays.items()
            if isinstance(v, np.ndarray) and len(v) == len(self.q)
        }
        return replace(self, steps=len(rows) // self.cycles, **kept)


def cycle_of(moment: float, cycles: int) -> int:
    """Return the number, counted from 1, of the cycle at a time in cycles: 2.5 is in cycle 3.

    A time between two cycles belongs to the later one: 2.0 is in cycle 3. The end of the motion
    belongs to its last cycle, the one with the number ``cycles``.
    """
    return min(int(moment) + 1, cycles)


def rows_of(motion: JointMotion, most: int) -> NDArray[np.intp]:
    """Return the indices of at most ``most`` samples per cycle, and of the motion's last sample.

    The samples are evenly spaced, up to rounding, and include the ends of all cycles.
    """
    cycle = np.rint(np.linspace(0, motion.steps, min(motion.steps, most) + 1)).astype(np.intp)[:-1]
    return np.append(
        (np.arange(motion.cycles)[:, None] * motion.steps + cycle).ravel(),
        motion.cycles * motion.steps,
    )


@dataclass(frozen=True)
class Violation:
    """First violation of a joint limit, or first collision, with its time and its joint or links.

    Attributes
    ----------
    moment : float
        Time in cycles: 2.5 is the middle of the third cycle.
    cycle : int
        Number of that cycle, counted from 1.
    names : tuple of str
        Name of the joint, or of the two links.
    """

    moment: float
    cycle: int
    names: tuple[str, ...]

    def __str__(self) -> str:
        names = " and ".join(self.names)
        share = self.moment - self.cycle + 1
        into = f"{100 * share:.0f} % into cycle {self.cycle}"
        verb = "exceeds its limits" if len(self.names) == 1 else "collide"
        return f"{names} {verb} {into if self.moment else 'at the start'}"


def violations_of(motion: JointMotion) -> tuple[Violation, ...]:
    """List the first joint-limit violation and the first collision of a motion, in order of time.

    The tuple is empty if there is neither.
    """
    beyond = motion.first_violation
    touch = motion.first_touch
    found: list[tuple[float, tuple[str, ...]]] = [(beyond[0], beyond[1:])] if beyond else []
    found += [touch] if touch else []
    return tuple(
        Violation(moment, cycle_of(moment, motion.cycles), names) for moment, names in sorted(found)
    )


def checked_words(motion: JointMotion) -> str:
    """Return the text " at N points" to qualify a body distance that was only sampled.

    N is the number of points of the whole motion at which distances were measured. The text is
    empty if the distance also holds between the samples, and for a motion with a collision.
    """
    found = motion.clearance
    return "" if found.between or found.touch else f" at {found.points:,} points"
