"""``repctl inspect``: what a robot or a URDF holds."""

from __future__ import annotations

import argparse
import json

from .options import load_robot, robot_options
from .terminal import tell

HELP = "say what a robot or a URDF holds: joints, limits, frames, redundancy by task"
EXAMPLE = """examples: repctl inspect my_arm.urdf          the frames at the ends of arms, and where they are
          repctl inspect my_arm.urdf --all    every frame"""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this subcommand."""
    robot_options(parser)
    parser.add_argument("--all", action="store_true", help="list every frame that moves, not only the ends of arms")
    parser.add_argument("--json", action="store_true", help="print JSON instead of text")


def run(options: argparse.Namespace) -> int:
    """Say what a robot holds."""
    from ..show.text.inspection import inspection, inspection_text
    from ..studies.defaults import redundant_kinds

    robot = load_robot(options)
    frames = robot.movable_frames if options.all else robot.end_frames
    found = inspection(robot, {frame: redundant_kinds(robot, frame) for frame in frames})
    if options.json:
        print(json.dumps(found, indent=2, ensure_ascii=False))
    else:
        tell(inspection_text(found))
    return 0
