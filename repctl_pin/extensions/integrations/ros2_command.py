"""``repctl ros2``: run a saved design as a ROS 2 node."""

from __future__ import annotations

import argparse

from ...base.errors import InputError
from ...cli.options import Parser
from ...cli.parsed_options import Options
from ...cli.terminal import until_stopped

HELP = "run a saved design or cell as a ROS 2 node that commands the joints"
EXAMPLE = """examples:
  repctl ros2 control.json --ros-args -p acceleration:=5.0 -r target_pose:=/pose
  repctl ros2 my.json --robot my_arm.urdf --ros-args -p acceleration:=5.0

Topics in: target_pose, target_twist, hand_pose, hand_elbow, ~/elbow, ~/leaf, joint_states. Topics
out: joint_trajectory or commands, /diagnostics. Services: ~/hold, ~/resume, ~/clutch. Ctrl-C
brakes the arm to rest, then ends the node."""


def add_options(parser: Parser) -> None:
    """Add the options of ``repctl ros2`` to its parser."""
    parser.what("a saved design or cell (.json) of repctl design, study or cell")
    parser.set_defaults(frame=None, task=None)
    parser.add_argument(
        "--ros-args",
        nargs=argparse.REMAINDER,
        default=[],
        metavar="...",
        help="last: arguments of ROS, -p NAME:=VALUE for parameters, -r FROM:=TO for topics; "
        "parameters: acceleration (required, rad/s² or m/s²), jerk (rad/s³ or m/s³), rate (Hz), "
        "joints, leaf, output, timeout (s), tolerance (rad or m), surroundings (a URDF), "
        "body_distance (m), tool, hand_scale, hand_axes; docs/how-to/ros2.md explains them",
    )


def run(options: Options) -> int:
    """Run the node until Ctrl-C, then brake the arm to rest; return the exit code."""
    design = options.load_saved()
    try:
        from .ros2 import spin
    except ImportError as error:
        raise InputError(
            f"the node requires ROS 2 ({error})",
            remedy="source its setup.bash, or install repctl_pin with the extra ros2",
        ) from None
    with until_stopped() as stop:
        spin(design, ["--ros-args", *options.ros_args] if options.ros_args else [], stop)
    return 0
