"""Plans of the governor: a short motion and a stop, or a motion to rest at a target."""

from __future__ import annotations

from math import ceil, sqrt

import numpy as np

from ...arguments import Array
from ...errors import SingularityError
from ...strategies.repeatable import RepeatableInverse
from .course import Course, course_of
from .frame_motion import FrameMotion, brake, change_of_acceleration, landing
from .governor_law import (
    JERK,
    REGULAR,
    CommandLimits,
    Now,
    closing,
    fastest,
    longest_landing,
    regularity,
    shares_used,
    stop_time,
)
from .joint_polynomials import LONG, SHORT, LeafInterpolation, Plan
from .status import Status

MOST = 130
"""Maximum number of evaluations of the inverse in a tick."""

STRIDE = 0.004
"""Time between two plans, s."""

SAMPLES, MOST_SAMPLES = 16.0, 40
"""Number of samples of a plan whose check counts as one evaluation of the inverse, and maximum
number of evaluations that the check of a plan counts as."""

_REACH = 0.15
"""Joint motion, rad or m, over which a single polynomial is tried."""

_SHORT_WAY = 0.03
"""Joint distance to a target, rad or m, up to which the whole motion to rest is planned at once."""

_LONGER = (1.0, 1.15, 1.4)
_BRAKES = (0.95, 1.0, 1.05)
"""Durations of a motion to rest that are tried in turn, as multiples of the shortest one: _LONGER
if it begins near rest, _BRAKES if it begins at speed."""

_SETTLED = 3
"""Number of samples at rest after which all differences are 0."""


