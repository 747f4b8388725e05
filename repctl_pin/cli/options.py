"""Options that several commands share, and a parser whose errors take one line."""

from __future__ import annotations

import argparse
from typing import Any, NoReturn

from ..base.errors import printable, unknown
from ..show.text.coloured_text import fitted, terminal_width
from .parsed_options import Options, positive

KINDS = "pose, axis, position, xy, xz or yz"
"""Kinds of task, for the help of ``--task``; ``model/kind.py`` takes too long to import."""

_GROUPS = {
    "cell": "half-width half-angle at sector radius height angle spin axis",
    "robot": "robot package-dir lock base surroundings frame task start",
    "path": "path plane through blend cycles steps period acceleration jerk tool-speed keep-times "
    "rate",
    "design": "strategy potentials region shrink keep degree fourier basis weight best-leaf "
    "limit-margin body-distance sigma-min samples held-out seed prove leaf",
    "output": "out csv yaml profile allow-violations report full json quiet",
}
"""Groups of options, in the order of the help; other options come first."""


_WINDOWS = ("gui", "open", "show", "view", "viewer")
_WINDOW = "`repctl study ROBOT` writes a page for the browser, animation.html"
"""Commands that would open a window, and the answer to them."""


class _Base(argparse.Action):
    """Action that stores the base link, given by --base or --on; both together are refused."""

    def __call__(
        self, parser: argparse.ArgumentParser, namespace: Any, value: Any, option: str | None = None
    ) -> None:
        if getattr(namespace, self.dest) is not None:
            parser.error("--base and --on are mutually exclusive; give one of them, once")
        setattr(namespace, self.dest, value)


class _Frames(argparse.Action):
    """Action that stores the frames of --frame; those of a repeated option are joined: ``a,b``."""

    def __call__(
        self, parser: argparse.ArgumentParser, namespace: Any, value: Any, option: str | None = None
    ) -> None:
        before = getattr(namespace, self.dest)
        setattr(namespace, self.dest, value if before is None else f"{before},{value}")


