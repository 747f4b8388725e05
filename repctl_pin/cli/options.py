"""Options that several subcommands share, the types they take, and what is made of them."""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InputError

REGION = 0.4
"""Half-width of Ω round a start, rad, where none is given."""

if TYPE_CHECKING:
    from ..design import Design, SingularRegionError
    from ..regions import Box
    from ..robot.robot import Robot
    from ..robot.task import Task
    from ..section import CellDesign

_PATHS = (
    "circle:RADIUS, turned until the arm can follow it; circle:RADIUS:DEGREES, starting at that angle from the "
    "plane's first axis; square:SIDE, eight:RADIUS, rose:RADIUS, polygon:CORNERS:RADIUS, all in m; or FILE.csv, "
    "one point a line: x,y,z in m in the base's frame, the first point repeated at the end; a header may add "
    "qx,qy,qz,qw and time; append :blend=RADIUS to round corners"
)


def robot_options(parser: argparse.ArgumentParser) -> None:
    """Add ROBOT and what says how to load it."""
    parser.add_argument("robot", metavar="ROBOT", help="catalogue name (see `repctl robots`) or path to a URDF")
    _loading_options(parser)


def what_options(
    parser: argparse.ArgumentParser,
    what: str = "a robot (catalogue name or URDF), or a saved design (.json), which knows its own frame and task",
) -> None:
    """Add WHAT, which is a robot or a saved design, and what says how to load it."""
    parser.add_argument("what", metavar="WHAT", help=what)
    parser.add_argument("--robot", metavar="ROBOT", help="the robot of a design that is not in the catalogue")
    _loading_options(parser)


def _loading_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--package-dir",
        action="append",
        default=[],
        metavar="DIR",
        help="folder of package:// paths",
    )
    parser.add_argument(
        "--lock", action="append", default=[], metavar="JOINT", help="hold a joint at the reference pose"
    )
    parser.add_argument(
        "--base",
        metavar="LINK",
        help="link in which x is measured, taken as fixed: one on the way to the frame, or another hand",
    )


def surroundings_option(parser: argparse.ArgumentParser) -> None:
    """Add the robot's surroundings."""
    parser.add_argument(
        "--surroundings",
        metavar="FILE",
        help="URDF of what stands round the robot: all joints fixed, placed in the frame of the robot's root",
    )


def task_options(parser: argparse.ArgumentParser) -> None:
    """Add what chooses a task and a start."""
    parser.add_argument("--frame", help="link to move (default: the arm's end)")
    parser.add_argument(
        "--task",
        metavar="KIND",
        help="pose, axis, position, xy, xz or yz (default: the first redundant of pose, position, xy, xz, yz)",
    )
    parser.add_argument("--start", metavar="Q", help="joint positions, rad or m, separated by commas")


def path_options(
    parser: argparse.ArgumentParser, lead: str = "", default: str = " (default: a circle that fits)"
) -> None:
    """Add what says along which path; a command may have words of its own before it, and another default."""
    parser.add_argument("--path", metavar="PATH", help=lead + _PATHS + default)
    parser.add_argument("--plane", metavar="PLANE", help="of the path: xy, yz or xz (default: the first that fits)")


def weight_option(parser: argparse.ArgumentParser) -> None:
    """Add what says which inverse is meant, or should be come near to."""
    parser.add_argument(
        "--weight",
        metavar="M",
        help="of the joint speeds: inertia, limits, or one number a joint separated by commas (default: 1, J⁺)",
    )


def weight_of(options: argparse.Namespace) -> Any:
    """Read ``--weight``: None, a word, or numbers."""
    if options.weight in (None, "inertia", "limits"):
        return options.weight
    return numbers_of(options.weight, "--weight", "is neither inertia, nor limits, nor numbers separated by commas")


