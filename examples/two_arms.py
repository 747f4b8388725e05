"""Move both hands of a robot at once: under J⁺ elbows, waist and head drift, under the nearest
repeatable inverse nothing does.

Both hands are one task with several frames, so the joints that they share, such as those of the
waist, are moved for both. The robot may be any robot with two hands: give its name or URDF, and the
two frames.

    python examples/two_arms.py
    python examples/two_arms.py baxter left_gripper right_gripper
    python examples/two_arms.py talos --lock torso_1_joint --lock torso_2_joint
"""

from __future__ import annotations

import argparse
from pathlib import Path

import repctl_pin as rp

HANDS = ["gripper_left_base_link", "gripper_right_base_link"]


def study_both(
    robot: rp.Robot, frames: list[str], *, cycles: int = 10, radius: float = 0.08
) -> rp.Study:
    """Study both hands, each on a separate circle."""
    problem = rp.Problem(robot, frame=frames, path=[f"circle:{radius}"] * len(frames))
    return rp.study(problem, cycles=cycles, degree=1)


def main() -> None:
    """Study both hands, print the drift, and write the page."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("robot", nargs="?", default="talos")
    parser.add_argument("frames", nargs="*", default=HANDS, metavar="FRAME")
    parser.add_argument(
        "--lock", action="append", default=[], metavar="JOINT", help="keep a joint fixed"
    )
    parser.add_argument("--cycles", type=int, default=10)
    parser.add_argument("--out", type=Path, default=Path("repctl-out"), metavar="FOLDER")
    options = parser.parse_args()
    try:
        robot = rp.Robot.load(options.robot, lock=options.lock)
        study = study_both(robot, list(options.frames), cycles=options.cycles)
        page = rp.animation(study).save(options.out / f"{robot.name}-both.html")
    except rp.RepctlError as error:
        raise SystemExit(f"two_arms: {error}") from None
    drifting, closed = (study.row(key).motion.drift[-1] for key in ("pseudoinverse", "repeatable"))
    print(f"{study.task.frame}, {study.task.n} joints:")
    print(f"drift after {options.cycles} cycles, rad: J⁺ {drifting:.2g}, ", end="")
    print(f"nearest repeatable {closed:.0e}")
    print(f"wrote {page}")


if __name__ == "__main__":
    main()
