"""``repctl inspect``: joints, limits, frames and redundancy of a robot or a URDF."""

from __future__ import annotations

from ..show.text.lines import fitted
from .given import Options
from .options import Parser
from .terminal import report

HELP = "list what a robot or a URDF holds: joints, limits, frames and redundancy"
EXAMPLE = """examples:
  repctl inspect my_arm.urdf          the ends of its arms, with positions
  repctl inspect my_arm.urdf --all    every frame"""


def add_options(parser: Parser) -> None:
    """Add the options of this subcommand."""
    parser.robot()
    parser.add_argument(
        "--all",
        action="store_true",
        help="list every frame that moves, not only the ends of arms",
    )
    parser.json()


def run(options: Options) -> int:
    """Inspect a robot and print the result."""
    from ..show.text.inspection import inspection, inspection_text
    from ..studies.task_choice import redundant_kinds

    robot = options.load_robot()
    frames = robot.movable_frames if options.all else robot.end_frames
    found = inspection(
        robot, {frame: redundant_kinds(robot, frame) for frame in frames}
    )
    return report(options, lambda: found, lambda: fitted(inspection_text(found)))
