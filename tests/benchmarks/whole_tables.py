"""The whole tables of several arms, for the table in docs/how-to/cell.md.

Run ``python tests/benchmarks/whole_tables.py [ARM …]``. Each line is one call of ``rp.best_cell``
without a size: areas of radius and height in m², angle and spin in degrees, extra joint speed in
percent, body distance in cm, and processor time in s, with the time to read the bodies. The
function with one range of radius is designed afterwards, outside this time. An arm is a catalogue
name or a URDF, after which ``@FRAME`` may name the frame. The note of the table follows on standard
error.
"""

from __future__ import annotations

import sys
import time

import numpy as np

import repctl_pin as rp

ARMS = ("panda", "xarm7", "baxter", "kinova", "ur5", "ur10", "z1", "tiago", "talos")
TITLES = (
    "arm | reach | rectangle | one range | designed | angle, spin | mean, worst | bodies | time"
)


def line(name: str) -> list[str]:
    """Find the whole table of one arm; return the entries of its line."""
    file, _, given = name.partition("@")
    robot = rp.Robot.load(file)
    frame = given or robot.default_frame
    kind = "pose" if len(robot.chain(frame)) > 6 else "axis"
    begin = time.process_time()
    try:
        found = rp.best_cell(robot.task(frame, kind), orientation="down")
    except rp.InputError as error:
        return [name, f"refused: {error}"]
    seconds = time.process_time() - begin
    table, design = found.table, found.table.design
    print(f"{name}: {table}", file=sys.stderr, flush=True)
    straight = table._replace(design=table.straight).area
    widths = dict(zip(found.cell.coordinate_names, found.cell.widths, strict=True))
    turns = [f"{np.degrees(2 * widths[way]):.0f}" for way in ("angle", "spin") if way in widths]
    return [
        f"{robot.name}, {kind}",
        *(f"{area:.3f}" for area in (table.reach, table.rectangle, straight)),
        f"{table.area:.3f}" if table.by_height else "–",
        ", ".join(turns),
        f"{100 * max(design.extra_speed, 0.0):.1f}, {100 * design.extra_speed_worst:.0f}",
        f"{100 * design.body_distance:.1f}" if np.isfinite(design.body_distance) else "–",
        f"{seconds:.0f}",
        str(table.locked),
    ]


if __name__ == "__main__":
    print(f"| {TITLES} | locked |")
    for arm in sys.argv[1:] or ARMS:
        print("| " + " | ".join(line(arm)) + " |", flush=True)
