"""Limits kept at run time: joints on a leaf towards any target, never without a known stop."""

from __future__ import annotations

from math import ceil, inf, sqrt
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..arguments import Array, as_numbers, positive, require_type, row, shown
from ..errors import InputError, SingularityError
from ..robot.chain_formulas import Placement, as_placement, is_rotation
from ..robot.task import Task
from ..strategies.repeatable import RepeatableInverse
from .frame_motion import FrameMotion, brake, change_of_acceleration, landing
from .joint_polynomials import LONG, SHORT, LeafInterpolation, Plan
from .status import Status as Status
from .timing import limits_of

MOST = 180
"""Maximum number of evaluations of the inverse in a tick."""

STRIDE = 0.004
"""Time between two plans, s."""

_SPEED, _ACCELERATION, _JERK = 0.985, 0.95, 0.8
"""Shares of the limits that plans aim at; the rest is for what changes along the path."""

_BRAKING = 0.6
"""Share of the acceleration limits with which the arm slows down before targets and limits."""

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

_TINY, _EDGE = 1e-300, 1e-12
"""In place of 0 in divisions; rounding of a joint position, rad or m."""

_NEAR, _REACHED = 1e-10, 1e-6
"""Distance of the joints to a target that is reached, rad or m; share of the speed limits within
which a twist is reached."""

_HUGE = 1e6
"""Numbers beyond it are no distances or speeds."""


_Input = tuple[pin.SE3 | None, Array | None]


class _Now(NamedTuple):
    """State at the beginning of a plan: what the law needs of it.

    ``q̈ = G ξ̇ + bend``; ``later`` is the rate of the twist that the last stop has after a stride."""

    place: pin.SE3
    q: Array
    qdot: Array
    G: Array
    G_ahead: Array
    twist: Array
    rate: Array
    later: Array
    bend: Array


class _Wish(NamedTuple):
    """Direction (6,) of the frame, the share of it asked for per s, and whether it is a target."""

    way: Array
    speed: float
    lands: bool


