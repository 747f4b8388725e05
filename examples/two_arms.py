"""Move both arms of a robot, each on a separate circle: under J⁺ both elbows drift, under the
nearest repeatable inverses neither does.

Each arm has its own task and its own design. The two motions are combined into motions of the whole
robot and shown on one page, with the traces of both end effectors and both elbows. The robot may be
any robot with two arms that share no joint: give its name or URDF, and the two frames.

    python examples/two_arms.py
    python examples/two_arms.py talos gripper_left_joint gripper_right_joint \\
        --lock torso_1_joint --lock torso_2_joint
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

import repctl_pin as rp
from repctl_pin.files import prepare_folder, write_whole
from repctl_pin.show.page.playback import (
    Playback,
    TracedChain,
    playback_of,
    playback_page,
)
from repctl_pin.show.palette import COLOURS


def study_both(
    robot: rp.Robot, frames: tuple[str, str], *, cycles: int = 3, radius: float = 0.1
) -> list[rp.Study]:
    """Study each arm alone, with the other joints of the robot held fixed."""
    left, right = (robot.task(frame).joint_names for frame in frames)
    shared = [name for name in left if name in right]
    if shared:
        raise rp.InputError(
            f"both arms of {robot.name} move {' and '.join(shared)}; fix these joints with --lock"
        )
    return [
        rp.study(rp.Problem(robot, frame=frame, path=f"circle:{radius}"), cycles=cycles)
        for frame in frames
    ]


def together(studies: list[rp.Study], key: str) -> Playback:
    """Add the motions of both arms under one strategy: each moves only its own joints."""
    single = []
    for study in studies:
        row = study.row(key)
        single.append(playback_of(row.label, row.motion, COLOURS[key]))
    rest = studies[0].robot.reference
    return replace(
        single[0],
        Q=rest + sum(track.Q - rest for track in single),
        drift=np.hypot(single[0].drift, single[1].drift),
    )


def both_arms_page(studies: list[rp.Study]) -> str:
    """Make the page: J⁺ beside the nearest repeatable inverses."""
    tracks = [together(studies, "pseudoinverse"), together(studies, "repeatable")]
    chains = [TracedChain(study.task, study.elbow) for study in studies]
    paths = [study.path.points() for study in studies]
    return playback_page(
        chains,
        tracks,
        paths=paths,
        name=f"each arm on a separate {studies[0].path.name}",
    )


def main() -> None:
    """Study both arms, print their drift, and write the page."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("robot", nargs="?", default="baxter")
    parser.add_argument(
        "frames", nargs="*", default=["left_gripper", "right_gripper"], metavar="FRAME"
    )
    parser.add_argument(
        "--lock",
        action="append",
        default=[],
        metavar="JOINT",
        help="keep a joint fixed",
    )
    parser.add_argument("--cycles", type=int, default=3)
    parser.add_argument(
        "--out", type=Path, default=Path("repctl-out"), metavar="FOLDER"
    )
    options = parser.parse_args()
    if len(options.frames) != 2:
        parser.error(f"two frames are required, one per arm, not {len(options.frames)}")
    try:
        robot = rp.Robot.load(options.robot, lock=options.lock)
        studies = study_both(robot, tuple(options.frames), cycles=options.cycles)
    except rp.RepctlError as error:
        raise SystemExit(f"two_arms: {error}") from None
    for study in studies:
        drifting = study.row("pseudoinverse").motion.drift[-1]
        closed = study.row("repeatable").motion.drift[-1]
        drifts = f"J⁺ {drifting:.2g}, nearest repeatable {closed:.0e}"
        print(f"{study.task.frame}: drift after {options.cycles} cycles, rad: {drifts}")
    folder = prepare_folder(options.out)
    file = folder / f"{studies[0].robot.name}-both.html"
    print(f"wrote {write_whole(file, both_arms_page(studies))}")


if __name__ == "__main__":
    main()
