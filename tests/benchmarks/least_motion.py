"""The yardstick: the default study of twelve robots beside the least closed motions on its path.

It writes a table of docs/benchmark.md, in a few minutes of processor time:

    python tests/benchmarks/least_motion.py [ROBOT …]
"""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import NamedTuple

os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"))

import repctl_pin as rp
from repctl_pin.motion.least_start import least_start

ROBOTS = [
    "panda",
    "xarm7",
    "baxter",
    "centauro",
    "planar3r",
    "tiago",
    "pr2",
    "planar4r",
    "so101",
    "talos",
    "kinova",
    "ur5",
]
STEPS = 200
PAGE = Path(__file__).parents[2] / "docs" / "benchmark.md"
HEAD = (
    "| robot | r | repeatable | least | above | least, start free | least on the leaf "
    "for speed | repeatable there | joint-limit margin there | largest found | body distance |\n"
    "| --- " + "| --- " * 10 + "|"
)


class Row(NamedTuple):
    """Figures of one robot: joint speeds (rms) relative to J⁺'s first cycle, and margins."""

    robot: str
    r: int
    own: float
    least: float
    free: float
    leaf: float
    own_there: float
    margin: float
    largest: float
    bodies: float

    def __str__(self) -> str:
        change = [self.own, self.least, self.own / self.least, self.free, self.leaf, self.own_there]
        speeds = " | ".join(f"{round(100 * (value - 1), 2) + 0.0:+.2f}\u00a0%" for value in change)
        speeds = speeds.replace("-", "−")
        bodies = "–" if self.bodies == float("inf") else f"{100 * self.bodies:.1f} cm"
        margins = f"{self.margin:.2f} | {self.largest:.2f} | {bodies}"
        return f"| {self.robot} | {self.r} | {speeds} | {margins} |"


def measured(robot: str) -> Row:
    """Compare the repeatable motion of the default study with the least ones on its path."""
    study = rp.study(robot, cycles=1)
    task, path, q0 = study.task, study.path, study.q0
    plain = rp.follow(rp.Pseudoinverse(task), path, q0, cycles=1, steps=STEPS)
    own = cycle(study, STEPS)
    least = rp.least_closed_motion(task, path, q0, steps=STEPS, guess=own)
    found = least_start(task, path, q0)
    there = found.best.q[0]
    leaf = rp.least_closed_motion(task, path, there, steps=STEPS, guess=found.best)
    free = [
        rp.least_closed_motion(task, path, guess.q[0], steps=STEPS, guess=guess, free_start=True)
        for guess in (least, leaf)
    ]
    problem = rp.Problem(task, start=there, path=path)
    again = cycle(rp.study(problem, cycles=1), STEPS)
    speeds = [own, least, min(free, key=lambda motion: motion.rms_speed), leaf, again]
    return Row(
        robot,
        task.r,
        *(motion.rms_speed / plain.rms_speed for motion in speeds),
        margin=float(leaf.limit_margin.min()),
        largest=float(found.clearest.limit_margin.min()),
        bodies=float(leaf.clearance.distance),
    )


def cycle(study: rp.Study, steps: int) -> rp.Motion:
    """Follow one cycle of a study's design from point to point, on its leaf."""
    lock = rp.LeafLock(4)
    inverse = study.design.inverse
    return rp.follow(inverse, study.path, study.q0, cycles=1, steps=steps, integrator=lock)


def main(robots: list[str]) -> None:
    """Print the table, and write it if it has all robots."""
    lines = [HEAD]
    for robot in robots or ROBOTS:
        lines.append(str(measured(robot)))
        print(lines[-1], flush=True)
    if not robots:
        text, mark = PAGE.read_text(encoding="utf-8"), "<!-- benchmark: least -->"
        before, after = text.split(mark)
        after = after[after.index("<!-- end -->") :]
        table = "\n".join(lines)
        PAGE.write_text(f"{before}{mark}\n\n{table}\n\n{after}", encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
