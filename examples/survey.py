"""Measure the drift of many arms under J⁺ and under the nearest repeatable inverse, and the extra
joint speed.

    python examples/survey.py            # the table of docs/survey.md, as Markdown
    python examples/survey.py panda ur5  # only these, pose and position

Each arm is studied as `repctl study` does by default: start, path and region are chosen for it, and
the motion is ten cycles of 500 RK4 steps, open loop. *Extra joint speed* is the rms joint speed
over the first cycle, relative to J⁺; later, J⁺ drifts to other configurations. J⁺ minimises ‖q̇‖ at
every instant, but not over a whole cycle, so the extra joint speed can be negative."""

from __future__ import annotations

import sys
from collections.abc import Sequence

import numpy as np

import repctl_pin as rp
from repctl_pin.show.text.numbers import percent

ARMS = (
    ("panda", None, ("pose", "position")),
    ("xarm7", None, ("pose", "position")),
    ("baxter", "left_gripper", ("pose", "position")),
    ("baxter", "right_gripper", ("pose", "position")),
    ("tiago", None, ("pose", "position")),
    ("pr2", None, ("pose", "position")),
    ("talos", None, ("pose", "position")),
    ("kinova", None, ("position",)),
    ("ur5", None, ("position",)),
    ("z1", None, ("position",)),
    ("ppr", None, ("xy",)),
    ("prr", None, ("xy",)),
    ("planar3r", None, ("xy",)),
    ("planar4r", None, ("xy",)),
    ("planar7r", None, ("xy",)),
)

COLUMNS = (
    "arm",
    "task",
    "r",
    "circle",
    "J⁺, cycle 1",
    "J⁺, cycle 10",
    "repeatable, cycle 10",
    "extra joint speed",
)


def markdown(cells: Sequence[object]) -> str:
    """Write one row of a Markdown table."""
    return f"| {' | '.join(map(str, cells))} |"


def rms_of_first_cycle(motion: rp.Motion) -> float:
    """Compute the root mean square of ‖q̇‖ over the first cycle."""
    return float(np.sqrt(np.mean(motion.speed[: motion.steps] ** 2)))


def line(name: str, frame: str | None, kind: str, **options: int) -> str:
    """Study one arm and write its line of the table."""
    study = rp.study(rp.Problem(name, frame=frame, kind=kind), **options)
    drifting = study.row("pseudoinverse").motion
    closed = study.row("repeatable").motion
    assert closed is not None
    extra = "–"
    first = last = "stopped"
    if drifting is not None:
        extra = percent(rms_of_first_cycle(closed) / rms_of_first_cycle(drifting) - 1)
        first = f"{drifting.drift[0]:.2g}"
        last = f"{drifting.drift[-1]:.2g}"
        if drifting.broken_cycle:
            last += f", limit violated in cycle {drifting.broken_cycle}"
    circle = study.path.name.removeprefix("circle of radius ").replace(" in ", ", ")
    label = name if frame is None else f"{name} ({frame.split('_')[0]})"
    repeatable = f"{closed.drift[-1]:.0e}"
    return markdown((label, kind, study.task.r, circle, first, last, repeatable, extra))


def main(arguments: Sequence[str] = (), **options: int) -> list[str]:
    """Print the table and return its lines."""
    chosen = ARMS
    if arguments:
        known = {name for name, _, _ in ARMS}
        chosen = tuple(row for row in ARMS if row[0] in arguments)
        chosen += tuple(
            (name, None, ("pose", "position")) for name in arguments if name not in known
        )
    lines = [markdown(COLUMNS), markdown(["---"] * len(COLUMNS))]
    print("\n".join(lines))
    for name, frame, kinds in chosen:
        for kind in kinds:
            try:
                lines.append(line(name, frame, kind, **options))
            except rp.RepctlError as error:
                lines.append(f"| {name} | {kind} | | {error} | | | | |")
            print(lines[-1], flush=True)
    return lines


if __name__ == "__main__":
    main(sys.argv[1:])
