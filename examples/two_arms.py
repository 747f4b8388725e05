"""Both arms of a robot at work, each on a circle of its own: under J⁺ both elbows drift, under ours
neither does.

Each arm has its own task and its own design; the two motions are put together into motions of the
whole robot and shown on one page, with the traces of both hands and both elbows. Any robot with two
arms that share no joint will do: give its name or URDF, and the two frames.

    python examples/two_arms.py python examples/two_arms.py talos gripper_left_joint
    gripper_right_joint --lock torso_1_joint --lock torso_2_joint
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

import repctl_pin as rp
from repctl_pin.files import prepare_folder, write_whole
from repctl_pin.show.page.playback import Playback, TracedChain, playback_of, playback_page
from repctl_pin.show.palette import COLOURS


def study_both(
    robot: rp.Robot, frames: tuple[str, str], *, cycles: int = 3, radius: float = 0.1
) -> list[rp.Study]:
    """Study each arm alone, the rest of the robot standing still."""
    left, right = (robot.task(frame).joint_names for frame in frames)
    shared = [name for name in left if name in right]
    if shared:
        raise rp.InputError(
            f"both arms of {robot.name} move {' and '.join(shared)}; hold them with --lock"
        )
    return [rp.study(robot, frame=frame, cycles=cycles, radius=radius) for frame in frames]


def together(studies: list[rp.Study], key: str) -> Playback:
    """Put the motions of a strategy together: each arm's joints stand still in the other's
    motion."""
    own = [
        playback_of(study.row(key).label, study.row(key).motion, COLOURS[key]) for study in studies
    ]
    rest = studies[0].robot.reference
    return replace(
        own[0],
        Q=rest + sum(track.Q - rest for track in own),
        drift=np.hypot(own[0].drift, own[1].drift),
    )


def both_arms_page(studies: list[rp.Study]) -> str:
    """Make the page: J⁺ beside the nearest repeatable inverses."""
    tracks = [together(studies, "pseudoinverse"), together(studies, "repeatable")]
    chains = [TracedChain(study.task, study.elbow) for study in studies]
    paths = [study.path.points() for study in studies]
    return playback_page(
        chains, tracks, paths=paths, name=f"each arm on its own {studies[0].path.name}"
    )


def main() -> None:
    """Study both arms, say how far they drift, and write the page."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("robot", nargs="?", default="baxter")
    parser.add_argument(
        "frames", nargs="*", default=["left_gripper", "right_gripper"], metavar="FRAME"
    )
    parser.add_argument(
        "--lock", action="append", default=[], metavar="JOINT", help="hold a joint still"
    )
    parser.add_argument("--cycles", type=int, default=3)
    parser.add_argument("--out", type=Path, default=Path("repctl-out"), metavar="FOLDER")
    options = parser.parse_args()
    if len(options.frames) != 2:
        parser.error("two frames are wanted, one for each arm")
    try:
        robot = rp.Robot.load(options.robot, lock=options.lock)
        studies = study_both(robot, tuple(options.frames), cycles=options.cycles)
    except rp.RepctlError as error:
        raise SystemExit(f"two_arms: {error}") from None
    for study in studies:
        creeping, closed = study.row("pseudoinverse").motion, study.row("repeatable").motion
        drifts = f"J⁺ {creeping.drift[-1]:.2g}, nearest repeatable {closed.drift[-1]:.0e}"
        print(f"{study.task.frame}: off the start after {options.cycles} cycles, rad: {drifts}")
    folder = prepare_folder(options.out)
    print(
        f"wrote {write_whole(folder / f'{studies[0].robot.name}-both.html', both_arms_page(studies))}"
    )


if __name__ == "__main__":
    main()
