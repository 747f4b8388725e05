"""Governor: motion to any pose and level within all limits, with a known stop at every tick.

A leaf is the set h(q) = c on which a repeatable inverse keeps the arm. Its level c is the position
of the elbow along the self-motion. A plan is a short motion that ends at rest. A twist is the
velocity (v, ω) of a frame, in base axes. The work is done in C (native/governor.c), except for body
distances, which Python computes. Ω is the region of joint space for which the inverse was designed.
The closing radius, a part of the design's certificate, is the distance from a start or a path
within which closed paths are proved to close. A tick is one call of the control loop; its command
is the configuration q that is sent to the robot. Letters: n joints, r potentials, F frames of the
task.

``BodyGuard`` is the test that all pairs of bodies keep a distance along each plan of a governor.
``JointLimits`` are maximum joint speeds and accelerations (n,) and, if given, torques and jerks, as
numbers.
"""

from __future__ import annotations

import ctypes
from enum import IntEnum
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from ...base.arguments import (
    Array,
    as_configurations,
    as_numbers,
    positive,
    require_choice,
    require_type,
    row,
    shown,
)
from ...base.certificate import ClosingRadius, beyond
from ...base.errors import InputError, RepctlError
from ...model.bodies import Bodies
from ...model.chain_formulas import Placement
from ...model.several_frames import one_frame
from ...model.task import RECOVERABLE, Task
from ...motion.limits import JointLimits, Limits, joint_limits
from ...native import GOVERNOR_CALL, filled_struct, required_library
from ...strategies.native_arm import native_arm
from ...strategies.repeatable import RepeatableInverse
from .body_guard import ROOM, BodyGuard

_ASK = ctypes.PYFUNCTYPE(ctypes.c_int, ctypes.c_int, ctypes.c_int)
"""Function of Python that C calls for every plan within the limits."""

_SHORTEST, _LONGEST = 1e-4, 0.1
"""Time steps between which a governor works, s."""

_TARGET, _TWIST, _LEAF = 1, 2, 4
"""Bits that tell C which of its inputs are given."""


class Status(IntEnum):
    """Outcome of a tick of :class:`Governor`.

    Attributes
    ----------
    OK
        The target and the level are reached, or the task's frame has the requested twist.
    SINGULAR
        A singularity is ahead, or the target is out of reach: the arm stops before that point.
        Or the arm is at rest, and no motion to the target was found.
    BAD_NUMBER
        A number of the input is not finite or too large, or a matrix is not a rotation: the arm
        stops.
    OUTSIDE
        The region Ω of the inverse ends ahead: the arm stops before its edge.
    SLOWED
        The arm is on its way, as fast as the limits of speed, acceleration and jerk allow.
    LIMIT
        A joint limit is ahead: the arm slows down and stops before it.
    RECOVERING
        A joint that started beyond its limit, or within ``margin`` of it, is moving back inside;
        afterwards, the arm follows the target.
    BODIES
        Two bodies, :attr:`Governor.nearest_bodies`, would come near each other ahead: the arm slows
        down and stops before their distance falls below ``body_distance``.

    Examples
    --------
    >>> governor = rp.Governor(design.inverse, 0.001, rp.Limits(acceleration=5.0))
    >>> governor.start(q0)
    >>> q, status = governor.step(task.placement(q0))
    >>> status is rp.Status.OK
    True
    """

    OK = 0
    SINGULAR = 1
    BAD_NUMBER = 2
    OUTSIDE = 3
    SLOWED = 4
    LIMIT = 5
    BODIES = 6
    RECOVERING = 7


_STATUS = {int(status): status for status in Status}