class _Fastest(NamedTuple):
    """Largest speeds along a direction, shares of it per s: by the speed limits, and by the room to
    the joint limits."""

    by_speed: float
    by_room: float


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
        self._dt = positive(dt, "dt", "s")
        limits = limits_of(task, velocity, acceleration, jerk=jerk)
        if not np.isfinite(limits.velocity).all():
            name = task.joint_names[int(np.argmax(~np.isfinite(limits.velocity)))]
            raise InputError(f"velocity= is missing: the URDF has no speed limit of {name!r}")
        self._V, self._A = limits.velocity, limits.acceleration
        self._J = np.full(task.n, inf) if limits.jerk is None else limits.jerk
        margin = positive(margin, "margin", "rad (m)", zero=True)
        self._lower, self._upper = task.lower + margin, task.upper - margin
        if not (self._lower < self._upper).all():
            name = task.joint_names[int(np.argmax(self._lower >= self._upper))]
            raise InputError(f"margin = {margin:g} leaves no range of {name!r}; give a smaller one")
        self._margin, self._stride = margin, max(int(STRIDE / self._dt + 0.5), 1)
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
        short = np.minimum(q - self._lower, self._upper - q)
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
        self._plan, self._tick, self._next = Plan(q, np.zeros_like(q)), 0, 0
        self._status = self._cause = Status.OK
        self._pace, self._longer, self._reach, self._turn = 1.0, 1.0, _REACH, 0
        self._heard: _Input = (None, None)

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
        goal, rates = _input(target, twist)
        usable = self._usable(goal, rates)
        if usable and self._tick >= self._next:
            self._solver.refill()
            self._status = self._replan(goal, rates)
            self._next, self._heard = self._tick + self._stride, (goal, rates)
        self._tick += 1
        q = self._plan.at(self._tick * self._dt)
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
        return (self._tick - 3) * self._dt >= self._plan.time

    # ---- the law -------------------------------------------------------------------------------

    def _replan(self, target: pin.SE3 | None, twist: Array | None) -> Status:
        """Look for a better plan than the rest of the last one, which is a stop."""
        q = self._started()[-1]
        place = self._task.placement(q)
        wish = self._wish(q, place, target, twist)
        try:
            now = self._now(q, place)
        except SingularityError:
            return Status.SINGULAR
        if not wish.lands:
            return self._drive(now, wish, self._fastest(now, wish))
        g = now.G @ self._rate(place, wish.way)
        if self._plan.lands and target == self._landing:
            return Status.OK if self._at_rest() else Status.SLOWED
        if self._at_rest() and np.abs(g).max() < _NEAR:
            return Status.OK
        a = _BRAKING * float((self._free(now) / np.maximum(np.abs(g), _TINY)).min())
        most = self._fastest(now, wish)
        if self._land(now, wish.way, g, a, most.by_speed):
            self._landing, self._pace = target, 1.0
            return Status.SLOWED
        brake = _approach(1.0, a, 2 * self._stride * self._dt)
        return self._drive(now, wish._replace(speed=brake), most)

    def _drive(self, now: _Now, wish: _Wish, most: _Fastest) -> Status:
        """Go on in a direction for a stride, as fast as the limits allow."""
        if not wish.way.any():
            return self._reached(now, wish)
        by_limits = min(most.by_speed, most.by_room)
        speed = min(wish.speed, by_limits * self._pace)
        later = self._acceleration(now, wish.way * speed)
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
        if most.by_room < min(most.by_speed, wish.speed):
            return Status.LIMIT
        return Status.SLOWED if wish.lands else self._reached(now, wish)

    def _reached(self, now: _Now, wish: _Wish) -> Status:
        """Tell whether the twist is the one asked for."""
        away = np.abs(now.G @ self._rate(now.place, wish.way - now.twist))
        return Status.OK if (away <= _REACHED * self._V).all() else Status.SLOWED

    def _wish(
        self, q: Array, place: pin.SE3, target: pin.SE3 | None, twist: Array | None
    ) -> _Wish:
        """Take the input as a direction of the frame, without what the task does not control."""
        if target is not None:
            return _Wish(self._lifted(place, self._task.error(q, target)), inf, True)
        rate = self._rate(place, np.zeros(6) if twist is None else twist)
        return _Wish(self._lifted(place, rate), 1.0, False)

    def _rate(self, place: pin.SE3, twist: Array) -> Array:
        """Extract ẋ (m,) from a twist at a placement."""
        if self._task.kind != "axis":
            return twist[self._task.rows]
        return np.concatenate([twist[:3], place.rotation[:, :2].T @ twist[3:]])

    def _lifted(self, place: pin.SE3, rate: Array) -> Array:
        """Convert ẋ (m,) to a twist (6,), with 0 for what the task does not control."""
        twist = np.zeros(6)
        if self._task.kind == "axis":
            twist[:3], twist[3:] = rate[:3], place.rotation[:, :2] @ rate[3:]
        else:
            twist[self._task.rows] = rate
        return twist

    def _now(self, q: Array, place: pin.SE3) -> _Now:
        """Evaluate the state at this tick."""
        t, stride = self._tick * self._dt, self._stride * self._dt
        twist, rate = self._plan.rates(t)
        qdot, qddot = self._plan.derivatives(t)
        G, ahead = self._inverse(q), q + 2 * stride * qdot
        bend = qddot - G @ self._rate(place, rate)
        later = self._plan.rates(t + stride)[1]
        return _Now(place, q, qdot, G, self._inverse(ahead), twist, rate, later, bend)

    def _free(self, now: _Now) -> Array:
        """Acceleration (n,) that the bend of the path leaves."""
        return np.asarray(np.maximum(self._A - np.abs(now.bend), 0.3 * self._A))

    def _fastest(self, now: _Now, wish: _Wish) -> _Fastest:
        """Find the largest speeds along a direction, in shares of it per s."""
        rate = self._rate(now.place, wish.way)
        g, ahead = now.G @ rate, now.G_ahead @ rate
        size = np.maximum(np.maximum(np.abs(g), np.abs(ahead)), _TINY)
        room = np.where(g > 0, self._upper - now.q, now.q - self._lower)
        lag = 2 * self._stride * self._dt
        toward = np.array(
            [_approach(d, _BRAKING * a, lag) for d, a in zip(room, self._A, strict=True)]
        )
        return _Fastest(
            float((_SPEED * self._V / size).min()),
            float((toward / np.maximum(np.abs(g), _TINY)).min()),
        )

    def _acceleration(self, now: _Now, wish: Array) -> Array:
        """Choose the rate of the twist after the next stride, on the way to another twist."""
        T = self._stride * self._dt
        gap = wish - now.twist - T / 2 * now.rate
        g = now.G @ self._rate(now.place, gap)
        size = np.maximum(np.abs(g), _TINY)
        fits = float(((_ACCELERATION * self._A - np.sign(g) * now.bend) / size).min())
        share = min(max(fits, 0.0), _approach(1.0, _JERK * float((self._J / size).min()), T))
        change = share * gap - now.rate
        g = np.maximum(np.abs(now.G @ self._rate(now.place, change)), _TINY)
        return now.rate + min(1.0, float((_JERK * self._J * T / g).min())) * change

    # ---- plans ---------------------------------------------------------------------------------

    def _try(self, now: _Now, later: Array) -> Status:
        """Plan a stride, the end of its acceleration, and a stop; take the plan if it serves."""
        plan, T = Plan(now.q, now.qdot), self._stride * self._dt
        motion = change_of_acceleration(now.place, now.twist, now.rate, later, T)
        if not self._solver.add(plan, motion, SHORT):
            return self._solver.failure()
        twist, rate = motion.rates(T)
        if np.isfinite(self._J).all():
            g = np.abs(now.G @ self._rate(now.place, rate))
            release = max(float((g / (_JERK * self._J)).max()), self._dt)
            motion = change_of_acceleration(
                motion.placement(T), twist, rate, np.zeros(6), release
            )
            if not self._solver.add(plan, motion, LONG if release > 5 * STRIDE else SHORT):
                return self._solver.failure()
            twist, rate = motion.rates(release)
        else:
            rate = np.zeros(6)
        return self._stop(plan, now, motion.placement(motion.duration), twist, rate)

    def _stop(
        self, begun: Plan, now: _Now, place: pin.SE3, twist: Array, rate: Array
    ) -> Status:
        """Add a stop to a plan, as short as the limits allow; take the plan if it serves."""
        g = np.abs(now.G @ self._rate(now.place, twist))
        shortest = max(
            float((1.5 * g / (_ACCELERATION * self._free(now))).max()),
            sqrt(float((6 * g / (_JERK * self._J)).max())),
        )
        for _ in range(2):
            T = max(self._longer * shortest, 4 * self._dt)
            plan = begun.copy()
            if not self._add(plan, brake(place, twist, rate, T), float(g.max()) * T / 2):
                return self._solver.failure()
            begin, end, inside = self._used(plan, begun.time)
            if not inside:
                return Status.LIMIT
            if begin > 1:
                return Status.SLOWED
            if end <= 1:
                self._longer = max(0.98 * self._longer, 1.0)
                self._take(plan)
                return Status.OK
            self._longer = min(self._longer * min(1.05 * end, 1.6), 4.0)
        return Status.SLOWED

    def _land(self, now: _Now, way: Array, g: Array, a: float, speed: float) -> bool:
        """Plan to come to rest at a displacement, if it is near; tell whether the plan is taken."""
        size = max(float(g @ g), _TINY)
        closing = float((now.G @ self._rate(now.place, now.twist)) @ g) / size
        if closing > 0 and closing**2 / (2 * a) >= 0.75:
            T, more = 2 / closing, _BRAKES
        else:
            peak = sqrt(a + closing**2 / 2)
            if peak > speed or np.abs(g).max() > _SHORT_WAY:
                return False
            T, more = (2 * peak - closing) / a, _LONGER
        T += 1.5 * a / (_JERK * float((self._J / np.maximum(np.abs(g), _TINY)).min()))
        self._turn = (self._turn + 1) % len(more)
        T = max(T * more[self._turn], 3 * self._dt)
        plan = Plan(now.q, now.qdot, lands=True)
        motion = landing(now.place, now.twist, now.rate, way, T)
        if not self._add(plan, motion, float(np.abs(g).max())):
            return False
        begin, end, inside = self._used(plan, 0.0)
        if not inside or max(begin, end) > 1:
            return False
        self._take(plan)
        return True

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

    def _used(self, plan: Plan, begin: float) -> tuple[float, float, bool]:
        """Measure the samples of a plan: the largest shares of the limits that are used before and
        after a time, and whether the joints stay inside their limits.

        Speeds count as before: a longer stop does not lower them."""
        dt, H = self._dt, self._started()
        Q = np.vstack([H, plan.samples(dt, 1, ceil(plan.time / dt) + 4)])
        inside = bool(((Q[3:] >= self._lower - _EDGE) & (Q[3:] <= self._upper + _EDGE)).all())
        first, second, third = (np.abs(np.diff(Q, k, axis=0)) for k in (1, 2, 3))
        speed = float((first[2:] / (self._V * dt)).max())
        rest = np.maximum(
            (second[1:] / (self._A * dt**2)).max(axis=1), (third / (self._J * dt**3)).max(axis=1)
        )
        later = np.arange(1, len(rest) + 1) * dt > begin
        before = float(rest[~later].max(initial=speed))
        return before, float(rest[later].max(initial=0.0)), inside


def _own_joints(task: Task) -> Task:
    """Refuse a task in other joint coordinates."""
    if task.coordinates is not None:
        raise InputError(
            "the governor's limits are of the robot's own joints; use the original task"
        )
    return task


def _input(target: Placement | None, twist: ArrayLike | None) -> _Input:
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
    return one[0] is None and np.array_equal(*(np.zeros(6) if x[1] is None else x[1] for x in (one, other)))


def _approach(distance: float, a: float, lag: float) -> float:
    """Speed from which a deceleration a after a delay stops within a distance."""
    if distance <= 0:
        return 0.0
    if lag * lag * a > 1e12 * distance:  # a may be infinite
        return distance / lag
    return a * (sqrt(lag * lag + 2 * distance / a) - lag)
