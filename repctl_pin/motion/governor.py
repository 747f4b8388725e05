"""Limits kept at run time: joints on a leaf towards any target, never without a known stop."""

from __future__ import annotations

from math import ceil, inf, sqrt

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..arguments import Array, as_numbers, positive, require_type, row, shown
from ..errors import InputError, SingularityError
from ..robot.chain_formulas import Placement, as_placement, is_rotation
from ..robot.task import Task
from ..strategies.repeatable import RepeatableInverse
from .frame_motion import FrameMotion, brake, change_of_acceleration, landing
from .governor_law import (
    BRAKING,
    JERK,
    REGULAR,
    TINY,
    Bounds,
    Goal,
    Now,
    approach_speed,
    fastest,
    frame_twist,
    free_acceleration,
    next_rate,
    regularity,
    shares_used,
    stop_time,
    task_rate,
)
from .joint_polynomials import LONG, SHORT, LeafInterpolation, Plan
from .status import Status as Status
from .timing import limits_of

MOST = 150
"""Maximum number of evaluations of the inverse in a tick."""

STRIDE = 0.004
"""Time between two plans, s."""

_SLOWER, _FASTER, _SLOWEST = 0.7, 1.1, 1e-3
"""Factors of the speed after a plan that ends outside, and after one that does not; its minimum."""

_REACH = 0.15
"""Joint motion that one polynomial is tried for, rad or m."""

_SHORT_WAY = 0.03
"""Joint motion to a target, rad or m, that is planned at once, from rest to rest."""

_LONGER = (1.0, 1.15, 1.4)
_BRAKES = (0.95, 1.0, 1.05)
"""Times of a landing that are tried in turn, as multiples of the shortest: from near rest, and at
speed."""

_SETTLED = 3
"""Samples after which all differences are 0."""

_NEAR, _REACHED = 1e-10, 1e-6
"""Distance of the joints to a target that is reached, rad or m; share of the speed limits within
which a twist is reached."""

_HUGE = 1e6
"""Numbers beyond it are no distances or speeds."""


_Input = tuple[pin.SE3 | None, Array | None]


