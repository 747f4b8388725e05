"""``repctl export``: write a saved design as C code for a robot's control loop.

The design is a repeatable inverse, or the function of a cell, a box of poses.
"""

from __future__ import annotations

import repctl_pin as rp

from ...cli.options import Parser
from ...cli.parsed_options import Options
from ...cli.print_result import print_result

HELP = "write a saved design or cell as C for the control loop of a robot"
EXAMPLE = """examples:
  repctl export repctl-out/panda/design.json --out panda_c --name panda
  repctl export control.json --robot my_arm.urdf --out my_arm_c --name my_arm

C99 and C++17 that require only <math.h>; check.c compares a build with the
results of Python:
  cmake -S panda_c -B build && cmake --build build && ctest --test-dir build"""


def add_options(parser: Parser) -> None:
    """Add the options of ``repctl export`` to its parser."""
    parser.what("a saved design or cell (.json) of repctl design, study or cell")
    parser.set_defaults(frame=None, task=None)
    parser.add_argument(
        "--out",
        metavar="FOLDER",
        default="arm_control",
        help="folder to write (default arm_control)",
    )
    parser.add_argument(
        "--name",
        default="arm_control",
        help="prefix of the files and of every name in C (default arm_control)",
    )
    parser.json()


def run(options: Options) -> int:
    """Write the C code of a saved design or cell to a folder; return the exit code."""
    design = options.load_saved()
    if isinstance(design, rp.CellDesign):
        files = rp.export_c(design.function, options.out, options.name)
    else:
        alone = len(design.task.frames) == 1  # C has the closing radius of one frame
        files = rp.export_c(
            design.inverse,
            options.out,
            options.name,
            region=design.region,
            closes=(alone and design.proof and design.proof.closes) or None,
        )
    return print_result(
        options, lambda: {**design.task.as_dict(), "name": options.name}, files=files
    )
