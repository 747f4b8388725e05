"""ROS 2 node of an arm: target poses or twists in, joint commands out.

The commands stay within the limits, and on one leaf, the set h(q) = c of the design's potentials.
The level c is the position of the elbow along the self-motion. A cell is a box of poses over which
a function F gives one configuration per pose. In teleoperation, a tracker measures the hand and the
elbow of the operator, and the arm follows them while a clutch is engaged. This module converts
messages; :mod:`.servo` processes them. Letters: n joints, r potentials. A dict ``given`` has the
node's parameters by name.

``Servo`` is a control loop without ROS: it turns targets and joint states into joint commands, tick
by tick.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import PointStamped, PoseStamped, TwistStamped
from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, qos_profile_sensor_data
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool, Trigger
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from ...base.arguments import Array
from ...base.errors import InputError, unknown
from ...design.design_result import Design
from ...model.bodies import Bodies, bodies_of
from ...motion.limits import Limits
from ..cells.cell_design_result import CellDesign
from ..cells.function import InverseFunction
from ..runtime.clutch import Clutch
from .position_ik import answer
from .servo import Servo, State
from .servo_inputs import placement_of

_ANY = ParameterDescriptor(dynamic_typing=True)
_STATUS_PERIOD = 0.1
_LEVELS = {
    State.WAITING: DiagnosticStatus.STALE,
    State.RUNNING: DiagnosticStatus.OK,
    State.HOLDING: DiagnosticStatus.WARN,
}
_OUTPUTS = ("trajectory", "positions")
_DEFAULTS = {
    "acceleration": None,
    "jerk": None,
    "rate": 100.0,
    "joints": None,
    "leaf": None,
    "output": "trajectory",
    "timeout": 0.1,
    "tolerance": 0.2,
    "surroundings": None,
    "body_distance": None,
    "unchecked": "refuse",
    "tool": None,
    "hand_scale": 1.0,
    "hand_axes": None,
}
"""Parameters, with their defaults."""

_NO_DIGITS = str.maketrans("", "", "0123456789.")
"""Translation of a message to the text that is compared for a change: ages change all the time."""


class _ArmNode(Node):
    """Node ``repctl``: connects the topics, services and parameters of ROS 2 to a :class:`Servo`.

    Subscribes to ``target_pose``, ``target_twist``, ``hand_pose``, ``hand_elbow``, ``~/elbow``,
    ``~/leaf`` and ``joint_states``; publishes ``/diagnostics`` and ``joint_trajectory``. With the
    parameter ``output:=positions``, ``commands`` replaces ``joint_trajectory``. Services:
    ``~/hold``, ``~/resume``, ``~/clutch`` and, for a cell where moveit_msgs is installed,
    ``compute_ik``. The parameter ``leaf`` can be set at any time; all other parameters are read
    once.

    ``hand_pose`` and ``hand_elbow`` are the pose of the operator's hand and the point of the
    operator's elbow, in the tracker's frame. These messages move the arm's target and elbow from
    the time at which ``~/clutch`` engages the clutch (True) until it releases the clutch (False).
    ``~/elbow`` is a point for the arm's elbow, in the base frame, and ``~/leaf`` is a level c.

    Commands and time-outs follow a steady clock, which is never set, or with ``use_sim_time`` the
    clock of the simulation. Stamps are compared with the node's ROS clock.

    Parameters
    ----------
    design
        Design of a repeatable inverse, or of a cell's function.

    Raises
    ------
    InputError
        If a parameter is missing, unknown or invalid.
    """

    def __init__(self, design: Design | CellDesign) -> None:
        super().__init__("repctl")
        given = self._declared()
        simulated = self.get_parameter("use_sim_time").value
        self._tick_clock = (
            self.get_clock() if simulated else Clock(clock_type=ClockType.STEADY_TIME)
        )
        self.servo = Servo(
            design,
            given["rate"],
            Limits(acceleration=given["acceleration"], jerk=given["jerk"]),
            timeout=given["timeout"],
            tolerance=given["tolerance"],
            tool=None if given["tool"] is None else placement_of(given["tool"], "tool"),
            clutch=Clutch(scale=given["hand_scale"], axes=_hand_axes(given)),
            **_bodies(design, given),
        )
        self._names = self._joint_names(given["joints"])
        self._output = given["output"]
        if self._output not in _OUTPUTS:
            raise InputError(
                f"parameter output: {self._output!r} is none of {', '.join(_OUTPUTS)}",
                remedy="choose one of them",
            )
        self._connect()
        if isinstance(design, CellDesign):
            self._offer_ik(design.function)
        if refused := self._set_leaf(given["leaf"]):
            raise InputError(f"parameter leaf: {refused}")
        self.add_on_set_parameters_callback(self._on_set)

    def _connect(self) -> None:
        """Create publishers, subscriptions, services and timers, as set by the parameters."""
        newest = QoSProfile(depth=1)
        if self._output == "trajectory":
            self._commands = self.create_publisher(JointTrajectory, "joint_trajectory", newest)
        else:
            self._commands = self.create_publisher(Float64MultiArray, "commands", newest)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self.create_subscription(PoseStamped, "target_pose", self._on_pose, newest)
        self.create_subscription(TwistStamped, "target_twist", self._on_twist, newest)
        self.create_subscription(PoseStamped, "hand_pose", self._on_hand, newest)
        self.create_subscription(PointStamped, "hand_elbow", self._on_hand_elbow, newest)
        self.create_subscription(PointStamped, "~/elbow", self._on_elbow, newest)
        self.create_subscription(Float64MultiArray, "~/leaf", self._on_leaf, newest)
        states = qos_profile_sensor_data
        self.create_subscription(JointState, "joint_states", self._on_joints, states)
        self.create_service(Trigger, "~/hold", self._on_hold)
        self.create_service(Trigger, "~/resume", self._on_resume)
        self.create_service(SetBool, "~/clutch", self._on_clutch)
        self.create_timer(self.servo.dt, self._on_tick, clock=self._tick_clock)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(_STATUS_PERIOD, self.publish_status, clock=steady)
        self._said = ""

    def _offer_ik(self, F: InverseFunction) -> None:
        """Create the service ``compute_ik``, MoveIt's GetPositionIK, answered by the function F.

        MoveIt then gets one configuration per pose. Without moveit_msgs, the service is not
        created.
        """
        try:
            from moveit_msgs.srv import GetPositionIK
        except ImportError:
            return

        def on_request(request: Any, response: Any) -> Any:
            leaf, base = self.servo.current_leaf, self.servo.base
            asked = request.ik_request
            return answer(
                F, asked, response, names=self._names, base=base, leaf=leaf, tool=self.servo.tool
            )

        self.create_service(GetPositionIK, "compute_ik", on_request)
        if lacks := bodies_of(F.task).not_checked:
            self.get_logger().warning(f"compute_ik: collisions are not checked: {lacks}")

    # ---- parameters ----------------------------------------------------------------------------

    def _declared(self) -> dict[str, Any]:
        """Declare all parameters and return their values by name; arrays become lists.

        InputError is raised for a parameter that the node does not have, such as a misspelt one.
        """
        every = [(name, value, _ANY) for name, value in _DEFAULTS.items()]
        values = {p.name: p.value for p in self.declare_parameters("", every)}
        for name in self._parameter_overrides:
            if not self.has_parameter(name):
                raise unknown("parameter", name, _DEFAULTS)
        return {
            name: list(value) if hasattr(value, "__len__") and not isinstance(value, str) else value
            for name, value in values.items()
        }

    def _joint_names(self, given: list[str] | None) -> dict[str, str]:
        """Map the joint names that messages use to those of the design, in the design's order.

        ``given`` is the parameter ``joints``, or None for equal names. InputError is raised unless
        ``given`` has one name per joint.
        """
        own = self.servo.task.joint_names
        given = list(own) if given is None else given
        if len(given) != len(own) or len(set(given)) != len(own):
            raise InputError(
                f"the parameter 'joints' must have {len(own)} different names: those that "
                f"{', '.join(own)} have in the messages, in this order"
            )
        return dict(zip(given, own, strict=True))

    def _on_set(self, parameters: Sequence[Parameter]) -> SetParametersResult:
        """Set the parameter ``leaf``, the level c; refuse other parameters, which are read once.

        ROS calls this for a change of parameters; the result says whether it is accepted.
        """
        for parameter in parameters:
            what = f"{parameter.name} is read only when the node starts; restart the node"
            if parameter.name == "leaf":
                what = self._set_leaf(parameter.value)
            if what:
                return SetParametersResult(successful=False, reason=what)
        return SetParametersResult(successful=True)

    def _set_leaf(self, value: Any) -> str:
        """Pass a level c, which moves the elbow along the self-motion, to the servo.

        ``value`` is a number, a list of r numbers, or None for no change. Return the reason if the
        level is refused, else an empty text.
        """
        if value is None:
            return ""
        try:
            return self.servo.leaf(value)
        except (TypeError, ValueError):
            return "parameter leaf must be numbers"

    # ---- messages ------------------------------------------------------------------------------

    def _now(self) -> float:
        """Time of ticks and time-outs, s, by a clock that is never set, or by the simulation."""
        return float(self._tick_clock.now().nanoseconds * 1e-9)

    def _age(self, stamp: Any) -> float:
        """Compute the age of a message's time stamp, s; 0 if it has no stamp."""
        seconds = stamp.sec + 1e-9 * stamp.nanosec
        now = self.get_clock().now().nanoseconds * 1e-9
        return float(now - seconds) if seconds else 0.0

    def _on_pose(self, message: PoseStamped) -> None:
        frame, age = message.header.frame_id, self._age(message.header.stamp)
        self.servo.pose(*_numbers_of(message), frame=frame, age=age)

    def _on_twist(self, message: TwistStamped) -> None:
        v, w = message.twist.linear, message.twist.angular
        frame = message.header.frame_id
        age = self._age(message.header.stamp)
        self.servo.twist((v.x, v.y, v.z, w.x, w.y, w.z), self._now(), frame=frame, age=age)

    def _on_hand(self, message: PoseStamped) -> None:
        age = self._age(message.header.stamp)
        self.servo.hand(*_numbers_of(message), self._now(), age=age)

    def _on_hand_elbow(self, message: PointStamped) -> None:
        p, age = message.point, self._age(message.header.stamp)
        self.servo.hand_elbow((p.x, p.y, p.z), age=age)

    def _on_elbow(self, message: PointStamped) -> None:
        p, frame = message.point, message.header.frame_id
        self.servo.elbow((p.x, p.y, p.z), frame=frame, age=self._age(message.header.stamp))

    def _on_leaf(self, message: Float64MultiArray) -> None:
        self.servo.level(message.data)

    def _on_joints(self, message: JointState) -> None:
        pairs = zip(message.name, message.position, strict=False)
        known = {self._names[name]: q for name, q in pairs if name in self._names}
        self.servo.joints(known, self._now(), age=self._age(message.header.stamp))

    def _on_hold(self, _: Any, response: Any) -> Any:
        self.servo.hold()
        return self._answered(response)

    def _on_resume(self, _: Any, response: Any) -> Any:
        self.servo.resume()
        return self._answered(response)

    def _on_clutch(self, request: Any, response: Any) -> Any:
        self.servo.couple(bool(request.data))
        return self._answered(response)

    def _answered(self, response: Any) -> Any:
        """Fill in and return a service's response: success, and the servo's state as text.

        Success is always True.
        """
        response.success = True
        response.message = self.servo.said
        return response

    # ---- commands and status -------------------------------------------------------------------

    def _on_tick(self) -> None:
        q = self.servo.tick(self._now())
        if q is not None:
            self._publish(q)

    def _publish(self, q: Array) -> None:
        """Publish a commanded configuration (n,), which the arm is to reach at the next tick."""
        if self._output == "positions":
            self._commands.publish(Float64MultiArray(data=q.tolist()))
            return
        # no velocities: trajectory controllers refuse a last point that is not at rest
        due = Duration(seconds=self.servo.dt).to_msg()
        point = JointTrajectoryPoint(positions=q.tolist(), time_from_start=due)
        self._commands.publish(JointTrajectory(joint_names=list(self._names), points=[point]))

    def publish_status(self) -> None:
        """Publish the servo's state on ``/diagnostics``, and log it when it changes."""
        servo = self.servo
        said = servo.said
        level = _LEVELS[servo.state]
        if servo.state is State.RUNNING and (servo.reason or servo.stopped_early):
            level = DiagnosticStatus.WARN
        leaf = servo.current_leaf
        values = {"state": servo.state.value, "governor": servo.status.name}
        values["leaf"] = "" if leaf is None else " ".join(f"{c:.9g}" for c in leaf)
        values["elbow"] = servo.elbow_said
        status = DiagnosticStatus(level=level, name="repctl: arm", message=said)
        status.hardware_id = servo.task.robot.name
        status.values = [KeyValue(key=key, value=value) for key, value in values.items()]
        message = DiagnosticArray(status=[status])
        message.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(message)
        if (brief := said.translate(_NO_DIGITS)) != self._said:
            self._said = brief
            self.get_logger().info(said)

    def stop(self) -> None:
        """Brake to rest: publish a command per tick until the arm is at rest."""
        while (q := self.servo.brake()) is not None:
            self._publish(q)
            time.sleep(self.servo.dt)