class Governor:
    """Move the joints towards any target or by any twist, and keep all limits on every sample.

    The commanded joints stay on one leaf, and the first, second and third differences of their
    samples, divided by dt, dt² and dt³, never exceed the limits. A sample is sent only if from it a
    stop is known that keeps the limits, too: every few ticks a new plan is made, a short motion
    towards the target and a stop after it, and all its samples are checked before the first one is
    sent. Where no such plan is found, the stop of the last one is followed. So whatever the input
    is, and if the ticks of a robot are missed, there is always a way to rest.

    Parameters
    ----------
    inverse
        Repeatable inverse, such as ``design.inverse`` or ``found.function.inverse``. If it has a
        region Ω, the arm stops before its edge.
    dt
        Time step of the loop, s.
    velocity : float or (n,) array, optional
        Speed limits, rad/s (m/s); by default the URDF's.
    acceleration : float, (n,) array or str
        Acceleration limits, rad/s² (m/s²), or a name such as ``"panda"``, as in :func:`timed`.
    jerk : float, (n,) array or str, optional
        Jerk limits, rad/s³ (m/s³), or a name: ``"panda"``, ``"fr3"``. By default not limited.
    margin
        Distance kept from the joint limits, rad (m).

    Attributes
    ----------
    q : (n,) array
        The commanded joints.
    leaf : (r,) array
        Level c of the leaf on which they stay.

    Raises
    ------
    InputError
        If a limit is missing or not above 0, or dt is not.

    Examples
    --------
    >>> governor = rp.Governor(design.inverse, 0.001, acceleration=5.0, jerk=500.0)
    >>> governor.start(q0)
    >>> for _ in range(1000):
    ...     q, status = governor.step(task.placement(q0 + 0.02))  # send q to the robot
    >>> status.name
    'OK'
    """

    def __init__(
        self,
        inverse: RepeatableInverse,
        dt: float,
        *,
        velocity: ArrayLike | None = None,
        acceleration: ArrayLike | str | None = None,
        jerk: ArrayLike | str | None = None,
        margin: float = 0.0,
    ) -> None:
        self._inverse = require_type(
            inverse,
            RepeatableInverse,
            "inverse",
            "a repeatable inverse, such as design.inverse or found.function.inverse",
        )
        self._task = task = _own_joints(inverse.task)
        dt = positive(dt, "dt", "s")
        limits = limits_of(task, velocity, acceleration, jerk=jerk)
        if not np.isfinite(limits.velocity).all():
            name = task.joint_names[int(np.argmax(~np.isfinite(limits.velocity)))]
            raise InputError(f"velocity= is missing: the URDF has no speed limit of {name!r}")
        jerks = np.full(task.n, inf) if limits.jerk is None else limits.jerk
        margin = positive(margin, "margin", "rad (m)", zero=True)
        lower, upper = task.lower + margin, task.upper - margin
        if not (lower < upper).all():
            name = task.joint_names[int(np.argmax(lower >= upper))]
            raise InputError(f"margin = {margin:g} leaves no range of {name!r}; give a smaller one")
        self._margin, self._stride = margin, max(int(STRIDE / dt + 0.5), 1)
        self._bounds = Bounds(
            limits.velocity, limits.acceleration, jerks, lower, upper, dt, self._stride * dt
        )
        self._solver = LeafInterpolation(inverse, MOST)
        self._history: Array | None = None

    def __repr__(self) -> str:
        state = "not started" if self._history is None else f"at q = {row(self.q)}"
        return f"<Governor of {self._task.robot.name} {self._task.frame}, {state}>"

    @property
    def q(self) -> Array:
        """The commanded joints (n,)."""
        return self._started()[-1].copy()

    @property
    def leaf(self) -> Array:
        """Level c (r,) of the leaf on which the commanded joints stay."""
        self._started()
        return self._solver.leaf.copy()

    def start(self, q: ArrayLike) -> None:
        """Begin, or begin again, at rest at a configuration; its leaf is kept from now on.

        Parameters
        ----------
        q : (n,) array
            The robot's joints, at rest: the position that the robot was commanded to, or measured.

        Raises
        ------
        InputError
            If q is within ``margin`` of a joint limit, or outside the region Ω.
        SingularityError
            If J_V is singular there.
        """
        q = self._task.check(q, "the start")
        short = np.minimum(q - self._bounds.lower, self._bounds.upper - q)
        if (worst := int(np.argmin(short))) >= 0 and short[worst] < 0:
            raise InputError(
                f"the start is too near to the limit of {self._task.joint_names[worst]!r}: "
                f"{self._margin + short[worst]:.3g} where margin = {self._margin:g} is to be kept"
            )
        region = self._inverse.region
        if region is not None and not region.ratio(q[None])[0] <= 1 + 1e-9:
            raise InputError(
                f"the start q = {row(q)} is outside Ω; start inside, "
                "or use an inverse without a region"
            )
        self._inverse(q)
        self._solver.leaf = self._inverse.leaf(q)
        self._history = np.tile(q, (3, 1))
        self._plan, self._tick, self._next = Plan(q, np.zeros_like(q)), _SETTLED, 0
        self._status = self._cause = Status.OK
        self._pace, self._longer, self._reach, self._turn = 1.0, 1.0, _REACH, 0
        self._heard: _Input = (None, None)
        self._landing: pin.SE3 | None = None

    def step(
        self, target: Placement | None = None, twist: ArrayLike | None = None
    ) -> tuple[Array, Status]:
        """Go on by one tick.

        Parameters
        ----------
        target : pinocchio.SE3 or (4, 4) array, optional
            Placement of the frame to move to, as fast as the limits allow, on a straight line with
            a rotation about one axis, if the arm begins at rest.
        twist : (6,) array, optional
            Velocity (v, ω) of the frame instead, base axes, m/s and rad/s. Without both, the arm
            stops.

        Returns
        -------
        q : (n,) array
            The next joints to command.
        status : Status

        Raises
        ------
        InputError
            If an argument has the wrong type or size. Numbers that are not finite raise nothing:
            the arm stops, with ``Status.BAD_NUMBER``.
        """
        history = self._started()
        goal, rates = taken_input(target, twist)
        usable = self._usable(goal, rates)
        if usable and self._tick >= self._next:
            self._solver.refill()
            self._status = self._replan(goal, rates)
            self._next, self._heard = self._tick + self._stride, (goal, rates)
        self._tick += 1
        q = self._plan.at(self._tick * self._bounds.dt)
        history[:-1], history[-1] = history[1:].copy(), q
        if not usable:
            return q, Status.BAD_NUMBER
        if self._status is Status.OK and not _same(self._heard, (goal, rates)):
            return q, Status.SLOWED  # of an input that no plan has heeded yet
        return q, self._status

    def _usable(self, target: pin.SE3 | None, twist: Array | None) -> bool:
        """Whether the numbers are finite and not absurd, and a rotation is one."""
        if twist is not None and not (np.abs(twist) < _HUGE).all():
            return False
        if target is None:
            return True
        turns = self._task.kind in ("pose", "axis")
        return bool((np.abs(target.translation) < _HUGE).all()) and (
            not turns or is_rotation(target.rotation.ravel().tolist())
        )

    def _started(self) -> Array:
        if self._history is None:
            raise InputError("the governor has not started; call start(q) with the robot's joints")
        return self._history

    def _at_rest(self) -> bool:
        return (self._tick - _SETTLED) * self._bounds.dt >= self._plan.time

    # ---- the law -------------------------------------------------------------------------------

    def _replan(self, target: pin.SE3 | None, twist: Array | None) -> Status:
        """Look for a better plan than the rest of the last one, which is a stop."""
        q = self._started()[-1]
        try:
            now = self._now(q)
        except SingularityError:
            return Status.SINGULAR
        if target is None:
            rate = task_rate(now.task, now.place, np.zeros(6) if twist is None else twist)
            goal = Goal(frame_twist(now.task, now.place, rate), 1.0, False)
            return self._drive(now, goal)
        if self._plan.lands and target == self._landing:
            return Status.OK if self._at_rest() else Status.SLOWED
        way = frame_twist(now.task, now.place, now.task.error(q, target))
        g = now.joint_rates(way)
        if self._at_rest() and np.abs(g).max() < _NEAR:
            return Status.OK
        free = free_acceleration(self._bounds, now) / np.maximum(np.abs(g), TINY)
        a = BRAKING * float(free.min())
        if self._land(now, way, g, a):
            self._landing, self._pace = target, 1.0
            return Status.SLOWED
        return self._drive(now, Goal(way, approach_speed(1.0, a, 2 * self._bounds.stride), True))

    def _now(self, q: Array) -> Now:
        """Evaluate the state at this tick."""
        task, plan, t = self._task, self._plan, self._tick * self._bounds.dt
        place, stride = task.placement(q), self._bounds.stride
        (twist, rate), (qdot, qddot) = plan.rates(t), plan.derivatives(t)
        G = self._inverse(q)
        bend = qddot - G @ task_rate(task, place, rate)
        G_ahead = self._inverse(q + 2 * stride * qdot)
        later = plan.rates(t + stride)[1]
        return Now(task, place, q, qdot, bend, G, G_ahead, twist, rate, later)

    def _drive(self, now: Now, goal: Goal) -> Status:
        """Go on in a direction for a stride, as fast as the limits allow."""
        if not goal.way.any():
            return self._reached(now, goal.way)
        most = fastest(self._bounds, now, goal.way)
        speed = min(goal.speed, min(most) * self._pace)
        later = next_rate(self._bounds, now, goal.way * speed)
        cause = self._try(now, later)
        if cause is Status.SLOWED:
            self._try(now, (now.later + later) / 2)
            return cause
        if cause is not Status.OK:
            self._pace, self._cause = max(_SLOWER * self._pace, _SLOWEST), cause
            return cause
        self._pace = min(_FASTER * self._pace, 1.0)
        if self._pace < 1:
            return self._cause
        if most.by_limit < min(most.by_speed, goal.speed):
            return Status.LIMIT
        return Status.SLOWED if goal.lands else self._reached(now, goal.way)

    def _reached(self, now: Now, twist: Array) -> Status:
        """Tell whether the twist is the one asked for."""
        away = np.abs(now.joint_rates(twist - now.twist))
        return Status.OK if (away <= _REACHED * self._bounds.velocity).all() else Status.SLOWED

    # ---- plans ---------------------------------------------------------------------------------

    def _try(self, now: Now, later: Array) -> Status:
        """Plan a stride, the end of its acceleration, and a stop; take the plan if it serves."""
        plan, T, jerk = Plan(now.q, now.qdot), self._bounds.stride, self._bounds.jerk
        motion = change_of_acceleration(now.place, now.twist, now.rate, later, T)
        if not self._solver.add(plan, motion, SHORT):
            return self._solver.failure()
        twist, rate = motion.rates(T)
        if np.isfinite(jerk).all():
            release = float((np.abs(now.joint_rates(rate)) / (JERK * jerk)).max())
            release = max(release, self._bounds.dt)
            motion = change_of_acceleration(motion.placement(T), twist, rate, np.zeros(6), release)
            if not self._solver.add(plan, motion, LONG if release > 5 * STRIDE else SHORT):
                return self._solver.failure()
            twist, rate = motion.rates(release)
        else:
            rate = np.zeros(6)
        return self._stop(plan, now, motion.placement(motion.duration), twist, rate)

    def _stop(self, begun: Plan, now: Now, place: pin.SE3, twist: Array, rate: Array) -> Status:
        """Add a stop to a plan, as short as the limits allow; take the plan if it serves."""
        bounds, speed = self._bounds, float(np.abs(now.joint_rates(twist)).max())
        shortest = stop_time(bounds, now, twist)
        for _ in range(2):
            T = max(self._longer * shortest, 4 * bounds.dt)
            plan = begun.copy()
            if not self._add(plan, brake(place, twist, rate, T), speed * T / 2):
                return self._solver.failure()
            if not self._leaves(plan.q, now):
                return Status.SINGULAR
            before, after, inside = shares_used(bounds, self._started(), plan, begun.time)
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

    def _land(self, now: Now, way: Array, g: Array, a: float) -> bool:
        """Plan to come to rest at a displacement, if it is near; tell whether the plan is taken."""
        bounds = self._bounds
        closing = float(now.joint_rates(now.twist) @ g) / max(float(g @ g), TINY)
        if closing > 0 and closing**2 / (2 * a) >= 0.75:
            T, longer = 2 / closing, _BRAKES
        else:
            peak = sqrt(a + closing**2 / 2)
            if peak > fastest(bounds, now, way).by_speed or np.abs(g).max() > _SHORT_WAY:
                return False
            T, longer = (2 * peak - closing) / a, _LONGER
        T += 1.5 * a / (JERK * float((bounds.jerk / np.maximum(np.abs(g), TINY)).min()))
        self._turn = (self._turn + 1) % len(longer)
        T = max(T * longer[self._turn], 3 * bounds.dt)
        plan = Plan(now.q, now.qdot, lands=True)
        motion = landing(now.place, now.twist, now.rate, way, T)
        if not self._add(plan, motion, float(np.abs(g).max())) or not self._leaves(plan.q, now):
            return False
        before, after, inside = shares_used(bounds, self._started(), plan, 0.0)
        if not inside or max(before, after) > 1:
            return False
        self._take(plan)
        return True

    def _leaves(self, q: Array, now: Now) -> bool:
        """Whether an arm at rest at q can leave it: q is not, or not more than now, singular."""
        try:
            there = regularity(self._task.jacobian(q), self._inverse(q))
        except SingularityError:
            return False
        return there >= REGULAR or there >= regularity(self._task.jacobian(now.q), now.G)

    def _add(self, plan: Plan, motion: FrameMotion, travel: float) -> bool:
        """Append a motion, in pieces as long as the last ones could be."""
        count = min(max(ceil(travel / self._reach), 1), 16)
        made = self._solver.add(plan, motion, LONG, count)
        if made:
            self._reach = _REACH if made == count else max(travel / made, 1e-3)
        return made > 0

    def _take(self, plan: Plan) -> None:
        """Follow a plan from now on."""
        self._plan, self._tick = plan, 0


def _own_joints(task: Task) -> Task:
    """Refuse a task in other joint coordinates."""
    if task.coordinates is not None:
        raise InputError(
            "the governor's limits are of the robot's own joints; use the original task"
        )
    return task


def taken_input(target: Placement | None, twist: ArrayLike | None) -> _Input:
    """Take a target or a twist, which may hold numbers that are not finite."""
    if target is not None and twist is not None:
        raise InputError("target and twist are mutually exclusive; give one of them")
    goal = None if target is None else pin.SE3(as_placement(target))
    if twist is None:
        return goal, None
    rates = as_numbers(twist)
    if rates is None or rates.shape != (6,):
        raise InputError(
            f"must be 6 numbers (v, ω), m/s and rad/s; got {shown(twist)}", argument="twist"
        )
    return goal, rates.copy()


def _same(one: _Input, other: _Input) -> bool:
    """Whether two inputs are the same."""
    if other[0] is not None:
        return one[0] is not None and bool(one[0] == other[0])
    before, now = (np.zeros(6) if x[1] is None else x[1] for x in (one, other))
    return one[0] is None and np.array_equal(before, now)
