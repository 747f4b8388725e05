"""``repctl robots``: list the catalogue of robots."""

from __future__ import annotations

from typing import Any

import repctl_pin as rp

from ..show.text.coloured_text import fitted
from .options import Parser
from .parsed_options import Options
from .print_result import print_result
from .terminal import progress

HELP = "list the catalogue: joints, chains, frames, redundancy by task"
EXAMPLE = "example: repctl robots"


def add_options(parser: Parser) -> None:
    """Add the options of ``repctl robots`` to its parser; :func:`run` reads them."""
    parser.json("the table")


def run(options: Options) -> int:
    """Print the catalogue: the joints and the redundancy of the frames offered for each robot.

    Redundancy is r = n − m, the number of joints that move the frame minus that of task
    coordinates, for each kind of task. Returns the exit code 0.
    """
    from ..model.catalogue import entries
    from ..show.text.table import table
    from ..studies.task_choice import redundant_kinds

    say = progress(options.json)
    rows: list[dict[str, Any]] = []
    for entry in entries():
        say(f"reading {entry.name}")
        robot = rp.Robot.load(entry.name)
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
    header = ["robot", "frame", "joints", "pose", "axis", "position", "plane"]
    legend = (
        "joints: those that move the frame, of all movable ones; then r = joints − m for\n"
        "each kind of task, with plane for xy, xz, yz; – means that the arm cannot do the\n"
        "task. With r ≥ 1 the task is redundant, and the motion under J⁺ drifts."
    )

    def text() -> str:
        return fitted(f"{table(header, [_cells(row) for row in rows], left=2)}\n{legend}")

    return print_result(options, lambda: rows, text)


def _cells(row: dict[str, Any]) -> list[str]:
    """Format one row of the catalogue's table, as one text per column.

    ``row`` has the keys ``robot`` and ``frame``, names; ``chain`` and ``joints``, the numbers of
    joints that move the frame and of all joints; and ``redundancy``, r by task kind.
    """
    r = row["redundancy"]
    planes = [kind for kind in ("xy", "xz", "yz") if kind in r]
    plane = str(r[planes[0]]) if len({r[kind] for kind in planes}) == 1 else "–"
    return [
        row["robot"],
        row["frame"],
        f"{row['chain']} of {row['joints']}",
        *(str(r.get(kind, "–")) for kind in ("pose", "axis", "position")),
        plane if len(planes) != 1 else f"{plane} {planes[0]}",
    ]
