"""Servo: one joint command per tick, from targets and measured joints; independent of ROS.

A tick is one period of the control loop. A governor computes commands within all limits. A leaf is
the set h(q) = c on which a repeatable inverse keeps the arm; its level c is the position of the
elbow along the self-motion. The clutch, while it is engaged, makes the arm's target move with an
operator's hand; while it is released, the hand moves freely. A tracker measures hand and elbow of
the operator in a frame of its own. The age of a message is the present time minus its time stamp,
s. Ω is the region of joint space of a design. A cell is a box of poses over which a function F
gives one configuration per pose. A twist is the velocity (v, ω) of the frame, in base axes.
Letters: n joints, r potentials h.

``ElbowLevel`` is the level c at which the elbow is nearest to a point, and the configuration there.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from enum import Enum
from typing import Literal

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ...base.arguments import Array, positive, shown
from ...base.certificate import beyond
from ...base.errors import InputError, RepctlError, SingularityError
from ...design.design_result import Design
from ...model.bodies import Bodies
from ...model.chain_formulas import Placement
from ...model.several_frames import one_frame
from ...model.tool import require_pose, rigid
from ...motion.limits import Limits, joint_limits
from ...strategies.elbow import ElbowLevel
from ..cells.cell_design_result import CellDesign
from ..runtime.clutch import Clutch
from ..runtime.governor import Governor, Status
from .elbow_thread import ElbowSearch
from .servo_inputs import SAME, JointReadings, clock_difference, target_of
from .steady_time import SteadyTime

_ROOM = 0.02
"""Distance from the joint limits that the level for an elbow keeps, rad or m."""

_REST = 4
"""Number of equal commands after which the arm counts as at rest."""


_AHEAD = {
    Status.SINGULAR: "a singularity is ahead, or no motion to the target was found",
    Status.BAD_NUMBER: "one of its numbers is too large, or its matrix is not a rotation",
    Status.OUTSIDE: "the region Ω, or the cell, ends ahead",
    Status.LIMIT: "a joint limit is ahead",
    Status.BODIES: "two bodies are near each other ahead",
    Status.RECOVERING: "a joint is beyond its limit",
}
"""Description of what stops the arm, by the governor's status."""


_NO_TOOL = pin.SE3.Identity()

_BEYOND = "beyond the proved radius"
"""Words of the status while the command is beyond the closing radius; it is no error."""


class State(Enum):
    """State of a :class:`Servo`, which decides what its ticks command.

    WAITING: no command until the joints have been measured at rest. RUNNING: the arm follows its
    targets. HOLDING: the arm stops, and stays at rest until :meth:`Servo.resume`.
    """

    WAITING = "waiting"
    RUNNING = "running"
    HOLDING = "holding"


