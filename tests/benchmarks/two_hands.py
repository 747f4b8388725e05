"""Both hands of whole robots: what drifts under J⁺, and what closing it costs.

Each robot moves one hand, then both, on circles of 8 cm, ten cycles, from the start that a study
chooses. The table is that of docs/how-to/two-hands.md; times are of the processor:

    python tests/benchmarks/two_hands.py
    python tests/benchmarks/two_hands.py g1 icub
"""

from __future__ import annotations

import argparse
import math
import os
import time
from collections.abc import Iterator
from typing import NamedTuple

os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"))

import repctl_pin as rp

ROBOTS = {
    "talos": ("gripper_left_base_link", "gripper_right_base_link"),
    "pr2": ("l_gripper_tool_frame", "r_gripper_tool_frame"),
    "tiago_dual": ("wrist_left_ft_tool_link", "wrist_right_ft_tool_link"),
    "g1": ("left_rubber_hand", "right_rubber_hand"),
    "icub": ("l_hand", "r_hand"),
}
PATH = "circle:0.08"
CYCLES = 10
STEPS = 500

COLUMNS = (
    "robot",
    "moving",
    "n, r",
    "drift of J⁺, cycle 1",
    "cycle 10",
    "repeatable, cycle 10",
    "extra joint speed",
    "least possible",
    "limit margin",
    "body distance",
    "study, s",
)


class Found(NamedTuple):
    """One line of the table: rad, m, shares of the joint speed of J⁺ in cycle 1, and seconds."""

    robot: str
    moving: str
    joints: tuple[int, int]
    drift_1: float
    drift_10: float
    closed: float
    extra: float
    least: float
    limit_margin: float
    body_distance: float
    seconds: float

    def cells(self) -> list[str]:
        """Format the line."""
        drifts = [f"{self.drift_1:.2f}", f"{self.drift_10:.2f}", f"{self.closed:.0e}"]
        speeds = [
            "none in limits" if math.isnan(share) else f"{100 * share:+.2f} %"
            for share in (self.extra, self.least)
        ]
        margin = f"{self.limit_margin:.2f}"
        distance = f"{100 * self.body_distance:.1f} cm"
        time_taken = f"{self.seconds:.0f}"
        n, r = self.joints
        first = [self.robot, self.moving, f"{n}, {r}"]
        return [*first, *drifts, *speeds, margin, distance, time_taken]


def measured(robot: str, *, both: bool) -> Found:
    """Study one robot: the drift under J⁺, and the repeatable inverse beside the least motion."""
    begin = time.process_time()
    path = [PATH, PATH if both else None]
    problem = rp.Problem(robot, frame=list(ROBOTS[robot]), path=path)
    study = rp.study(problem, cycles=CYCLES, steps=STEPS)
    seconds = time.process_time() - begin
    usual = study.row("pseudoinverse").motion
    closed = study.row("repeatable").motion
    return Found(
        robot,
        "both hands" if both else "one hand",
        (study.task.n, study.task.r),
        float(usual.drift[0]),
        float(usual.drift[-1]),
        float(closed.drift[-1]),
        closed.first_rms_speed / usual.first_rms_speed - 1,
        least_speed(study),
        float(closed.limit_margin.min()),
        float(closed.body_distance.min()),
        seconds,
    )


def least_speed(study: rp.Study) -> float:
    """Compute the extra joint speed of the least closed motion near that of the design."""
    path, q0 = study.path, study.row("repeatable").motion.q[0]
    own = rp.follow(study.design.inverse, path, q0, cycles=1, steps=200)
    plain = rp.follow(rp.Pseudoinverse(study.task), path, q0, cycles=1, steps=200)
    try:
        least = rp.least_closed_motion(study.task, path, q0, steps=200, guess=own)
    except rp.InputError:  # none within the joint limits
        return math.nan
    return least.rms_speed / plain.rms_speed - 1


def table(robots: list[str]) -> Iterator[str]:
    """Make the table, line by line, as the numbers come."""
    yield f"| {' | '.join(COLUMNS)} |"
    yield "|" + " --- |" * len(COLUMNS)
    for robot in robots:
        for both in (False, True):
            yield f"| {' | '.join(measured(robot, both=both).cells())} |"


def main() -> None:
    """Measure, and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("robots", nargs="*", choices=[[], *ROBOTS], default=[])
    for line in table(parser.parse_args().robots or list(ROBOTS)):
        print(line, flush=True)


if __name__ == "__main__":
    main()
