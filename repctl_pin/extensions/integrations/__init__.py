"""Integrations with other packages: JAX, LeRobot, pink, and ROS 2 with MoveIt.

Each module imports its package, which is not required otherwise. A servo, which the ROS 2 node
uses, can be used without ROS.
"""

from ...base.plugins import Extension

EXTENSION = Extension(__name__, commands={"ros2": "ros2_command"})
