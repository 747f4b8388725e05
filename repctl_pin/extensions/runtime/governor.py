"""Limits kept at run time: motion on a leaf to any target, with a known stop at every tick."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ...arguments import Array, as_numbers, positive, require_type, row, shown
from ...errors import InputError, SingularityError
from ...model.chain_formulas import Placement, as_placement, is_rotation
from ...motion.limits import Limits, joint_limits
from ...strategies.repeatable import RepeatableInverse
from .governor_law import (
    CommandLimits,
    Now,
    arrival_speed,
    braking,
    closing,
    fastest,
    next_rate,
    way_of_release,
)
from .governor_plans import MOST, STRIDE, Planner
from .leaf_direction import leaf_direction
from .status import BLOCKED
from .status import Status as Status
from .target_joints import TargetJoints

_SLOWER, _FASTER, _SLOWEST = 0.7, 1.1, 1e-3
"""Factor of the speed after a plan that violates a limit, factor after a plan that does not, and
minimum of their product."""

_NEAR, _REACHED = 1e-10, 1e-6
"""Maximum distance of the joints from a target that counts as reached, rad or m. Maximum error of
the joint speeds, as a fraction of their limits, at a twist that counts as reached."""

_SAME = 1e-7
"""Maximum distance of q from the target's configuration, rad or m, at which an arm at the target
counts as being in that configuration."""

_CLOSE, _ALIKE = 0.3, 0.1
"""Conditions to return to the straight line to a target: maximum distance of q from the target's
configuration, rad or m, and maximum error of the line's first-order motion of the joints to it, as
a fraction of that distance."""

_STUCK, _SLOW = 25, 0.02
"""Number of plans without progress after which the straight line is left, and the fraction of the
speed limits below which all joint speeds count as no progress."""

_HUGE = 1e6
"""Magnitude from which positions and speeds of an input are refused, m, m/s or rad/s."""

_Input = tuple[pin.SE3 | None, Array | None]


class Governor:
    """Online motion generator: moves to any target, or by any twist, within all limits.

    The commanded configuration stays on one leaf, and the first, second and third differences of
    its samples, divided by dt, dt² and dt³, never exceed the limits of speed, acceleration and
    jerk. Every few ticks a new plan is made: a short motion towards the target, and a stop after
    it. All samples of a plan are checked before the first one is sent. If no new plan keeps the
    limits, the previous plan is followed to its stop. So a stop within the limits is known at
    every tick, whatever the input is, and also if the robot misses ticks.

    Parameters
    ----------
    inverse
        Repeatable inverse, such as ``design.inverse`` or ``found.function.inverse``. If it has a
        region Ω, the arm stops before its edge.
    dt
        Time step of the loop, s.
    limits
        Limits of acceleration and, if given, of speed and jerk, as for :func:`timed`; a governor
        takes none of torque or the tool's speed.
    margin
        Distance kept from the joint limits, rad (m).

    Attributes
    ----------
    q : (n,) array
        Commanded configuration.
    leaf : (r,) array
        Level c of the leaf on which q stays.

    Raises
    ------
    InputError
        If a limit is missing or not above 0, or dt is not.

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
    ) -> None:
        self._inverse = require_type(
            inverse,
            RepeatableInverse,
            "inverse",
            "a repeatable inverse, such as design.inverse or found.function.inverse",
        )
        self._task = task = inverse.task
        if task.coordinates is not None:
            raise InputError(
                "the governor's limits are of the robot's own joints; use the original task"
            )
        dt = positive(dt, "dt", "s")
        kept = joint_limits(task, limits)
        for name, value in (("torque", kept.torque), ("tool_speed", kept.tool)):
            if value is not None:
                raise InputError(
                    ": a governor does not keep it",
                    argument=name,
                    remedy=f"omit {name}= of limits",
                )
        if not np.isfinite(kept.velocity).all():
            name = task.joint_names[int(np.argmax(~np.isfinite(kept.velocity)))]
            raise InputError(
                f"velocity= is missing in limits: the URDF has no speed limit of {name!r}",
                remedy="give a speed limit per joint",
            )
        jerks = np.full(task.n, np.inf) if kept.jerk is None else kept.jerk
        margin = positive(margin, "margin", "rad (m)", zero=True)
        lower, upper = task.lower + margin, task.upper - margin
        if not (lower < upper).all():
            name = task.joint_names[int(np.argmax(lower >= upper))]
            raise InputError(
                f"margin = {margin:g} leaves no range of {name!r}; give a smaller one"
            )
        self._margin, self._stride = margin, max(int(STRIDE / dt + 0.5), 1)
        self._bounds = CommandLimits(
            kept.velocity,
            kept.acceleration,
            jerks,
            lower,
            upper,
            dt,
            self._stride * dt,
        )
        self._planner = Planner(inverse, self._bounds)
        self._joints = TargetJoints(inverse, self._bounds)
        self._on = False

    def __repr__(self) -> str:
        state = f"at q = {row(self.q)}" if self._on else "not started"
        return f"<Governor of {self._task.robot.name} {self._task.frame}, {state}>"

    @property
    def q(self) -> Array:
        """Commanded configuration (n,)."""
        return self._started().history[-1].copy()

    @property
    def leaf(self) -> Array:
        """Level c (r,) of the leaf on which the commanded configuration stays."""
        return self._started().solver.leaf.copy()

    def start(self, q: ArrayLike) -> None:
        """Start or restart at rest at a configuration; the motion stays on its leaf.

        Parameters
        ----------
        q : (n,) array
            Configuration of the robot, at rest: the last one commanded, or the measured one.

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
                f"{self._margin + short[worst]:.3g} where margin = {self._margin:g} is to be kept",
                remedy="start farther from the limit, or use a smaller margin",
            )
        region = self._inverse.region
        if region is not None and not region.ratio(q[None])[0] <= 1 + 1e-9:
            raise InputError(
                f"the start q = {row(q)} is outside Ω; start inside, "
                "or use an inverse without a region"
            )
        self._inverse(q)
        self._planner.start(q)
        self._joints.start(q, self._planner.solver.leaf)
        self._on, self._wait, self._pace = True, 0, 1.0
        self._status = self._cause = Status.OK
        self._heard: _Input = (None, None)
        self._landing: pin.SE3 | None = None
        self._stuck, self._by_joints, self._exhausted = 0, False, False

    def step(
        self, target: Placement | None = None, twist: ArrayLike | None = None
    ) -> tuple[Array, Status]:
        """Compute the next configuration to command, once per tick of the control loop.

        Parameters
        ----------
        target : pinocchio.SE3 or (4, 4) array, optional
            Placement of the frame to move to, as fast as the limits allow, on a straight line with
            a rotation about one axis, if the arm begins at rest.
        twist : (6,) array, optional
            Velocity (v, ω) of the frame, base axes, m/s and rad/s, instead of a target. Without
            target and twist, the arm stops.

        Returns
        -------
        q : (n,) array
            Next configuration to command.
        status : Status
            Outcome of the tick.

        Raises
        ------
        InputError
            If an argument has the wrong type or size. Numbers that are not finite raise nothing:
            the arm stops, with ``Status.BAD_NUMBER``.
        """
        planner = self._started()
        goal, rates = taken_input(target, twist)
        usable = self._usable(goal, rates)
        if usable and self._wait <= 0:
            planner.solver.left = MOST
            self._status = self._replan(goal, rates)
            self._wait, self._heard = self._stride, (goal, rates)
        self._wait -= 1
        q = planner.next().copy()
        if not usable:
            return q, Status.BAD_NUMBER
        if self._status is Status.OK and not _same(self._heard, (goal, rates)):
            return q, Status.SLOWED  # of an input that no plan has heeded yet
        return q, self._status

    def _usable(self, target: pin.SE3 | None, twist: Array | None) -> bool:
        """Test whether an input is finite, below 1e6, and its rotation matrix is a rotation."""
        if twist is not None and not (np.abs(twist) < _HUGE).all():
            return False
        if target is None:
            return True
        turns = self._task.kind in ("pose", "axis")
        return bool((np.abs(target.translation) < _HUGE).all()) and (
            not turns or is_rotation(target.rotation.ravel().tolist())
        )

    def _started(self) -> Planner:
        if not self._on:
            raise InputError(
                "the governor has not started; call start(q) with the robot's joints"
            )
        return self._planner

    # ---- the law -------------------------------------------------------------------------------

    def _replan(self, target: pin.SE3 | None, twist: Array | None) -> Status:
        """Look for a new plan, and return the status; without one, the last plan continues."""
        if target is None or target != self._heard[0]:
            self._stuck, self._by_joints = 0, False
        try:
            now = self._planner.now()
        except SingularityError:
            return Status.SINGULAR
        if target is not None:
            return self._approach(now, target)
        return self._follow(now, np.zeros(6) if twist is None else twist)

    def _follow(self, now: Now, twist: Array) -> Status:
        """Plan the next motion by a twist (6,) of the frame, and return the status."""
        rate = self._task.task_velocity(now.q, twist)
        way = now.course.velocity(rate)
        status = self._drive(now, way, 1.0)
        left_out = now.G @ (rate - now.course.task_rates() @ way)
        if status is Status.OK and not self._is_slow(left_out):
            return Status.OUTSIDE  # along a coordinate of width 0
        return status

    def _approach(self, now: Now, target: pin.SE3) -> Status:
        """Plan the next motion towards a target, or the stop at it, and return the status."""
        planner = self._planner
        landed = planner.plan.lands and target == self._landing
        if landed:  # only in ticks without a plan
            self._joints.look_for(target)
            if not planner.at_rest():
                return Status.SLOWED
        if self._stuck > _STUCK and self._other_way(now, target):
            return self._status
        way = now.course.way(target)
        g = now.joint_rates(way)
        if landed or (planner.at_rest() and np.abs(g).max() < _NEAR):
            if not landed:
                self._joints.look_for(target)
            if self._is_there(now.q):
                return Status.OK if now.course.holds(target) else Status.OUTSIDE
            if not self._by_joints:
                return Status.SLOWED
        if self._by_joints:
            way, g = self._way_of_joints(now, way, g)
        a, jerk = braking(self._bounds, now, g)
        tries = not self._by_joints and not self._exhausted
        if tries and planner.land(now, way, g, a, jerk):
            self._landing, self._pace = target, 1.0
            return Status.SLOWED
        self._exhausted = (
            planner.solver.left < 0
        )  # by the landing: the next tick is for a stride
        left = 1.0 - way_of_release(*closing(now, g), jerk)
        speed = arrival_speed(left, a, jerk, 2 * self._bounds.stride)
        status = self._drive(now, way, speed, lands=True)
        slow = (np.abs(now.qdot) < _SLOW * self._bounds.velocity).all()
        self._stuck = self._stuck + 1 if slow and status in BLOCKED else 0
        return status

    def _is_there(self, q: Array) -> bool:
        """Test whether q, which has the target's pose, is the target's configuration F(x; c).

        If it is not, the motion towards that configuration follows.
        """
        joints = self._joints
        if joints.found is not None and np.abs(q - joints.found).max() > _SAME:
            self._by_joints = True
        return joints.known and not self._by_joints

    def _way_of_joints(self, now: Now, way: Array, g: Array) -> tuple[Array, Array]:
        """Choose the displacements of the course (6,) and of the joints (n,) to plan along.

        They lead towards the target's configuration; ``way`` and ``g`` are those of the straight
        line, which are returned if they lead there, too.
        """
        assert self._joints.found is not None
        distance = self._joints.found - now.q
        size = float(np.abs(distance).max())
        if size < _CLOSE and np.abs(distance - g).max() < _ALIKE * size:
            self._by_joints = False
            return way, g
        direction = leaf_direction(self._inverse, now.q, self._joints.found)
        way = now.course.velocity(self._task.jacobian(now.q) @ direction)
        return way, now.joint_rates(way)

    def _other_way(self, now: Now, target: pin.SE3) -> bool:
        """Move towards the target's configuration from now on, as the straight line is blocked.

        At the edge of a cell, come to rest first and begin again: from rest, the straight line does
        not leave the cell. Returns True while the arm comes to rest, or while that configuration is
        still being computed.
        """
        if now.course.bounded and self._status is Status.OUTSIDE:
            if not self._planner.at_rest():
                return True
            self._stuck, self._by_joints, self._pace = 0, False, 1.0
            return False
        self._joints.look_for(target)
        if not self._joints.known:
            return True
        self._by_joints |= self._joints.found is not None
        self._stuck = 0
        return False

    def _drive(
        self, now: Now, way: Array, asked: float, *, lands: bool = False
    ) -> Status:
        """Plan the fastest motion along a displacement (6,) of the course within all limits.

        ``asked`` is the requested speed, as a multiple of the displacement per s; ``lands`` says
        that it ends at a target. Returns the tick's status.
        """
        if not way.any():
            return self._reached(now, way)
        by_speed, by_limit = fastest(self._bounds, now, way)
        speed = min(asked, min(by_speed, by_limit) * self._pace)
        later = next_rate(self._bounds, now, way * speed)
        cause = self._planner.go_on(now, later)
        if cause is Status.SLOWED:
            self._planner.go_on(now, (now.later + later) / 2)
            return cause
        if cause is not Status.OK:
            self._pace, self._cause = max(_SLOWER * self._pace, _SLOWEST), cause
            return cause
        self._pace = min(_FASTER * self._pace, 1.0)
        if self._pace < 1:
            return self._cause
        if by_limit < min(by_speed, asked):
            return Status.LIMIT
        return Status.SLOWED if lands else self._reached(now, way)

    def _reached(self, now: Now, twist: Array) -> Status:
        """Compare the velocity with the requested one (6,): OK if equal, else SLOWED."""
        away = now.joint_rates(twist - now.twist)
        return Status.OK if self._is_slow(away) else Status.SLOWED

    def _is_slow(self, qdot: Array) -> bool:
        """Test whether joint speeds (n,) are negligible."""
        return bool((np.abs(qdot) <= _REACHED * self._bounds.velocity).all())


def taken_input(target: Placement | None, twist: ArrayLike | None) -> _Input:
    """Convert a target to SE3 or a twist to an array (6,); their numbers need not be finite."""
    if target is not None and twist is not None:
        raise InputError("target and twist are mutually exclusive; give one of them")
    goal = None if target is None else pin.SE3(as_placement(target))
    if twist is None:
        return goal, None
    rates = as_numbers(twist)
    if rates is None or rates.shape != (6,):
        raise InputError(
            f"must be 6 numbers (v, ω), m/s and rad/s; got {shown(twist)}",
            argument="twist",
        )
    return goal, rates.copy()


def _same(one: _Input, other: _Input) -> bool:
    """Test whether two inputs (target, twist) are equal; no input is equal to the twist 0."""
    if other[0] is not None:
        return one[0] is not None and bool(one[0] == other[0])
    before, now = (np.zeros(6) if x[1] is None else x[1] for x in (one, other))
    return one[0] is None and np.array_equal(before, now)
