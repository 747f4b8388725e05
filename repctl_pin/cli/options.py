"""The options that several subcommands share, and the parser that has them; what is wrong gets one
line."""

from __future__ import annotations

import argparse
from typing import Any, NoReturn

from ..errors import printable, unknown
from .given import Options

_PATHS = (
    "circle:RADIUS, turned until the arm can follow it; circle:RADIUS:DEGREES, starting at that angle from the "
    "plane's first axis; square:SIDE, eight:RADIUS, rose:RADIUS, polygon:CORNERS:RADIUS, all in m; or FILE.csv, "
    "one point a line: x,y,z in m in the base's frame, the first point repeated at the end; a header may add "
    "qx,qy,qz,qw and time; append :blend=RADIUS to round corners"
)


class Parser(argparse.ArgumentParser):
    """An argument parser whose complaint is one line: the nearest that can be used, and where the
    others are."""

    def error(self, message: str) -> NoReturn:
        """Say the line and exit with 2."""
        self.exit(2, printable(f"{self.prog}: {message} (see {self.prog} --help)") + "\n")

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is not None and value not in action.choices:
            kind = (
                "command"
                if isinstance(action, argparse._SubParsersAction)
                else action.dest.replace("_", " ")
            )
            raise argparse.ArgumentError(None, str(unknown(kind, value, action.choices)))

    def parse_all(self, arguments: list[str]) -> Options:
        """Parse; what is left over is refused by the command that it was given to."""
        options, rest = self.parse_known_args(arguments, Options())
        chosen: Parser = vars(options).pop("parser")
        if rest:
            word = next((w for w in rest if w.startswith("-")), rest[0]).partition("=")[0]
            known = [
                w for action in chosen._actions for w in action.option_strings if w.startswith("--")
            ]
            chosen.error(
                str(unknown("option", word, known))
                if word.startswith("-")
                else f"{word!r} is one too many"
            )
        return options

    def robot(self) -> None:
        """Add ROBOT and what says how to load it."""
        self.add_argument(
            "robot", metavar="ROBOT", help="catalogue name (see `repctl robots`) or path to a URDF"
        )
        self._loading()

    def what(
        self,
        what: str = "a robot (catalogue name or URDF), or a saved design (.json), which knows its own frame and task",
    ) -> None:
        """Add WHAT, which is a robot or a saved design, and what says how to load it."""
        self.add_argument("what", metavar="WHAT", help=what)
        self.add_argument(
            "--robot", metavar="ROBOT", help="the robot of a design that is not in the catalogue"
        )
        self._loading()

    def _loading(self) -> None:
        add = self.add_argument
        add(
            "--package-dir",
            action="append",
            default=[],
            metavar="DIR",
            help="folder of package:// paths",
        )
        add(
            "--lock",
            action="append",
            default=[],
            metavar="JOINT",
            help="hold a joint at the reference pose",
        )
        hands = "link in which x is measured, taken as fixed: one on the way to the frame, or another hand"
        add("--base", metavar="LINK", help=hands)

    def surroundings(self) -> None:
        """Add the robot's surroundings."""
        what = "URDF of what stands round the robot: all joints fixed, placed in the frame of the robot's root"
        self.add_argument("--surroundings", metavar="FILE", help=what)

    def task(self) -> None:
        """Add what chooses a task and a start."""
        kinds = "pose, axis, position, xy, xz or yz (default: the first redundant of pose, position, xy, xz, yz)"
        self.add_argument("--frame", help="link to move (default: the arm's end)")
        self.add_argument("--task", metavar="KIND", help=kinds)
        self.add_argument(
            "--start", metavar="Q", help="joint positions, rad or m, separated by commas"
        )

    def path(self, lead: str = "", default: str = " (default: a circle that fits)") -> None:
        """Add what says along which path; a command may have words of its own before it, and
        another default."""
        self.add_argument("--path", metavar="PATH", help=lead + _PATHS + default)
        self.add_argument(
            "--plane",
            metavar="PLANE",
            help="of the path: xy, yz or xz (default: the first that fits)",
        )

    def weight(self) -> None:
        """Add what says which inverse is meant, or should be come near to."""
        what = "of the joint speeds: inertia, limits, or one number a joint separated by commas (default: 1, J⁺)"
        self.add_argument("--weight", metavar="M", help=what)
