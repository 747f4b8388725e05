"""A simulated arm, the node under test and a driver, each a process, on the loopback interface."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import rclpy
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PointStamped, PoseStamped, TwistStamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool, Trigger
from trajectory_msgs.msg import JointTrajectory

ARM = Path(__file__).with_name("ros2_arm.py")


class Stage:
    """Runs the three; use it as a context manager.

    Attributes
    ----------
    commands : list of (float, array)
        Every command of the node with the time of its arrival, s.
    said : list of str
        Messages of its status, as they change.
    """

    def __init__(
        self,
        folder: Path,
        design: Path,
        q: np.ndarray,
        names: tuple[str, ...],
        age: float | None = 0.0,
    ) -> None:
        self.folder, self.design = folder, design
        self.commands: list[tuple[float, np.ndarray]] = []
        self.said: list[str] = []
        self._processes: list[subprocess.Popen] = []
        rclpy.init()
        self._node = node = rclpy.create_node("driver")
        newest = QoSProfile(depth=1)
        self._poses = node.create_publisher(PoseStamped, "target_pose", newest)
        self._hands = node.create_publisher(PoseStamped, "hand_pose", newest)
        self._elbows = {
            topic: node.create_publisher(PointStamped, topic, newest)
            for topic in ("hand_elbow", "repctl/elbow")
        }
        self._levels = node.create_publisher(Float64MultiArray, "repctl/leaf", newest)
        self._twists = node.create_publisher(TwistStamped, "target_twist", newest)
        self._clocks = node.create_publisher(Clock, "/clock", newest)
        every = QoSProfile(depth=1000)
        node.create_subscription(JointTrajectory, "joint_trajectory", self._command, every)
        node.create_subscription(DiagnosticArray, "/diagnostics", self._status, every)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(node)
        self._thread = threading.Thread(target=self._spin, daemon=True)
        self._ends = False
        self._thread.start()
        self.arm = self._run(str(ARM), json.dumps([list(names), list(map(float, q)), age]))

    def _run(self, *words: str) -> subprocess.Popen:
        process = subprocess.Popen([sys.executable, *words], stderr=subprocess.DEVNULL)
        self._processes.append(process)
        return process

    def node(self, *parameters: str, until: str = "running") -> subprocess.Popen:
        """Start the node under test, and wait until its status says so."""
        words = [word for p in parameters for word in ("-p", p)]
        self.said.clear()
        process = self._run("-m", "repctl_pin", "ros2", str(self.design), "--ros-args", *words)
        self.wait_for(until)
        return process

    def wait_for(self, words: str, most: float = 60.0) -> None:
        """Wait until the status says it."""
        until = time.monotonic() + most
        while not any(words in said for said in self.said[-1:]):
            assert time.monotonic() < until, (words, self.said)
            time.sleep(0.01)

    def call(self, service: str) -> str:
        """Call ``hold`` or ``resume``."""
        return self._call(Trigger, service, Trigger.Request())

    def clutch(self, engaged: bool) -> str:
        """Engage or release the clutch."""
        return self._call(SetBool, "clutch", SetBool.Request(data=engaged))

    def _call(self, kind: Any, service: str, request: Any) -> str:
        client = self._node.create_client(kind, f"/repctl/{service}")
        assert client.wait_for_service(10.0)
        future = client.call_async(request)
        until = time.monotonic() + 10
        while not future.done() and time.monotonic() < until:
            time.sleep(0.005)
        return future.result().message

    def pose(self, x: pin.SE3, frame: str = "", age: float = 0.0) -> float:
        """Send a pose; return the time at which it was sent."""
        self._poses.publish(self._stamped(x, frame, age))
        return time.monotonic()

    def hand(self, x: pin.SE3) -> None:
        """Send a pose of the operator's hand."""
        self._hands.publish(self._stamped(x, "tracker", 0.0))

    def elbow(self, point: np.ndarray, topic: str = "repctl/elbow", frame: str = "") -> None:
        """Send a point for the elbow of the arm, or that of the operator."""
        message = PointStamped()
        message.header.frame_id = frame
        message.point.x, message.point.y, message.point.z = map(float, point)
        self._elbows[topic].publish(message)

    def level(self, *c: float) -> None:
        """Send a level."""
        self._levels.publish(Float64MultiArray(data=list(c)))

    def _stamped(self, x: pin.SE3, frame: str, age: float) -> PoseStamped:
        message = PoseStamped()
        message.header.frame_id = frame
        now = self._node.get_clock().now().nanoseconds - round(age * 1e9)
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(now, 10**9)
        p, o = message.pose.position, message.pose.orientation
        p.x, p.y, p.z = map(float, x.translation)
        o.x, o.y, o.z, o.w = map(float, pin.Quaternion(x.rotation).coeffs())
        return message

    def twist(self, v: np.ndarray) -> None:
        """Send a velocity of the frame."""
        message = TwistStamped()
        linear, angular = message.twist.linear, message.twist.angular
        linear.x, linear.y, linear.z = map(float, v[:3])
        angular.x, angular.y, angular.z = map(float, v[3:])
        self._twists.publish(message)

    def clock(self, seconds: float) -> None:
        """Send the time of a simulation."""
        whole = int(seconds)
        nanoseconds = int((seconds - whole) * 1e9)
        self._clocks.publish(Clock(clock=Time(sec=whole, nanosec=nanoseconds)))

    def rests(self) -> bool:
        """Tell whether the last eight commands are the same."""
        last = [q for _, q in self.commands[-8:]]
        return len(last) == 8 and all((q == last[0]).all() for q in last)

    def wait_for_motion(self, most: float = 20.0) -> None:
        """Wait until the arm has moved by 1 mrad from the last command."""
        until, seen = time.monotonic() + most, max(len(self.commands), 1)
        while not any(
            np.abs(q - self.commands[seen - 1][1]).max() > 1e-3 for _, q in self.commands[seen:]
        ):
            assert time.monotonic() < until, "the arm does not move"
            time.sleep(0.005)

    def wait_for_silence(self) -> None:
        """Wait until no command has come for 0.3 s."""
        before = -1
        while before != len(self.commands):
            before = len(self.commands)
            time.sleep(0.3)

    def settle(self, most: float = 20.0) -> np.ndarray:
        """Wait until the commands rest; return the last one."""
        until = time.monotonic() + most
        while time.monotonic() < until:
            time.sleep(0.15)
            if self.rests():
                return self.commands[-1][1]
        raise AssertionError("the commands do not come to rest")

    def subscribe(self, kind: Any, topic: str, heard: Any) -> None:
        """Hear another topic, too."""
        self._node.create_subscription(kind, topic, heard, QoSProfile(depth=1000))

    def _command(self, message: Any) -> None:
        q = np.array(message.points[0].positions)
        self.commands.append((time.monotonic(), q))

    def _status(self, message: Any) -> None:
        said = message.status[0].message
        if self.said[-1:] != [said]:
            self.said.append(said)

    def _spin(self) -> None:
        while not self._ends:
            self._executor.spin_once(timeout_sec=0.05)

    def __enter__(self) -> Stage:
        return self

    def __exit__(self, *_: object) -> None:
        for process in self._processes:
            if process.poll() is None:
                process.send_signal(signal.SIGCONT)
                process.kill()
            process.wait()
        self._ends = True
        self._thread.join()
        self._executor.shutdown()  # else the node may go while a callback runs
        self._node.destroy_node()
        rclpy.try_shutdown()


def on_loopback(patch: Any) -> None:
    """Keep all messages on this machine, in a domain of this process and its children."""
    patch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    patch.setenv("ROS_DOMAIN_ID", str(10 + os.getpid() % 90))
