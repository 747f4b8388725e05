"""Weld a nozzle to a plate that a two-axis positioner carries: ten pieces, with the same joints.

The seam is a circle on the workpiece, which the joints of the positioner move. The robot and the
positioner have eight joints, and the torch may turn about its wire, so three joints are redundant.
Under J⁺ every piece is welded in another way; under the nearest repeatable inverse all are alike.

    python examples/weld.py
    python examples/weld.py --slow 3        # the positioner's joints move less, the robot's more
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import pinocchio as pin

import repctl_pin as rp

CELL = Path(__file__).with_name("weld_cell.urdf")
CENTRE, RADIUS = 0.1, 0.065  # m, of the seam, on the workpiece

READY = [0.0, 0.0, 0.0, 0.5, -0.9, 0.0, 1.2, 0.0]
"""Configuration near which the seam is begun: turn, tilt, a1 to a6, rad."""


def begin(task: rp.Task) -> np.ndarray:
    """Find a configuration at the beginning of the seam, with the wire normal to the plate."""
    down = pin.utils.rotate("y", np.pi)
    return rp.solve_ik(task, READY, pin.SE3(down, np.array([CENTRE - RADIUS, 0.0, 0.002])))


def study_seam(slow: float, pieces: int) -> rp.Study:
    """Study the seam for ``pieces`` cycles; the joints of the positioner weigh ``slow``²."""
    task = rp.Robot.load(CELL).task("torch", "axis", on="workpiece")
    q0 = begin(task)
    weight = np.where([name in ("turn", "tilt") for name in task.joint_names], slow**2, 1.0)
    seam = rp.circle(task, q0, radius=RADIUS, start_angle=np.pi)
    problem = rp.Problem(task, start=q0, path=seam)
    return rp.study(problem, cycles=pieces, degree=1, weight=None if slow == 1 else weight)


def main() -> None:
    """Study the seam, print what ten pieces differ by, and write the page."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--slow", type=float, default=1.0, help="weight of the positioner")
    parser.add_argument("--pieces", type=int, default=10)
    parser.add_argument("--out", type=Path, default=Path("repctl-out"), metavar="FOLDER")
    options = parser.parse_args()
    try:
        study = study_seam(options.slow, options.pieces)
        page = rp.animation(study).save(options.out / "weld.html")
    except rp.RepctlError as error:
        raise SystemExit(f"weld: {error}") from None
    for key in ("pseudoinverse", "repeatable"):
        row = study.row(key)
        q, steps = row.motion.q, row.motion.steps
        starts = np.degrees(np.abs(q[::steps] - q[0]).max(axis=0))
        moved = np.degrees(np.ptp(q[: steps + 1], axis=0))
        print(f"{row.label}: starts of pieces differ by {starts.max():.1f}° in a joint; ", end="")
        print(f"in one piece the table turns {moved[0]:.2g}° and tilts {moved[1]:.2g}°")
    print(f"wrote {page}")


if __name__ == "__main__":
    main()
