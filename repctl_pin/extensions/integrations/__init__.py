"""Integrations with other packages: arrays, LeRobot, pink, and ROS 2 with MoveIt.

Each module imports its package, which is not required otherwise. A servo, which the ROS 2 node
uses, can be used without ROS.
"""

from lazy_loader import attach

from ...base.plugins import Extension

EXTENSION = Extension(__name__, commands={"ros2": "ros2_command"})

__getattr__, __dir__, _ = attach(__name__, submodules=["arrays"])