class Governor:
    """Online motion generator that moves an arm to a target, or at a twist, within all limits.

    The pose x and the level c of the inverse's potentials h together determine q. So both form one
    target, and a plan is a straight line in both. Without a new level, the commanded configuration
    stays on one leaf, the set h(q) = c. The first, second and third differences of the commanded
    configurations, divided by dt, dt² and dt³, never exceed the limits of speed, acceleration and
    jerk. Every few ticks a new plan is made: a short motion toward the target, followed by a stop.
    All samples of a plan are checked before the first is sent. If no new plan is within the limits,
    the previous plan is followed to its stop. So a stop within the limits is known at every tick,
    whatever the input, and even if the robot misses ticks.

    Parameters
    ----------
    inverse
        Repeatable inverse, such as ``design.inverse`` or ``found.function.inverse``. If the inverse
        has a region Ω, the arm stops before the edge of Ω.
    dt
        Time step of the loop, 0.0001 to 0.1 s. Steps of more than 1 ms are divided, so the motion
        does not depend on dt.
    limits
        Limits of acceleration and, if given, of speed and jerk, as for :func:`timed`. Limits of
        torque and of the tool's speed are refused.
    margin
        Distance to keep from the joint limits, rad or m.
    closes
        Closing radius of the design's certificate, ``design.proof.closes``, for
        :attr:`beyond_closing_radius`.
    bodies
        Bodies of the robot and its surroundings that must keep a distance, ``rp.Bodies(task)``.
    body_distance
        Distance that these bodies must keep, m; for pairs of :attr:`Bodies.only_contact`, it
        suffices that they do not collide.
    unchecked
        ``"allow"`` accepts links without a shape, :attr:`Bodies.unchecked`, whose collisions are
        not detected.

    Attributes
    ----------
    q : (n,) array
        Commanded configuration, rad or m.
    leaf : (r,) array
        Level c = h(q) of the leaf on which q lies.

    Raises
    ------
    InputError
        If a limit is missing, a limit or dt is not above 0, the bodies are of another task, or a
        link has no body.

    Examples
    --------
    >>> governor = rp.Governor(design.inverse, 0.001, rp.Limits(acceleration=5.0, jerk=500.0))
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
        limits: Limits,
        *,
        margin: float = 0.0,
        closes: ClosingRadius | None = None,
        bodies: Bodies | None = None,
        body_distance: float = 0.02,
        unchecked: Literal["refuse", "allow"] = "refuse",
    ) -> None:
        self._inverse = require_type(
            inverse,
            RepeatableInverse,
            "inverse",
            "a repeatable inverse, such as design.inverse or found.function.inverse",
        )
        self._task = task = self._inverse.task
        self._dt = positive(dt, "dt", "s")
        if not _SHORTEST <= self._dt <= _LONGEST:
            raise InputError(
                f"dt = {self._dt:g} s is {1 / self._dt:g} ticks per second, but a governor takes "
                "10 to 10,000",
                remedy="choose dt from 0.0001 to 0.1 s",
            )
        self._kept = _kept_limits(task, limits)
        self._margin = positive(margin, "margin", "rad (m)", zero=True)
        self._lower, self._upper = task.lower + self._margin, task.upper - self._margin
        if not (self._lower < self._upper).all():
            name = task.joint_names[int(np.argmax(self._lower >= self._upper))]
            raise InputError(
                f"margin = {self._margin:g} rad (m) is at least half the range of joint {name!r}; "
                "give a smaller margin"
            )
        if closes is not None:
            require_type(closes, ClosingRadius, "closes", "design.proof.closes")
            one_frame(task, "a closing radius")
        self._closes = closes
        kept = positive(body_distance, "body_distance", "m", zero=True)
        lacks = require_choice(unchecked, ("refuse", "allow"), "unchecked") == "allow"
        self._guard = None if bodies is None else BodyGuard(bodies, task, kept, unchecked=lacks)
        native = required_library("a governor")
        self._on = False
        self._state = np.zeros(native.governor_bytes(), np.uint8)
        self._connect()

    def _connect(self) -> None:
        """Allocate the arrays that C reads and writes in each tick, and give C their addresses.

        This is called for a new governor and for each copy, which needs arrays of its own.
        """
        memory, inverse = self._memory(), self._inverse
        self._arm = native_arm(self._task, inverse.potentials, inverse.region)
        own: dict[str, Any] = {
            "arm": ctypes.addressof(self._arm),
            "state": self._state.ctypes.data,
            "room": ROOM,
            "dt": self._dt,
        }
        self._samples, self._ways = memory["samples"], memory["ways"]
        self._ask = _ASK(self._allows)
        if self._guard is not None:
            self._kept_state = np.empty_like(self._state)
            own["kept"] = self._kept_state.ctypes.data
            own["allows"] = ctypes.cast(self._ask, ctypes.c_void_p)
        self._call = filled_struct(GOVERNOR_CALL, {}, memory, own)[0]
        self._address = ctypes.c_void_p(ctypes.addressof(self._call))
        self._target, self._twist = memory["target"].reshape(-1, 4), memory["twist"]
        self._asked_leaf = memory["leaf"]
        self._begin, self._q = memory["q"], memory["result"]
        self._native = required_library("a governor", holds=True)

    def _memory(self) -> dict[str, Array]:
        """Allocate the arrays of :data:`GOVERNOR_CALL`, by the names of its fields.

        ``limits`` already has its values; the other arrays are written by C or in each tick.
        """
        task, kept = self._task, self._kept
        jerk = np.full(task.n, np.inf) if kept.jerk is None else kept.jerk
        bounds = [kept.velocity, kept.acceleration, jerk, [self._margin]]
        return {
            "limits": np.concatenate(bounds),
            "target": np.zeros(16 * len(task.frames)),
            "twist": np.zeros(task.twist_size),
            "leaf": np.zeros(task.r),
            "q": np.zeros(task.n),
            "result": np.zeros(task.n),
            "last": np.zeros(task.n),
            "samples": np.zeros((ROOM, task.n)),
            "ways": np.zeros((ROOM, task.n)),
        }

    def __getstate__(self) -> dict[str, Any]:
        """Return the attributes for a copy or pickle, without the memory that C shares."""
        connected = "arm call address target twist asked_leaf begin native ask samples ways error"
        own = {f"_{name}" for name in [*connected.split(), "kept_state"]}
        kept = {name: value for name, value in vars(self).items() if name not in own}
        return kept | {"_state": self._state.copy(), "_q": self._q.copy()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._connect()
        self._q[...] = state["_q"]

    def __repr__(self) -> str:
        state = f"at q = {row(self.q)}" if self._on else "not started"
        return f"<Governor of {self._task.robot.name} {self._task.frame}, {state}>"

    @property
    def q(self) -> Array:
        """Commanded configuration (n,), rad or m."""
        self._check_started()
        return self._q.copy()

    @property
    def leaf(self) -> Array:
        """Level c (r,) of the leaf on which the commanded configuration lies: h(q).

        While a joint comes back from beyond its limit, this is the level at which that motion ends.
        """
        self._check_started()
        return self._inverse.leaf(np.clip(self._q, self._lower, self._upper))

    @property
    def recovering(self) -> bool:
        """True while a joint of the command is within ``margin`` of its limit, or beyond it."""
        self._check_started()
        return bool(((self._q < self._lower) | (self._q > self._upper)).any())

    @property
    def beyond_closing_radius(self) -> bool | None:
        """True if the commanded pose is beyond the proved closing radius; None without ``closes=``.

        The radius is around a start pose or a path, as ``closes.around`` says. Every closed path
        within this radius is proved to end in the configuration it began in. Paths beyond the
        radius may close too, but this is not proved. The proof holds for the levels h(q) at q =
        ``closes.start``, and for levels that differ from them by at most
        :attr:`ClosingRadius.leaf`, by default 0. At other levels, every pose counts as beyond the
        radius.
        """
        return beyond(self._closes, self._inverse, self.q) if self._closes else None

    @property
    def nearest_bodies(self) -> tuple[str, str] | None:
        """Links of the two bodies that stop the arm, while the status is ``BODIES``; else None."""
        if self._guard is None or not self._on or self._said is not Status.BODIES:
            return None
        return self._guard.nearest

    def keeps_distance(self, Q: ArrayLike) -> bool:
        """Test whether the bodies keep ``body_distance`` on a motion that another program plans.

        The result is True without ``bodies=``. The result can be False although the distance is
        kept, if it is kept by less than 1 mm, or if successive configurations are far apart.

        Parameters
        ----------
        Q : (K, n) array
            The K configurations of the motion; in between, the joints move on a straight line.
        """
        self._check_started()
        Q = as_configurations(Q, self._task.n, repr(self._task))
        return self._guard is None or self._guard.keeps(Q)

    def start(self, q: ArrayLike) -> None:
        """Start or restart at rest at a configuration, on its leaf.

        The leaf is the set h(q) = c of the inverse's potentials h through this configuration. A
        joint may be within ``margin`` of its limit, or beyond the limit by at most 0.1 rad or m.
        In both cases, the first target or twist moves the joint straight inside, never farther out.
        The speed is at most a tenth of the limits, and the status ``RECOVERING``. Once begun, this
        motion continues until the joint is inside; the arm is then on the leaf of the motion's
        last configuration. If this method raises an error, a governor that had started before goes
        on from its last command.

        Parameters
        ----------
        q : (n,) array
            Configuration of the robot at rest: the last command, or the measurement.

        Raises
        ------
        InputError
            If q is farther beyond a joint limit or outside the region Ω, if the frame is at least
            10⁶ m from the base, if two bodies are closer than ``body_distance`` + 0.1 mm, or if
            ``body_distance`` may not be kept on the motion of a joint back inside.
        SingularityError
            If J_V = [J; Vᵀ], with the gradients V of h, is singular at q.
        """
        q = self._task.check(q, "the start", beyond=RECOVERABLE)
        inside = np.clip(q, self._lower, self._upper)
        region = self._inverse.region
        if region is not None and not region.ratio(inside[None])[0] <= 1 + 1e-9:
            raise InputError(
                f"the start q = {row(q)} is outside the region Ω of the inverse; "
                "start inside Ω, or use an inverse without a region"
            )
        self._inverse(inside)
        state = self._state.copy()
        remembered = {} if self._guard is None else self._guard.remembered()
        try:
            self._begin_at(q, inside)
        except BaseException:
            self._state[...] = state
            if self._guard is not None:
                self._guard.recall(remembered)
            raise
        self._q[...] = q
        self._on, self._said = True, Status.OK

    def _begin_at(self, q: Array, inside: Array) -> None:
        """Start C and the guard of body distances at q (n,); raise InputError if either refuses q.

        If q is beyond a joint limit or its margin, the arm first moves straight to ``inside`` (n,).
        """
        if self._guard is not None:
            self._guard.start(inside)
            way = np.linspace(q, inside, ROOM)
            if (q != inside).any() and not self._guard.keeps(way):
                raise InputError(
                    f"{self._task.joint_names[int(np.argmax(np.abs(q - inside)))]!r} is beyond its "
                    "limit or margin, and two bodies would come closer than body_distance on the "
                    "straight motion back",
                    remedy="move the joints within their limits by hand",
                )
        self._begin[...] = q
        status = Status(self._native.call_governor_start(self._address))
        if status is Status.BAD_NUMBER:
            raise InputError(
                "the frame is 10⁶ m or more from the base, where no target is accepted",
                remedy="correct the joint origins in the model",
            )
        assert status is Status.OK, status  # all else was refused above

    def step(
        self,
        target: Placement | None = None,
        twist: ArrayLike | None = None,
        *,
        leaf: ArrayLike | None = None,
    ) -> tuple[Array, Status]:
        """Compute the next configuration to command, once per tick of the control loop.

        Parameters
        ----------
        target : pinocchio.SE3 or (4, 4) array, optional
            Placement, in the base frame, to which the frame moves as fast as the limits allow.
            From rest, the frame moves on a straight line and rotates about one axis. For a task of
            several frames, a list with one placement per frame; at any time, all frames have
            completed the same share of their lines.
        twist : (6,) or (F, 6) array, optional
            Velocity (v, ω) of the frame, or of each of F frames, in base axes, m/s and rad/s,
            instead of a target. Without target, twist and leaf, the arm stops.
        leaf : (r,) array, optional
            Level c to which the arm moves: with a target, on one straight line of pose and level;
            with a twist, at the same time; alone, by moving the elbow while the frame rests. If
            ``leaf`` is None, a call with a target continues to the level given last; in a call
            without a target, the level stops changing.

        Returns
        -------
        q : (n,) array
            Next configuration to command, rad or m.
        status : Status
            Outcome of the tick.

        Raises
        ------
        InputError
            If an argument has the wrong type or size, or both a target and a twist are given.
            Numbers that are not finite raise no error, but stop the arm, with
            ``Status.BAD_NUMBER``.
        RepctlError
            If the body distances of a plan could not be computed. The command and the whole state
            of the governor are then as before the call.
        """
        self._check_started()
        if target is not None and twist is not None:
            raise InputError("target and twist are mutually exclusive; give one of them")
        given = 0
        if target is not None:
            known = type(target) is self._task.target_type  # its check takes longer
            placed: Any = target if known else self._task.as_target(target)
            self._target[...] = placed.homogeneous
            given = _TARGET
        elif twist is not None:
            self._twist[...] = _as_twists(twist, self._task)
            given = _TWIST
        if leaf is not None:
            asked = self._asked_leaf
            known = type(leaf) is np.ndarray and leaf.dtype == float and leaf.shape == asked.shape
            asked[...] = leaf if known else _as_level(leaf, self._task.r)
            given |= _LEAF
        if self._guard is None:
            status = self._native.call_governor_step(self._address, given)
            return self._q.copy(), _STATUS[status]
        return self._guarded_step(self._guard, given)

    def _guarded_step(self, guard: BodyGuard, given: int) -> tuple[Array, Status]:
        """Compute the next configuration (n,) and its status, with a guard of body distances.

        ``given`` tells which arguments of :meth:`step` were given: it is the sum of 1 for a target,
        2 for a twist and 4 for a level. Write their values to the memory shared with C first.
        Errors of the guard must not pass through C, so they are raised after the call of C. After
        an error, the governor is as it was before the tick.
        """
        self._native.call_governor_keep(self._address)
        self._error: BaseException | None = None
        self._remembered: dict[str, Any] = {}
        try:
            status = self._native.call_governor_step(self._address, given)
            if self._error is not None:
                raise self._error
        except BaseException:
            self._native.call_governor_undo(self._address)
            if self._remembered:
                guard.recall(self._remembered)
            raise
        finally:
            self._error = None
            self._remembered = {}  # copies and pickles need no memory of a tick that is over
        self._said = _STATUS[status]
        return self._q.copy(), self._said

    def _allows(self, count: int, first: int) -> int:
        """Tell C whether a plan keeps all body distances: 1 if so, else 0.

        The plan is the first ``count`` samples in the memory that C shares with Python. C calls
        this in the middle of a tick, and can try several plans in one tick. ``first`` is 1 for the
        first plan of a tick, else 0; together, the plans of a tick may measure 30 distances.
        The first error of a tick is kept, and raised after the call of C.
        """
        if self._error is not None:
            return 0
        try:
            assert self._guard is not None
            # as it was before the tick, whose first question this is
            self._remembered = self._remembered or self._guard.remembered()
            if first:
                self._guard.begin_tick()
            return int(self._guard.allows(self._samples[:count], self._ways[:count]))
        except BaseException as error:  # it must not pass through C
            self._error = _unmeasured(error)
            return 0

    def _check_started(self) -> None:
        """Raise InputError if the governor has not started."""
        if not self._on:
            raise InputError(
                "the governor has not started; call start(q) with the present configuration"
            )


def _unmeasured(error: BaseException) -> BaseException:
    """Convert an error of the guard, raised during a tick, to a RepctlError of one line.

    A RepctlError is returned unchanged, and so is a BaseException that is no Exception, such as
    KeyboardInterrupt.
    """
    if isinstance(error, RepctlError) or not isinstance(error, Exception):
        return error
    failed = RepctlError(
        f"the body distances of a plan were not found ({type(error).__name__}: {error}), and the "
        "command is still the last one",
        remedy="stop the robot, or repeat the tick",
    )
    failed.__cause__ = error
    return failed


def _as_twists(twist: ArrayLike, task: Task) -> Array:
    """Convert the twists (v, ω) of F frames, (6 F,) or (F, 6), to an array (6 F,).

    Numbers that are not finite are passed on to C, which stops the arm; an error here would end the
    control loop instead.
    """
    rates, size = as_numbers(twist), task.twist_size
    if rates is not None and rates.ndim == 2 and rates.shape[1] == 6:
        rates = rates.ravel()
    if rates is None or rates.shape != (size,):
        each = f" for each of {', '.join(task.frames)}" if size > 6 else ""
        raise InputError(
            f"must be 6 numbers (v, ω){each}, m/s and rad/s; got {shown(twist)}", argument="twist"
        )
    return rates


def _as_level(leaf: ArrayLike, r: int) -> Array:
    """Convert a level c to an array (r,); InputError for another size.

    C, not this function, tests whether its numbers are finite.
    """
    level = as_numbers(leaf)
    if level is None or np.atleast_1d(level).shape != (r,):
        count = f"{r} numbers, the levels of the potentials" if r > 1 else "1 number, the level"
        raise InputError(f"must be {count}; got {shown(leaf)}", argument="leaf")
    return level


def _kept_limits(task: Task, limits: Limits) -> JointLimits:
    """Convert limits to one number per joint; raise InputError for limits that are not supported.

    A governor does not support limits of torque or of the tool's speed. It requires a speed limit
    of every joint: that of ``limits`` or, by default, that of the URDF.
    """
    kept = joint_limits(task, limits)
    for name, value in (("torque", kept.torque), ("tool_speed", kept.tool)):
        if value is not None:
            raise InputError(
                ": a governor does not support this limit",
                argument=name,
                remedy=f"use rp.Limits(…) without {name}=",
            )
    if not np.isfinite(kept.velocity).all():
        name = task.joint_names[int(np.argmax(~np.isfinite(kept.velocity)))]
        raise InputError(
            f"joint {name!r} has no speed limit: the model has none, and limits have no velocity=",
            remedy="give one speed per joint: rp.Limits(velocity=[…], …), rad/s or m/s",
        )
    return kept
