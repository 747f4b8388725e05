"""Integrations with other packages: JAX, LeRobot, pink, and ROS 2 with MoveIt."""

from ...plugins import Extension

EXTENSION = Extension(
    __name__,
    commands={"ros2": "ros2_command"},
)