class Planner:
    """The plan that the governor follows, and the search for the next one.

    A new plan replaces it only if all its samples, up to rest, keep the limits.

    Parameters
    ----------
    inverse
        The repeatable inverse.
    bounds
        Limits of the commanded joints.

    Attributes
    ----------
    solver : LeafInterpolation
        Interpolation on the leaf, with the number of evaluations of the inverse.
    history : (3, n) array
        The last three commanded samples.
    plan : Plan
        The plan that is followed; ``tick`` ticks of it are over.
    """

    def __init__(self, inverse: RepeatableInverse, bounds: CommandLimits) -> None:
        self._inverse, self._task, self._bounds = inverse, inverse.task, bounds
        self.solver = LeafInterpolation(inverse)

    def start(self, q: Array) -> None:
        """Begin at rest at q (n,); the plans stay on its leaf."""
        self.solver.leaf = self._inverse.leaf(q)
        self.history = np.tile(q, (3, 1))
        start = course_of(self._task, self._inverse.region, q)
        self.plan, self.tick = Plan(q, np.zeros_like(q), start), _SETTLED
        self._longer, self._reach, self._turn = 1.0, _REACH, 0

    def next(self) -> Array:
        """Advance by one tick, and return the plan's sample (n,)."""
        self.tick += 1
        q = self.plan.at(self.tick * self._bounds.dt)
        self.history[:-1], self.history[-1] = self.history[1:].copy(), q
        return q

    def at_rest(self) -> bool:
        """Test whether the commanded samples no longer change."""
        return (self.tick - _SETTLED) * self._bounds.dt >= self.plan.time

    def now(self) -> Now:
        """Evaluate the state of the arm at this tick."""
        plan, t = self.plan, self.tick * self._bounds.dt
        q, stride = self.history[-1].copy(), self._bounds.stride
        course = plan.course(t).at(q)
        (twist, rate), (qdot, qddot) = plan.rates(t), plan.derivatives(t)
        G, E = self._inverse(q), course.task_rates()
        B, B_ahead = G @ E, self._inverse(q + 2 * stride * qdot) @ E
        later = plan.rates(t + stride)[1]
        bend = qddot - B @ rate
        return Now(course, q, qdot, bend, G, B, B_ahead, twist, rate, later)

    def go_on(self, now: Now, later: Array) -> Status:
        """Plan one stride, the end of its acceleration, and a stop; follow the plan if it is valid.

        ``later`` (6,) is the derivative of ξ after the stride. Returns OK, or why it is not
        valid.
        """
        bounds, plan = self._bounds, Plan(now.q, now.qdot, now.course)
        T, jerk = bounds.stride, bounds.jerk
        motion = change_of_acceleration(now.course, now.twist, now.rate, later, T)
        if not self.solver.add(plan, motion, SHORT):
            return self.solver.failure()
        twist, rate = motion.rates(T)
        if np.isfinite(jerk).all():
            release = float((np.abs(now.joint_rates(rate)) / (JERK * jerk)).max())
            release = max(release, bounds.dt)
            motion = change_of_acceleration(
                motion.course(T), twist, rate, np.zeros(6), release
            )
            if not self.solver.add(
                plan, motion, LONG if release > 5 * STRIDE else SHORT
            ):
                return self.solver.failure()
            twist, rate = motion.rates(release)
        else:
            rate = np.zeros(6)
        return self._stop(plan, now, motion.course(motion.duration), twist, rate)

    def _stop(
        self, begun: Plan, now: Now, course: Course, twist: Array, rate: Array
    ) -> Status:
        """Add the shortest possible stop to a plan, and follow the plan if it is valid.

        The stop begins with a velocity ``twist`` in the course's coordinates and its derivative.
        Returns OK, or why the plan is not valid.
        """
        bounds, speed = self._bounds, float(np.abs(now.joint_rates(twist)).max())
        shortest = stop_time(bounds, now, twist)
        for _ in range(2):
            T = max(self._longer * shortest, 4 * bounds.dt)
            plan = begun.copy()
            if not self._add(plan, brake(course, twist, rate, T), speed * T / 2):
                return self.solver.failure()
            if not self._leaves(plan.q, now):
                return Status.SINGULAR
            if not self._affords(plan):
                return Status.SLOWED
            before, after, inside = shares_used(bounds, self.history, plan, begun.time)
            if not inside:
                return Status.LIMIT
            if before > 1:
                return Status.SLOWED
            if after <= 1:
                self._longer = max(0.98 * self._longer, 1.0)
                self._take(plan)
                return Status.OK
            self._longer = min(self._longer * min(1.05 * after, 1.6), 4.0)
        return Status.SLOWED

    def land(self, now: Now, way: Array, g: Array, a: float, jerk: float) -> bool:
        """Plan the motion to rest at a target nearby; follow the plan if it is valid.

        ``way`` (6,) and ``g`` (n,) are the displacements of the course and of the joints to the
        target, ``a`` and ``jerk`` are the maximum deceleration and its rate of change, as multiples
        of them per s² and s³. Returns whether the plan is followed.
        """
        bounds = self._bounds
        speed, rise = closing(now, g)
        if speed > 0 and speed**2 / (2 * a) >= 0.75:
            T, longer = 2 / speed, _BRAKES
        else:
            peak = sqrt(a + speed**2 / 2)
            by_speed, _ = fastest(bounds, now, way)
            if peak > by_speed or np.abs(g).max() > _SHORT_WAY:
                return False
            T, longer = (2 * peak - speed) / a, _LONGER
        T += 1.5 * a / jerk
        self._turn = (self._turn + 1) % len(longer)
        T = min(T * longer[self._turn], longest_landing(speed, rise))
        T = max(T, 3 * bounds.dt)
        plan = Plan(now.q, now.qdot, now.course, lands=True)
        motion = landing(now.course, now.twist, now.rate, way, T)
        if not self._add(plan, motion, float(np.abs(g).max())) or not self._leaves(
            plan.q, now
        ):
            return False
        if not self._affords(plan):
            return False
        before, after, inside = shares_used(bounds, self.history, plan, 0.0)
        if not inside or max(before, after) > 1:
            return False
        self._take(plan)
        return True

    def _leaves(self, q: Array, now: Now) -> bool:
        """Test whether an arm at rest at q could leave q: q is regular, or as regular as now."""
        try:
            there = regularity(self._task.jacobian(q), self._inverse(q))
        except SingularityError:
            return False
        return there >= REGULAR or there >= regularity(
            self._task.jacobian(now.q), now.G
        )

    def _add(self, plan: Plan, motion: FrameMotion, travel: float) -> bool:
        """Append a motion to a plan, by polynomials as long as those that were last possible.

        ``travel`` is its joint motion, rad or m. Returns whether it is appended.
        """
        count = min(max(ceil(travel / self._reach), 1), 16)
        made = self.solver.add(plan, motion, LONG, count)
        if made:
            self._reach = _REACH if made == count else max(travel / made, 1e-3)
        elif self.solver.left < 0:  # shorter pieces are more than a tick can evaluate
            self._reach = _REACH
        return made > 0

    def _affords(self, plan: Plan) -> bool:
        """Count the samples of a plan as evaluations; return whether their number is allowed."""
        count = plan.time / self._bounds.dt / SAMPLES
        self.solver.left -= int(count) if count < MOST_SAMPLES else MOST_SAMPLES
        return self.solver.left >= 0

    def _take(self, plan: Plan) -> None:
        """Replace the plan that is followed."""
        self.plan, self.tick = plan, 0