class Servo:
    """Generator of one joint command per tick, from target poses or twists and measured joints.

    The commands stay within the limits, and on one leaf, the set h(q) = c of the design's
    potentials h, until :meth:`leaf`, :meth:`level` or :meth:`elbow` gives another level c. A
    governor computes the commands, and also stops the arm at the edge of Ω, the design's region.
    All times, passed as ``now``, are of one clock, in s. While the clock steps back or stops, each
    tick counts as one period, so time-outs still expire. An invalid target or twist raises no
    error, but stops the arm, and :attr:`reason` describes why.

    Parameters
    ----------
    design
        Design of a repeatable inverse, or of a cell's function.
    rate
        Ticks per second, 1/s.
    limits
        Limits of acceleration, speed and jerk, as for :class:`Governor`.
    timeout
        Maximum age of measured joints and of messages, s.
    tolerance
        Maximum distance of a measured joint from its command, rad or m. If it is exceeded, the arm
        does not follow its commands, and is stopped.
    bodies, body_distance, unchecked
        Bodies that must keep a distance; the distance, m; and ``"allow"`` to accept links without a
        body. See :class:`Governor`.
    tool
        Placement of the tool in the frame of the design; targets and twists are then the tool's.
    clutch
        Clutch between the operator's hand and the arm. By default, the arm translates and rotates
        by as much as the hand, and the axes of the tracker are those of the base.
    """

    def __init__(
        self,
        design: Design | CellDesign,
        rate: float,
        limits: Limits,
        *,
        timeout: float = 0.1,
        tolerance: float = 0.2,
        bodies: Bodies | None = None,
        body_distance: float = 0.02,
        unchecked: Literal["refuse", "allow"] = "refuse",
        tool: Placement | None = None,
        clutch: Clutch | None = None,
    ) -> None:
        # rate and tolerances
        self.dt = 1 / positive(rate, "rate", "1/s")
        self.timeout = positive(timeout, "timeout", "s")
        self.tolerance = positive(tolerance, "tolerance", "rad (m)")
        # the law, and the tool that it moves
        if tool is not None and isinstance(design, Design):
            design, tool = design.with_tool(tool), None
        self.cell = design.function.cell if isinstance(design, CellDesign) else None
        inverse = design.function.inverse if isinstance(design, CellDesign) else design.inverse
        self._inverse = inverse
        self._elbow = ElbowSearch(_levels_of(design))
        self.task = one_frame(inverse.task, "the ROS 2 node")
        self.tool = None if tool is None else rigid(tool)
        if tool is not None:
            require_pose(self.task)
        proof = design.proof if isinstance(design, Design) else None
        self._closes = proof.closes if proof else None
        # the governor keeps the limits
        self._governor = Governor(
            inverse,
            self.dt,
            limits,
            bodies=bodies,
            body_distance=body_distance,
            unchecked=unchecked,
        )
        self._clutch = Clutch() if clutch is None else clutch
        self._coupled = False
        self._limits = joint_limits(self.task, limits)
        robot = self.task.robot
        self.base = robot.base or robot.model.frames[1].name
        # state of the node: no joints were received
        self.state = State.WAITING
        self.reason = "no joint states yet"
        self.status = Status.OK
        self._time = SteadyTime(self.dt)
        self._readings = JointReadings(self.task.joint_names)
        self._commands: list[Array] = []
        self._leaf: Array | None = None
        self._asked: Array | None = None
        self._hand: pin.SE3 | None = None
        self._joined = False
        self._held = ""
        self._fault = False
        self._target: pin.SE3 | None = None
        self._twist: Array | None = None
        self._heard = 0.0

    # ---- messages ------------------------------------------------------------------------------

    def joints(self, positions: Mapping[str, float], now: float, *, age: float = 0.0) -> None:
        """Store measured joint positions, rad or m, by name; names of other joints are ignored.

        ``now`` is the time at which the message arrives, s, and ``age`` its age, s.
        """
        self._readings.take(positions, self._time.at(now), age)

    def pose(
        self,
        position: Sequence[float],
        quaternion: Sequence[float],
        *,
        frame: str = "",
        age: float = 0.0,
    ) -> None:
        """Set the target: position (x, y, z), m, and quaternion (x, y, z, w), in the base frame.

        ``frame`` is the name of the frame in which the target is given, which must be the base or
        empty. ``age`` is the age of the message, s. An invalid target stops the arm.
        """
        if self._usable("target", frame, age):
            try:
                target = target_of(position, quaternion, self.task, self.cell, self.tool)
                self._replace()
                self._target = target
            except InputError as error:
                self._refuse(f"target refused: {error}")

    def twist(
        self, twist: Sequence[float], now: float, *, frame: str = "", age: float = 0.0
    ) -> None:
        """Set the velocity (v, ω) to follow, base axes, m/s and rad/s, until ``now`` + ``timeout``.

        ``frame`` must be the name of the base or empty; ``age`` is the age of the message, s. An
        invalid twist stops the arm.
        """
        if self._usable("twist", frame, age):
            if not np.isfinite(twist).all():
                self._refuse("twist refused: its numbers must be finite")
                return
            self._replace()
            self._twist = np.array(twist, float)
            self._heard = self._time.at(now)

    def couple(self, coupled: bool) -> None:
        """Engage the clutch at the next hand pose if ``coupled``; else release it and stop the arm.

        If the servo is not RUNNING, ``coupled`` has no effect. A servo that stops releases the
        clutch; call this method again after that.
        """
        self._forget()
        self._coupled = coupled and self.state is State.RUNNING
        if self._coupled:
            self.reason = ""

    def hand(
        self,
        position: Sequence[float],
        quaternion: Sequence[float],
        now: float,
        *,
        age: float = 0.0,
    ) -> None:
        """Set the pose of the operator's hand, in its tracker's frame, valid for ``timeout``.

        The pose is a position (x, y, z), m, and a quaternion (x, y, z, w). ``now`` is the time, s,
        ``age`` the age of the message, s. The first pose after :meth:`couple` engages the clutch;
        the following ones move the target. An invalid pose releases the clutch, and stops the arm.
        """
        if not self._coupled or not self._usable("hand pose", "", age):
            return
        try:
            hand = target_of(position, quaternion, self.task, None)
        except InputError as error:
            self._refuse(f"hand pose refused: {error}")
            return
        if not self._clutch.engaged:
            self._clutch.engage(hand, self._placement() * (self.tool or _NO_TOOL))
        target = self._clutch.target(hand)
        if target is not None and self.tool is not None:
            target = target * self.tool.inverse()
        self._target, self._heard, self._hand = target, self._time.at(now), hand

    def hand_elbow(self, point: Sequence[float], *, age: float = 0.0) -> None:
        """Set the operator's elbow (3,), tracker's frame, m, with which the arm's elbow moves.

        The point has an effect only while the clutch is engaged. A point that is not finite
        releases the elbow alone: the level then stays constant until the clutch is engaged again.
        A message whose ``age``, s, exceeds the timeout stops the arm.
        """
        if not self._clutch.engaged or not self._usable("elbow", "", age):
            return
        if not self._joined and self._hand is not None and self._target is not None:
            place = self._target * (self.tool or _NO_TOOL)
            own = self._inverse.elbow(self._governor.q)
            self._clutch.engage(self._hand, place, elbow=point, elbow_at=own)
            self._joined = True
        moved = self._clutch.elbow(point)
        if moved is None:
            self._elbow.drop()
            self.reason = "elbow refused: its numbers must be finite; the level stays constant"
        else:
            self._elbow.point = moved

    def elbow(self, point: Sequence[float], *, frame: str = "", age: float = 0.0) -> None:
        """Set the point (3,) for the arm's elbow, in the base frame, m.

        The arm moves to the level whose elbow is nearest to the point, even while its frame is at
        rest. ``frame`` is the frame that the message names: the base, or empty if it names none.
        ``age`` is the age of the message, s. A point that is in another frame, too old or not
        finite stops the arm.
        """
        if self._usable("elbow", frame, age):
            if not np.isfinite(point).all():
                self._refuse("elbow refused: its numbers must be finite")
                return
            self._elbow.point = np.array(point, float)

    def level(self, leaf: ArrayLike) -> None:
        """Move to the level c (r,), even while the frame is at rest.

        If the arm is stopped before it reaches the level, it does not move there later. An invalid
        level stops the arm.
        """
        if self._usable("level", "", 0.0):
            c = np.atleast_1d(np.asarray(leaf, float))
            if refused := self._refused(c):
                self._refuse(f"level refused: {refused}")
                return
            self._elbow.drop()
            self._asked = c

    def leaf(self, leaf: ArrayLike) -> str:
        """Set the level c (r,) to which the arm moves whenever it follows a target or a twist.

        Without a target or a twist, the arm stays at its level. Return the reason if the level is
        invalid, else an empty text.
        """
        c = np.atleast_1d(np.asarray(leaf, float))
        if refused := self._refused(c):
            return refused
        self._leaf, self._asked = c, None
        self._elbow.drop()
        return ""

    def _refused(self, c: Array) -> str:
        """Describe why an array c is not a valid level (r,); return an empty text if it is."""
        if c.shape == (self.task.r,) and np.isfinite(c).all():
            return ""
        return f"leaf must be {self.task.r} finite numbers"

    def hold(self) -> None:
        """Stop within the limits, and stay at rest until :meth:`resume`."""
        self._stop(self._held or "held on request")

    def resume(self) -> None:
        """End a stop by :meth:`hold` or by a fault, and follow what arrives from now on.

        A fault is a measured joint that is farther than ``tolerance`` from its command. After a
        fault, the arm first brakes to rest, if it still moves, and starts from the measured joints.
        """
        self._held = ""
        self._forget()
        if self.state is State.HOLDING and self._fault:
            self.reason = "resumed: once at rest, the arm starts from the measured joints"
        elif self.state is State.HOLDING:
            self.state, self.reason = State.RUNNING, ""

    # ---- ticks ---------------------------------------------------------------------------------

    def tick(self, now: float) -> Array | None:
        """Compute the configuration (n,) to command next, rad or m, at the time ``now``.

        Return None if no command may be sent: until recent measurements show the joints at rest,
        and after a stop because the arm did not follow its commands. :attr:`reason` says why.
        """
        now = self._time.tick(now)
        q, age = self._readings.measured(now)
        late = q is None or not age <= self.timeout
        if self.state is State.WAITING:
            if late or q is None:
                self.reason = self._readings.absent(now)
                self._readings.disturb()
                return None
            if not self._readings.rest(now, self.timeout):
                self.reason = "the arm moves"
                return None
            if not self._start(q):
                return None
        elif late or q is None:
            self._forget()
            self.reason = self._readings.absent(now)
            if self.at_rest:
                self.state = State.WAITING
                return None
        elif self._compare(q, age):
            return None
        if self._twist is not None and now - self._heard > self.timeout:
            self._refuse(f"the last twist is more than {self.timeout:g} s old")
        if self._clutch.engaged and now - self._heard > self.timeout:
            self._refuse(f"the last hand pose is more than {self.timeout:g} s old")
        self._follow_elbow()
        return self._command()

    def _follow_elbow(self) -> None:
        """Use the level that the last search for the elbow has found, and begin the next search."""
        place = self._placement() if self._target is None else self._target
        try:
            found = self._elbow.update(place)
        except RepctlError as error:
            self.reason = f"the level stays constant: none was found for the elbow: {error}"
        else:
            self._asked = self._asked if found is None else found

    def brake(self) -> Array | None:
        """Compute the next configuration (n,) of a stop; None once at rest, or while WAITING.

        A servo that is WAITING commands no motion. Call this method once per tick when the program
        ends; measured joints are not needed.
        """
        self._forget()
        return None if self.state is State.WAITING or self.at_rest else self._command()

    @property
    def at_rest(self) -> bool:
        """True if the last four commands are equal."""
        last = self._commands
        return len(last) == _REST and all((q == last[0]).all() for q in last)

    @property
    def stopped_early(self) -> bool:
        """True if the governor slows down or stops the arm before its target or its level.

        The cause is a joint limit, near bodies, a singularity, or the edge of the region Ω or the
        cell ahead. It can also be an invalid target, or a joint that is already beyond its limit.
        """
        asked = self._moving_asked() or self._asked is not None
        return self.state is State.RUNNING and asked and self.status in _AHEAD

    @property
    def elbow_said(self) -> str:
        """Display text: distance of the elbow from its point, m, or why no level was found.

        The text is empty without a point, and until the first search has ended.
        """
        return self._elbow.said

    @property
    def said(self) -> str:
        """Display text: one line with the state of the servo and, if there is one, the reason.

        The reason is what stops or slows down the arm. The text also states if the commanded pose
        is beyond the closing radius.
        """
        reason = self.reason
        if self.stopped_early and not reason:
            does = "stopped" if self.at_rest else "slowing down"
            reason = f"{does} before the target: {self._ahead()}"
            if self.status is Status.RECOVERING:
                reason = "a joint is beyond its limit or margin: it moves back inside first"
        said = f"{self.state.value}: {reason}" if reason else self.state.value
        return f"{said}, {_BEYOND}" if self.beyond_closing_radius else said

    @property
    def beyond_closing_radius(self) -> bool:
        """True if the commanded pose is beyond the closing radius of the design's certificate.

        Closed paths within this radius of the certificate's start or path are proved to end in the
        configuration they began in. The result is also True at a level that the certificate does
        not cover. It is False if the design has no proved closing radius.
        """
        if not self._closes or self.command is None:
            return False
        return beyond(self._closes, self._inverse, self.command)

    def _ahead(self) -> str:
        """Describe what stops the arm before its target or level, such as a joint limit ahead.

        Call this method only while :attr:`stopped_early` is True.
        """
        if self.status is Status.LIMIT and self.command is not None:
            margin = self.task.limit_margin(self.command)
            return f"the limit of {self.task.joint_names[int(np.argmin(margin))]} is ahead"
        if self._governor.nearest_bodies is not None:
            one, other = self._governor.nearest_bodies
            return f"{one} and {other} are near each other ahead"
        return _AHEAD[self.status]

    @property
    def command(self) -> Array | None:
        """Last commanded configuration (n,), rad or m; None before the first command."""
        return self._commands[-1] if self._commands else None

    @property
    def current_leaf(self) -> Array | None:
        """Level c (r,) of the potentials at the last command; None before the first command."""
        return None if self.command is None else self._inverse.leaf(self.command)

    def _command(self) -> Array:
        """Compute, store and return the next command (n,), which follows the target or twist.

        It also moves the arm toward the level, if another one is set.
        """
        twist = self._twist
        if twist is not None and self.tool is not None:
            arm = self._placement().rotation @ self.tool.translation
            twist = twist - np.r_[np.cross(twist[3:], arm), np.zeros(3)]
        leaf = self._asked
        if leaf is None and self._moving_asked():
            leaf = self._leaf
        q, self.status = self._governor.step(self._target, twist, leaf=leaf)
        self._commands = [*self._commands[1 - _REST :], q]
        return q

    def _placement(self) -> pin.SE3:
        """Placement of the frame at the last command."""
        return self.task.placement(self._governor.q)

    def _moving_asked(self) -> bool:
        """Test whether the arm is running and has a target or a twist to follow.

        Only then does the arm move to the level set by :meth:`leaf`, so that an arm at rest does
        not start to move.
        """
        return self.state is State.RUNNING and (self._target is not None or self._twist is not None)

    def _start(self, q: Array) -> bool:
        """Start at rest at the measured joints q (n,), rad or m; return True if this succeeds.

        If the measured joints agree with the last command, the servo continues from that command,
        so that errors of measurement do not change the level c. If the governor cannot start at q,
        return False; :attr:`reason` then states the cause.
        """
        command = self.command
        if self._fault or command is None or np.abs(q - command).max() > SAME:
            try:
                self._governor.start(q)
            except (InputError, SingularityError) as error:
                self.reason = f"cannot start: {error}"
                return False
            self._commands = [q] * _REST
        self._fault, self.reason = False, self._held
        self.state = State.HOLDING if self._held else State.RUNNING
        self._forget()
        return True

    def _compare(self, q: Array, age: float) -> bool:
        """Compare measured joints q (n,), ``age`` s old, with the last command; stop if too far.

        Too far is more than the tolerance plus the distance that a joint can have moved at its
        speed limit since the measurement. The commands then slow down to rest. Return True once the
        commands are at rest after such a stop: no more commands may then be sent.
        """
        off = np.abs(q - self._commands[-1]) - age * self._limits.velocity  # moved since measured
        if off.max() > self.tolerance and not self._fault:
            j = int(np.argmax(off))
            self._fault = True
            name = self.task.joint_names[j]
            unit = "rad" if self.task.revolute[j] else "m"
            away = abs(float(q[j] - self._commands[-1][j]))
            self._stop(f"the arm does not follow: {name} is {away:.3g} {unit} from its command")
        if self._fault and self.at_rest and not self._held:
            self.state = State.WAITING  # resumed: the next tick begins at the measured joints
        return self._fault and self.at_rest

    # ---- what messages say ---------------------------------------------------------------------

    def _usable(self, what: str, frame: str, age: float) -> bool:
        """Test whether a message can be used: in the base frame, not late, and while RUNNING.

        ``what`` is its name in texts, such as "target", ``frame`` the name of its frame, and
        ``age`` the age of its stamp, s. A message that is late or in another frame also stops the
        arm.
        """
        if frame not in ("", self.base):
            self._refuse(f"{what} refused: it is in frame {shown(frame)}, not in {self.base!r}")
        elif not abs(age) <= self.timeout:
            self._refuse(f"{what} refused: its stamp is {clock_difference(age)}")
        elif self.state is State.RUNNING:
            self.reason = ""
            return True
        return False

    def _refuse(self, reason: str) -> None:
        """Drop the target and store the reason; the arm stops until the next valid message."""
        self._forget()
        if self.state is State.RUNNING:
            self.reason = reason

    def _stop(self, reason: str) -> None:
        """Brake to rest and hold, for the given reason, until :meth:`resume` is called."""
        self._forget()
        self._held = reason
        if self.state is not State.WAITING:
            self.state, self.reason = State.HOLDING, reason

    def _forget(self) -> None:
        """Drop the target, the twist, the level and the elbow's point, so that the arm stops."""
        self._replace()
        self._asked = None
        self._elbow.drop()

    def _replace(self) -> None:
        """Drop the target and the twist, and release the clutch.

        This comes before a new target or twist is stored. The level and the elbow's point are kept.
        """
        self._target, self._twist, self._heard = None, None, 0.0
        self._hand, self._joined = None, False
        self._coupled = False
        self._clutch.release()


def _levels_of(design: Design | CellDesign) -> Callable[[pin.SE3, Array], ElbowLevel]:
    """Return the function (pose x, point p_e) → level whose elbow is nearest to the point.

    The point p_e (3,) is in the base frame, m. The function searches along the self-motion at x. If
    the design is that of a cell's function F, the search begins at F(x). Otherwise, it begins at
    the configuration with the pose x on the leaf through the centre of Ω. So the level depends on x
    and p_e alone.
    """
    if isinstance(design, CellDesign):
        F = design.function
        return lambda x, point: F.leaf_toward(x, elbow=point, margin=_ROOM)
    inverse, home = design.inverse, np.array(design.region.center)
    return lambda x, point: inverse.leaf_toward(inverse.solve(x, home), elbow=point, margin=_ROOM)