def load_robot(options: argparse.Namespace, name: str | None = None) -> Robot:
    """Load a robot by name, or the one that the options name."""
    from ..robot.robot import Robot

    name = options.robot if name is None else name
    if is_saved(name):
        raise InputError(f"{name} is a saved design: follow, check, animate and export take it; here a robot is wanted")
    around = getattr(options, "surroundings", None)
    return Robot.load(name, package_dirs=options.package_dir, lock=options.lock, base=options.base, surroundings=around)


def robot_of(options: argparse.Namespace) -> Robot:
    """Load the robot that WHAT names."""
    if options.robot is not None:
        raise InputError(f"--robot goes with a saved design; the robot is {options.what}")
    return load_robot(options, options.what)


def save_control(design: Design | CellDesign, file: Path) -> Path:
    """Save a design; where that fails, an older one is not left under the name.

    Raises
    ------
    InputError
        If it cannot be written; the message says where the older one is.
    """
    from ..saving import save

    try:
        return save(design, file)
    except InputError as error:
        if not file.is_file():
            raise
        old = file.with_name(f"{file.stem}.old{file.suffix}")
        file.replace(old)
        raise InputError(f"{error}; what an earlier command wrote there is now {old}") from None


def is_saved(name: str) -> bool:
    """Whether a name is that of a saved design."""
    return Path(name).suffix.lower() == ".json"


@contextmanager
def output_folder(options: argparse.Namespace, name: str) -> Iterator[Path]:
    """Where the files go: ``--out``, else ``repctl-out/NAME``. It can be written; it is not left empty."""
    from ..files import check_folder, not_left_empty

    folder = Path(options.out or Path("repctl-out") / name)
    try:
        check_folder(folder)
    except InputError as error:
        raise InputError(f"{error} (--out)") from None
    with not_left_empty(folder):
        yield folder


def start_of(options: argparse.Namespace, task: Task | None = None) -> Any:
    """Read ``--start``, if it was given; for a task, check it too."""
    if options.start is None:
        return None
    numbers = numbers_of(options.start, "--start", "is not a list of numbers; separate them by commas")
    return numbers if task is None else task.check(numbers, "--start")


def numbers_of(text: str, option: str, otherwise: str) -> list[float]:
    """Read numbers separated by commas."""
    try:
        return [float(part) for part in text.replace(" ", ",").split(",") if part]
    except ValueError:
        raise InputError(f"{option} {text!r} {otherwise}") from None


def asked_path(options: argparse.Namespace) -> Any:
    """Read ``--path`` and ``--plane``: a function (task, q0) → path, or None where neither is given."""
    from ..motion.spec import parse_path

    if options.path is None and options.plane is None:
        return None
    return parse_path(options.path, options.plane)


def box_round(task: Task, q0: Any, half_width: float) -> tuple[Box, list[str]]:
    """Make Ω, a box round the start cut to the joint limits; and a note where it was cut."""
    from ..regions import Box

    box = Box(q0, half_width).inside(task.lower, task.upper)
    cut = [n for n, w in zip(task.joint_names, box.half_width, strict=True) if w < half_width * (1 - 1e-9)]
    return box, [f"Ω was cut at the limits of {', '.join(cut)}"] if cut else []


def said_by_options(error: SingularRegionError, *, shrink: bool = False) -> SingularRegionError:
    """Name the options that help where Ω holds a singularity."""
    from ..studies.defaults import half_width_within

    if error.free is None:
        return error.with_remedy(
            "choose another --start, or a smaller --region: cut at the joint limits, it has another center"
        )
    return error.with_remedy("--shrink takes that" if shrink else f"give --region {half_width_within(error.free)}")


def whole(text: str, least: int = 1) -> int:
    """Take a whole number from 1 up."""
    value = int(text) if re.fullmatch(r"\s*\+?[0-9]{1,15}\s*", text) else least - 1
    if value < least:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from {least} up")
    return value


def natural(text: str) -> int:
    """Take a whole number from 0 up."""
    return whole(text, 0)


def positive(text: str) -> float:
    """Take a number above 0."""
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text!r} is not a number above 0")
    return value
