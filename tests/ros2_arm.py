"""Kinematic arm as a ROS 2 node: it moves to each command at once, and says where it is."""

from __future__ import annotations

import json
import signal
import sys
from typing import Any

import rclpy
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory


def main(names: list[str], start: list[float], age: float | None = 0.0) -> None:
    """Run until SIGTERM.

    Its joint states have stamps that are ``age`` s old; None is for no stamps.
    """
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node, q, ends = rclpy.create_node("arm"), list(start), []
    signal.signal(signal.SIGTERM, lambda *_: ends.append(True))
    states = node.create_publisher(JointState, "joint_states", QoSProfile(depth=1))

    def moved(message: Any) -> None:
        order = [list(message.joint_names).index(name) for name in names]
        q[:] = [message.points[0].positions[i] for i in order]

    def said() -> None:
        # another order than the design's, and a joint that is not its own
        both = [*zip(names, q, strict=True), ("finger", 0.04)][::-1]
        message = JointState(name=[b[0] for b in both], position=[b[1] for b in both])
        if age is not None:
            now = node.get_clock().now() - Duration(seconds=age)
            message.header.stamp = now.to_msg()
        states.publish(message)

    node.create_subscription(JointTrajectory, "joint_trajectory", moved, QoSProfile(depth=100))
    node.create_timer(0.005, said)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    while not ends:
        executor.spin_once(timeout_sec=0.1)
    node.destroy_node()
    rclpy.try_shutdown()


if __name__ == "__main__":
    main(*json.loads(sys.argv[1]))
