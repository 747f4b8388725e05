"""Options that several subcommands share, and the types they take."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import InputError

if TYPE_CHECKING:
    from ..robot.robot import Robot


def robot_options(parser: argparse.ArgumentParser) -> None:
    """Add ROBOT and what says how to load it."""
    parser.add_argument("robot", metavar="ROBOT", help="catalogue name (see `repctl robots`) or path to a URDF")
    parser.add_argument(
        "--package-dir", action="append", default=[], metavar="DIR", help="where package:// is looked up"
    )
    parser.add_argument(
        "--lock", action="append", default=[], metavar="JOINT", help="hold a joint at the reference pose"
    )
    parser.add_argument("--base", metavar="LINK", help="link to hold still; x is measured in its frame")


def task_options(parser: argparse.ArgumentParser) -> None:
    """Add what chooses a task and a start."""
    parser.add_argument("--frame", help="link to move (default: the arm's end)")
    parser.add_argument(
        "--task", metavar="KIND", help="pose, axis, position, xy, xz or yz (default: the first redundant)"
    )
    parser.add_argument("--start", metavar="Q", help="joint positions, rad or m, separated by commas")


def load_robot(options: argparse.Namespace) -> Robot:
    """Load the robot that the options name."""
    from ..robot.robot import Robot

    return Robot.load(options.robot, package_dirs=options.package_dir, lock=options.lock, base=options.base)


def output_folder(options: argparse.Namespace) -> Path:
    """Where the files go: ``--out``, else ``repctl-out/ROBOT``."""
    return Path(options.out or Path("repctl-out") / Path(options.robot).stem)


def start_of(options: argparse.Namespace) -> list[float] | None:
    """Read ``--start``, if it was given."""
    return None if options.start is None else _numbers(options.start)


def _numbers(text: str) -> list[float]:
    try:
        return [float(part) for part in text.replace(" ", ",").split(",") if part]
    except ValueError:
        raise InputError(f"--start {text!r} is not a list of numbers; separate them by commas") from None


def whole(text: str) -> int:
    """Take a whole number from 1 up."""
    value = int(text) if text.strip().lstrip("+-").isdigit() else 0
    if value < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from 1 up")
    return value


def positive(text: str) -> float:
    """Take a number above 0."""
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text!r} is not a number above 0")
    return value
