"""Every arm of a list, one line each: how far it drifts under J⁺ and under the repeatable inverse,
and the price.

    python examples/survey.py            # the table of the README, as Markdown
    python examples/survey.py panda ur5  # only these, pose and position

Each arm runs `repctl study` with its defaults: start, path and region are chosen for it, ten cycles
of 500 RK4 steps, open loop. *Price* compares the root mean square joint speed over the first cycle,
before J⁺ has drifted away from the common start: what closing the cycle costs. J⁺ minimises ‖q̇‖ at
every instant, but not over a whole cycle, so the extra joint speed can be negative."""

from __future__ import annotations

import sys
from collections.abc import Sequence

import numpy as np

import repctl_pin as rp

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

HEADER = "| arm | task | r | circle | J⁺, first cycle | J⁺, cycle 10 | repeatable, cycle 10 | price in joint speed |"


def rms_of_first_cycle(motion: rp.Motion) -> float:
    """Root mean square of ‖q̇‖ over the first cycle."""
    return float(np.sqrt(np.mean(motion.speed[: motion.steps] ** 2)))


def line(name: str, frame: str | None, kind: str, **options: int) -> str:
    """Study one arm and write its line of the table."""
    study = rp.study(name, frame=frame, kind=kind, **options)
    creeping, closed = study.row("pseudoinverse").motion, study.row("repeatable").motion
    assert closed is not None
    price = "–"
    first = last = "stuck"
    if creeping is not None:
        price = f"{rms_of_first_cycle(closed) / rms_of_first_cycle(creeping) - 1:+.1%}"
        first, last = f"{creeping.drift[0]:.2g}", f"{creeping.drift[-1]:.2g}"
        if creeping.broken_cycle:
            last += f", limit broken in cycle {creeping.broken_cycle}"
    circle = study.path.name.removeprefix("circle of radius ").replace(" in ", ", ")
    label = name if frame is None else f"{name} ({frame.split('_')[0]})"
    return f"| {label} | {kind} | {study.task.r} | {circle} | {first} | {last} | {closed.drift[-1]:.0e} | {price} |"


def main(arguments: Sequence[str] = (), **options: int) -> list[str]:
    """Print the table and return its lines."""
    chosen = ARMS
    if arguments:
        known = {name for name, _, _ in ARMS}
        chosen = tuple(row for row in ARMS if row[0] in arguments)
        chosen += tuple(
            (name, None, ("pose", "position")) for name in arguments if name not in known
        )
    lines = [HEADER, "|" + " --- |" * (HEADER.count("|") - 1)]
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
