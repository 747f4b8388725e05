"""``repctl export``: a saved design as C for a robot's own loop."""

from __future__ import annotations

import argparse
import json

from ..errors import InputError
from .options import is_saved, what_options
from .saved import load_design

HELP = "write a saved design as C that a robot's own loop runs"
EXAMPLE = """example: repctl export design.json --to panda_control --name panda_control

C99 and C++17 that need nothing but <math.h>; check.c tells whether a build computes what Python does:
  cmake -S panda_control -B build && cmake --build build && ctest --test-dir build"""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this subcommand."""
    what_options(parser)
    parser.set_defaults(frame=None, task=None)
    parser.add_argument("--to", metavar="FOLDER", default="arm_control", help="folder to write (default arm_control)")
    parser.add_argument(
        "--name", default="arm_control", help="prefix of the files and of every name in C (default arm_control)"
    )
    parser.add_argument("--json", action="store_true", help="print JSON instead of text")


def run(options: argparse.Namespace) -> int:
    """Write the folder."""
    from ..codegen import export_c

    if not is_saved(options.what):
        raise InputError(f"{options.what!r} is no saved design (.json); repctl design makes one")
    design = load_design(options)
    files = [str(file) for file in export_c(design.inverse, options.to, options.name, region=design.region)]
    if options.json:
        task = design.task
        print(json.dumps({**task.as_dict(), "name": options.name, "files": files}, indent=2, ensure_ascii=False))
        return 0
    for file in files:
        print(f"wrote {file}")
    return 0