def _numbers_of(message: PoseStamped) -> tuple[Sequence[float], Sequence[float]]:
    """Return the position (x, y, z) and the quaternion (x, y, z, w) of a pose."""
    p, x = message.pose.position, message.pose.orientation
    return (p.x, p.y, p.z), (x.x, x.y, x.z, x.w)


def _bodies(design: Design | CellDesign, given: dict[str, Any]) -> dict[str, Any]:
    """Return the arguments ``bodies``, ``body_distance`` and ``unchecked`` of :class:`Servo`.

    The dictionary is empty unless the parameter ``surroundings``, a URDF, or ``body_distance``, m,
    is set. ``body_distance`` is left out if it is not set. Links without a body are refused, unless
    the parameter ``unchecked`` is ``allow``.
    """
    around, distance = given["surroundings"], given["body_distance"]
    if around is None and distance is None:
        return {}
    bodies = Bodies(design.task, surroundings=around)
    kept = {} if distance is None else {"body_distance": distance}
    return {"bodies": bodies, "unchecked": given["unchecked"], **kept}


def _hand_axes(given: dict[str, Any]) -> Array | None:
    """Read the rotation (3, 3) from the axes of the operator's tracker to those of the base.

    The rotation is the parameter ``hand_axes``, a quaternion x, y, z, w. Return None without this
    parameter: the axes are then parallel.
    """
    if given["hand_axes"] is None:
        return None
    return placement_of([0.0, 0.0, 0.0, *given["hand_axes"]], "hand_axes").rotation


def spin(design: Design | CellDesign, arguments: Sequence[str], stop: threading.Event) -> None:
    """Run the node until an event is set, then brake to rest and return.

    Parameters
    ----------
    design
        Design of a repeatable inverse, or of a cell's function.
    arguments
        Arguments of ROS, such as ``["--ros-args", "-p", "acceleration:=5.0"]``.
    stop
        Event that stops the node; no signal handlers are installed.
    """
    try:
        rclpy.init(args=list(arguments), signal_handler_options=SignalHandlerOptions.NO)
    except Exception as error:  # rclpy has no common class of its errors
        what = " ".join(str(error).split())
        raise InputError(f"ROS 2 did not start: {what}") from None
    try:
        node = _ArmNode(design)
        try:
            executor = SingleThreadedExecutor()
            executor.add_node(node)
            while not stop.is_set():
                executor.spin_once(timeout_sec=0.1)
            node.stop()
        finally:
            node.destroy_node()
    finally:
        rclpy.try_shutdown()


__all__ = ["_ArmNode", "spin"]
