"""Command line ``repctl``: parse the options, call the library, print the result.

Each subcommand has its own module, which imports most of what it needs only when it runs.
"""

from __future__ import annotations

import argparse
import gc
import io
import os
import re
import shlex
import sys
import warnings
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from typing import Any

from .._version import __version__
from ..base.errors import RepctlError
from ..base.plugins import all_extensions
from ..base.threads import BLAS_THREADS
from ..show.text.coloured_text import capital
from . import animate, check, design, follow, inspect, robots, study
from .exit_codes import exit_code
from .options import Parser
from .parsed_options import is_saved
from .terminal import say_line

_AS_WRITTEN: dict[str, Any] = {
    "formatter_class": argparse.RawDescriptionHelpFormatter,
    "allow_abbrev": False,
}
_FIRST = (study, design, follow, check, animate)
_LAST = (robots, inspect)

_EXAMPLES = """examples:
  repctl study panda                            table, figures and animation
  repctl study my_arm.urdf --frame tool0        the same for your own arm
  repctl audit joints.csv --robot my_arm.urdf   does the arm drift?
  repctl follow design.json --csv motion.csv    one cycle, ready for a robot

repctl COMMAND --help lists the options of a command.
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code.

    The code is 0 for success, 1 for an internal error, 2 for invalid input, and 3 if a proof
    requested by ``--prove`` was not reached. If a signal ended the command, it is 128 plus the
    number of the signal. ``argv`` are the arguments of the command line; by default those of the
    process.
    """
    if argv is None:  # our own process: matrices of 7 joints are faster on one thread
        for variable in BLAS_THREADS:
            os.environ.setdefault(variable, "1")
        gc.set_threshold(500_000)  # imports make many objects, and none of them is garbage
        os.environ["MPLBACKEND"] = "agg"  # no window is opened, whatever the user's settings
        # warnings of libraries are for programmers
        warnings.simplefilter("ignore", Warning if not sys.warnoptions else DeprecationWarning)
        warnings.filterwarnings("once", "no native library", UserWarning)
        warnings.showwarning = lambda said, *_: say_line(f"repctl: warning: {said}")
        for stream in (sys.stdout, sys.stderr):  # None where it is closed
            if isinstance(stream, io.TextIOWrapper):
                stream.reconfigure(errors="replace")  # a terminal that cannot show ⁺ gets a ?
    arguments = _join_values(_as_options(list(sys.argv[1:] if argv is None else argv)))
    if not arguments:
        parser().print_help(sys.stderr)
        return 2

    def run() -> int:
        options = parser().parse_all(arguments)
        options.command_line = shlex.join(["repctl", *arguments])
        if argv is None:
            import logging  # --help has no need of it

            logging.getLogger("matplotlib").setLevel(logging.ERROR)
        with ExitStack() as options.ending:
            try:
                return options.run(options)
            except RepctlError as error:  # the library names arguments, the command its options
                error.argument = options.option_names.get(error.argument, error.argument)
                raise

    code = exit_code(
        run, [word for word in arguments if word != "--debug"], debug="--debug" in arguments
    )
    if argv is None:
        gc.freeze()  # else Python searches all objects for garbage before it exits
    return code


def parser() -> Parser:
    """Make the parser of all commands, including those of the package's extensions.

    Each command is a subparser, whose default ``run`` is the function that carries it out.
    """
    about = "Repeatable control for redundant robot arms."
    whole = Parser(prog="repctl", description=about, epilog=_EXAMPLES, **_AS_WRITTEN)
    whole.add_argument(
        "--debug",
        action="store_true",
        help="show the traceback of an internal error; give it before COMMAND",
    )
    whole.add_argument("--version", action="version", version=f"repctl {__version__}")
    parts = whole.add_subparsers(metavar="COMMAND", required=True)
    for name, command in commands():
        part = parts.add_parser(
            name,
            help=re.split("[,:]", command.HELP)[0],
            description=f"{capital(command.HELP)}.",
            epilog=command.EXAMPLE,
            **_AS_WRITTEN,
        )
        command.add_options(part)
        part.shorten_usage()
        part.set_defaults(run=command.run, parser=part, quiet=False)
    return whole


def commands() -> Iterator[tuple[str, Any]]:
    """Yield the commands, each as a name and a module, in the order of the help.

    The module has the texts ``HELP`` and ``EXAMPLE``, and the functions ``add_options(parser)`` and
    ``run(options)``. Commands of extensions come after the main commands and before ``robots`` and
    ``inspect``.
    """
    yield from ((command.__name__.rpartition(".")[2], command) for command in _FIRST)
    for extension in all_extensions():
        for name, module in extension.commands.items():
            yield name, extension.module(module)
    yield from ((command.__name__.rpartition(".")[2], command) for command in _LAST)


def _as_options(arguments: list[str]) -> list[str]:
    """Rewrite ``help COMMAND`` as ``COMMAND --help``, and ``version`` as ``--version``.

    ``arguments`` are the words of the command line, without the program's name.
    """
    first, rest = arguments[:1], arguments[1:]
    if first == ["help"]:
        return [*rest, "--help"]
    return ["--version", *rest] if first == ["version"] else arguments


_SIGNED = ("--start", "--at", "--heights", "--rpy", "--axis", "--approach")
"""Options whose values may begin with a minus sign."""


def _join_values(arguments: list[str]) -> list[str]:
    """Rewrite two forms of arguments that argparse would misread; return the arguments to parse.

    ``--start -0.1,0.2`` becomes one word with ``=``, because the value looks like an option; the
    same holds for ``--approach -x`` and others. ``--best-leaf`` before a saved design becomes
    ``--best-leaf=limits``, because argparse would take the design as the option's value.
    """
    joined: list[str] = []
    for argument in arguments:
        if (
            joined
            and joined[-1] in _SIGNED
            and argument[:1] == "-"
            and argument[1:2] in "0123456789.xyz"
        ):
            joined[-1] += f"={argument}"
        elif joined and joined[-1] == "--best-leaf" and is_saved(argument):
            joined[-1:] = ["--best-leaf=limits", argument]
        else:
            joined.append(argument)
    return joined
