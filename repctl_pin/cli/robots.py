"""``repctl robots``: the catalogue."""

from __future__ import annotations

import argparse
import json
from typing import Any

from .terminal import clear_line, progress

HELP = "list the catalogue: joints, chains, frames, redundancy by task"
EXAMPLE = "example: repctl robots"


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this subcommand."""
    parser.add_argument("--json", action="store_true", help="print JSON instead of the table")


def run(options: argparse.Namespace) -> int:
    """List the catalogue."""
    from ..robot.robot import Robot
    from ..show.text.table import table
    from ..studies.defaults import redundant_kinds
    from ..urdf.catalogue import entries

    say = progress(options.json)
    rows: list[dict[str, Any]] = []
    for entry in entries():
        say(f"reading {entry.name}")
        robot = Robot.load(entry.name)
        rows.extend(
            {
                "robot": entry.name,
                "joints": len(robot.joint_names),
                "frame": frame,
                "chain": len(robot.chain(frame)),
                "redundancy": redundant_kinds(robot, frame),
            }
            for frame in robot.offered_frames
        )
    clear_line()
    if options.json:
        print(json.dumps(rows, indent=2))
        return 0
    kinds = ("pose", "axis", "position", "xy", "xz", "yz")
    print(
        table(
            ["robot", "joints", "chain", *kinds, "frame"],
            [
                [
                    row["robot"],
                    str(row["joints"]),
                    str(row["chain"]),
                    *(str(row["redundancy"].get(kind, "–")) for kind in kinds),
                    row["frame"],
                ]
                for row in rows
            ],
        )
    )
    print(
        "joints: all that move; chain: those that move the frame; then r = chain − m for each kind of task,\n"
        "– where the arm cannot do it at all. r ≥ 1 is redundant: the motion under J⁺ creeps."
    )
    return 0