class Parser(argparse.ArgumentParser):
    """Parser of a command: errors are one line that suggests the closest valid names and --help.

    The parser also groups the options in the help, and has a method for each set of options that
    several commands share.
    """

    def format_help(self) -> str:
        """Format the help, and wrap the description and the examples, which argparse does not."""
        return fitted(super().format_help())

    def _get_formatter(self) -> argparse.HelpFormatter:
        """Make argparse's formatter for the width to which the rest of the help is wrapped."""
        return argparse.RawDescriptionHelpFormatter(self.prog, width=terminal_width() - 2)

    def error(self, message: str) -> NoReturn:
        """Print the error in one line on stderr, and exit with code 2.

        argparse would also print the usage, which takes many lines.
        """
        self.exit(2, printable(f"{self.prog}: {message} (see {self.prog} --help)") + "\n")

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is not None and value not in action.choices:
            kind = (
                "command"
                if isinstance(action, argparse._SubParsersAction)
                else action.dest.replace("_", " ")
            )
            if kind == "command" and value in _WINDOWS:
                raise argparse.ArgumentError(None, f"no command {value!r}; {_WINDOW}")
            raise argparse.ArgumentError(None, str(unknown(kind, value, action.choices)))

    def parse_all(self, arguments: list[str]) -> Options:
        """Parse the arguments of the command line.

        For an unknown option or argument, the parser of the subcommand prints the error, which
        suggests its most similar option; the process then ends with exit code 2.
        """
        options, rest = self.parse_known_args(arguments, Options())
        chosen: Parser = vars(options).pop("parser")
        if rest:
            word = next((w for w in rest if w.startswith("-")), rest[0]).partition("=")[0]
            known = list(chosen._option_of().values())
            chosen.error(
                str(unknown("option", word, known))
                if word.startswith("-")
                else f"unexpected argument {word!r}"
            )
        options.option_names = chosen._option_of()
        return options

    def _option_of(self) -> dict[str, str]:
        """Map argument names of the library to the options of this command: ``kind`` to ``--task``.

        Errors of the library name an argument, which the user of a command does not know.
        """
        names = {
            action.dest: option
            for action in self._actions
            for option in action.option_strings
            if option.startswith("--")
        }
        others = {"package_dirs": "package_dir", "kind": "task", "posture": "start"}
        return {name: names[dest] for name, dest in others.items() if dest in names} | names

    def add_argument(self, *names: Any, **how: Any) -> argparse.Action:
        """Add an argument as argparse does, and put an option into its group of the help.

        The groups, such as ``robot`` and ``path``, make a long help readable. The parameters of
        this method are argparse's.
        """
        option = str(names[0]).removeprefix("--") if names else ""
        title = next((g for g, own in _GROUPS.items() if option in own.split()), None)
        if title is None or not str(names[0]).startswith("--"):
            return super().add_argument(*names, **how)
        known = {group.title: group for group in self._action_groups}
        group = known.get(title) or self.add_argument_group(title)
        return group.add_argument(*names, **how)

    def shorten_usage(self) -> None:
        """Write only the positional arguments into the usage line, and order the groups of options.

        All options together would fill half of a terminal; the groups below list them.
        """
        arguments = [action for action in self._actions if not action.option_strings]
        names = [
            f"[{action.metavar}]" if action.nargs in ("?", "*") else action.metavar
            for action in arguments
        ]
        words = [str(name or "") for name in names]
        self.usage = " ".join([self.prog, *filter(None, words), "[options]"])
        order = [*_GROUPS]
        self._action_groups.sort(
            key=lambda group: order.index(group.title) if group.title in order else -1
        )

    def robot(self) -> None:
        """Add the argument ROBOT, a catalogue name or URDF, and the options for loading it.

        A command that also takes a saved design calls :meth:`what` instead.
        """
        self.add_argument(
            "robot", metavar="ROBOT", help="catalogue name (see `repctl robots`) or path to a URDF"
        )
        self.loading()

    def what(
        self,
        what: str = (
            "a robot (catalogue name or URDF), or a saved design (.json), which has its own frame "
            "and task"
        ),
    ) -> None:
        """Add the argument WHAT, a robot or a saved design, and the options for loading it.

        ``what`` is the help text of this argument. ``--robot`` names the robot that a saved design
        was made for, if that robot is not in the catalogue.
        """
        self.add_argument("what", metavar="WHAT", help=what)
        self.add_argument(
            "--robot",
            metavar="ROBOT",
            help="robot of a saved design, if the catalogue does not have it",
        )
        self.loading()

    def loading(self) -> None:
        """Add the options for loading a robot: --package-dir, --lock, and --base or --on."""
        add = self.add_argument
        add(
            "--package-dir",
            action="append",
            default=[],
            metavar="DIR",
            help="folder of ROS packages, or NAME=DIR for one package",
        )
        add(
            "--lock",
            action="append",
            default=[],
            metavar="JOINT",
            help="hold a joint at the reference pose",
        )
        base = "link to which poses are relative; --on LINK: workpiece"
        add("--base", metavar="LINK", action=_Base, help=base)
        add("--on", dest="base", metavar="LINK", action=_Base, help=argparse.SUPPRESS)

    def surroundings(self) -> None:
        """Add --surroundings, a URDF of the robot's surroundings."""
        what = "URDF of the surroundings, relative to the robot's root"
        self.add_argument("--surroundings", metavar="FILE", help=what)

    def task(self) -> None:
        """Add the options of the task and the start: --frame, --task and --start."""
        kinds = f"{KINDS} (default: the first that leaves redundancy)"
        add = self.add_argument
        add("--frame", action=_Frames, help="link to move, or several: a,b (default: arm's end)")
        add("--task", metavar="KIND", help=kinds)
        add("--start", metavar="Q", help="joint positions q1,q2,…, rad or m")

    def path(self, lead: str = "", default: str = " (default: a circle that fits)") -> None:
        """Add --path, whose help begins with ``lead`` and ends with ``default``, and --plane.

        ``lead`` says what the command does with the path, and ``default`` what it does without one.
        """
        add = self.add_argument
        where = "below" if self.prog == "repctl study" else "`repctl study --help`"
        shapes = f"closed path, see {where}"
        add("--path", metavar="PATH", help=lead + shapes + default)
        add("--plane", metavar="PLANE", help="xy, yz or xz (default: the first that fits)")

    def limits(self) -> None:
        """Add the options of a motion's limits: --acceleration, --jerk and --tool-speed."""
        add = self.add_argument
        accelerations = "rad/s² (m/s²), one number, one per joint, panda, fr3, ur, or urdf"
        add(
            "--acceleration",
            metavar="A",
            help=f"go from rest to rest within these limits: {accelerations}",
        )
        jerks = "rad/s³ (m/s³), one number, one per joint, or panda, fr3"
        add("--jerk", metavar="J", help=f"limit jerk too, in {jerks}; requires --acceleration")
        speeds = "maximum speed of the frame: m/s, or m/s,rad/s to limit its rotation, too"
        add("--tool-speed", metavar="V", help=f"{speeds}; requires --acceleration")

    def levels(self, default: str = "") -> None:
        """Add --leaf: by how much levels may change along the closed paths that a proof covers.

        Levels are the values h(q) of the potentials that a repeatable controller holds constant.
        ``default`` is the text that ends the help of the option.
        """
        what = "also prove closed paths along which the levels h(q) change by up to C"
        self.add_argument("--leaf", type=positive, metavar="C", help=what + default)

    def weight(self) -> None:
        """Add --weight, the joint weights that select the inverse to check or to approximate."""
        what = "joint weights: inertia, limits, absolute, w1,w2,…"
        self.add_argument("--weight", metavar="M", help=what)

    def json(self, instead: str = "text", *, quiet: bool = False) -> None:
        """Add --json and, if ``quiet``, --quiet; ``instead`` names the output replaced by JSON."""
        add = self.add_argument
        add("--json", action="store_true", help=f"print JSON instead of {instead}")
        if quiet:
            only = "print only errors, and the JSON of --json"
            add("--quiet", action="store_true", help=only)
