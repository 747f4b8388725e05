"""The whole tables of several arms, for the table in docs/cells-measured.md.

Run ``python tests/benchmarks/whole_tables.py [ARM …]``. Each line is one call of ``rp.best_cell``
without a size: areas of radius and height in m², angle and spin in degrees, extra joint speed in
percent, body distance in cm, and processor time in s, with the time to read the bodies. The
function with one range of radius is designed afterwards, outside this time. An arm is a catalogue
name, a URDF, after which ``@FRAME`` may name the frame, or ``lift``: the six-axis arm of
``examples/rail_cell.urdf`` on a vertical rail of 0.6 m. The note of the table follows on standard
error.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

import repctl_pin as rp

ARMS = ("panda", "xarm7", "baxter", "kinova", "ur5", "ur10", "z1", "tiago", "talos", "lift")
RAIL = Path(__file__).parents[2] / "examples" / "rail_cell.urdf"
TITLES = (
    "arm | reach | rectangle | one range | designed | angle, spin | mean, worst | bodies | time"
)


def on_a_lift(file: Path) -> str:
    """Write the arm of ``rail_cell.urdf`` on a vertical rail to a file; return ``FILE@FRAME``."""
    along = '<axis xyz="0 1 0"/>\n    <limit lower="-0.8" upper="0.8"'
    before, rail, after = RAIL.read_text("utf-8").partition(along)
    assert rail, "the rail has other limits"
    upward = '<axis xyz="0 0 1"/>\n    <limit lower="0" upper="0.6"'
    file.write_text(before + upward + after, "utf-8")
    return f"{file}@nozzle"


def task_of(name: str) -> rp.Task:
    """Load the task of an arm: a pose task, or an axis task if it has at most six joints."""
    file, _, given = name.partition("@")
    robot = rp.Robot.load(file)
    frame = given or robot.default_frame
    return robot.task(frame, "pose" if len(robot.chain(frame)) > 6 else "axis")


def line(name: str) -> list[str]:
    """Find the whole table of one arm; return the entries of its line."""
    task = task_of(name)
    begin = time.process_time()
    try:
        found = rp.best_cell(task, orientation="down")
    except rp.InputError as error:
        return [name, f"refused: {error}"]
    seconds = time.process_time() - begin
    table, design = found.table, found.table.design
    print(f"{name}: {table}", file=sys.stderr, flush=True)
    straight = table._replace(design=table.straight).area
    widths = dict(zip(found.cell.coordinate_names, found.cell.widths, strict=True))
    turns = [f"{np.degrees(2 * widths[way]):.0f}" for way in ("angle", "spin") if way in widths]
    return [
        f"{task.robot.name}, {task.kind}",
        *(f"{area:.3f}" for area in (table.reach, table.rectangle, straight)),
        f"{table.area:.3f}" if table.by_height else "–",
        ", ".join(turns),
        f"{100 * max(design.extra_speed, 0.0):.1f}, {100 * design.extra_speed_worst:.0f}",
        f"{100 * design.body_distance:.1f}" if np.isfinite(design.body_distance) else "–",
        f"{seconds:.0f}",
        str(table.locked),
    ]


def print_table(titles: str, line_of: Callable[[str], list[str]]) -> None:
    """Print a line for each arm of the command line, or for all arms."""
    print(f"| {titles} |")
    with tempfile.TemporaryDirectory() as folder:
        lift = on_a_lift(Path(folder) / "lift.urdf")
        for arm in sys.argv[1:] or ARMS:
            print("| " + " | ".join(line_of(lift if arm == "lift" else arm)) + " |", flush=True)


if __name__ == "__main__":
    print_table(f"{TITLES} | locked", line)
