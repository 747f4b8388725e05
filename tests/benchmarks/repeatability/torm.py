"""The closed paths of TORM on the arm of a Fetch, as CppFlow reads them.

Three of the eight paths that CppFlow (github.com/jstmn/cppflow, MIT) takes from TORM
(github.com/cheulkang/TORM) are closed. Its files sample polylines; here are their corners. The
arm's dimensions and limits are those of fetch_ros (BSD)."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from scenes import Scene

import repctl_pin as rp

PERIOD = 20.0  # s, as in CppFlow's files of the circle and the square

TORSO = (-0.086875, 0.0, 0.37743)
"""Place of the link whose frame CppFlow's offsets are given in, m; the lift is at 0."""

_POLYGON = 2 * np.pi * np.arange(50) / 49
_EIGHTH = np.pi / 4

CORNERS = {
    "circle": np.column_stack(
        [np.zeros(50), 0.25 * np.cos(_POLYGON) - 0.25, 0.25 * np.sin(_POLYGON), np.zeros((50, 3))]
    ),
    "square": np.array(
        [
            [0.0, 0.0, 0.0, 0, 0, 0],
            [0.0, 0.2, 0.0, 0, 0, 0],
            [-0.3, 0.2, -0.2, 0, 0, 0],
            [-0.3, -0.2, -0.2, 0, 0, 0],
            [0.0, -0.2, 0.0, 0, 0, 0],
            [0.0, 0.0, 0.0, 0, 0, 0],
        ]
    ),
    "rotation": np.array(
        [
            [0, 0, 0, 0, 0, 0],
            [0, 0, 0, 0, _EIGHTH, 0],
            [0, 0, 0, 0, -_EIGHTH, 0],
            [0, 0, 0, 0, 0, 0],
            [0, 0, 0, 0, 0, _EIGHTH],
            [0, 0, 0, 0, 0, -_EIGHTH],
            [0, 0, 0, 0, 0, 0],
        ]
    ),
}
"""Place and rotation vector of each corner, relative to the offset: m, rad."""

OFFSETS = {"circle": (0.9, 0.25, 0.46), "square": (1.1, 0.0, 0.66), "rotation": (0.8, 0.0, 0.35)}
"""From the torso to the first pose, m; the rotation of the offset is the identity."""

STARTS = {
    "circle": (1.05, 0.27, -2.02, 1.7, -0.42, -0.69, 2.35),
    "square": (-0.35, -0.41, -4.61, 0.8, 0.78, -0.62, -2.21),
    "rotation": (0.76, 0.57, 1.43, -2.2, 0.31, 1.33, -1.13),
}
"""Where to begin: of 300 random configurations at the first pose, that from which J⁺ stays farthest
from limits and singularities in the first cycle."""

_JOINTS = (
    ("shoulder_pan", (0.03265, 0, 0.72601), "z", -1.6056, 1.6056, 1.256),
    ("shoulder_lift", (0.117, 0, 0.06), "y", -1.221, 1.518, 1.454),
    ("upperarm_roll", (0.219, 0, 0), "x", -np.inf, np.inf, 1.571),
    ("elbow_flex", (0.133, 0, 0), "y", -2.251, 2.251, 1.521),
    ("forearm_roll", (0.197, 0, 0), "x", -np.inf, np.inf, 1.571),
    ("wrist_flex", (0.1245, 0, 0), "y", -2.16, 2.16, 2.268),
    ("wrist_roll", (0.1385, 0, 0), "x", -np.inf, np.inf, 2.268),
)
"""Name, place in the link before it, axis, lower and upper limit, speed limit."""


def fetch_joints() -> tuple[list, pin.SE3]:
    """List the joints of the arm, and the place of ``gripper_link`` behind the last one."""
    unit = dict(zip("xyz", np.eye(3), strict=True))
    joints = [
        (name, _moved(place), unit[axis], True, *limits) for name, place, axis, *limits in _JOINTS
    ]
    return joints, _moved((0.16645, 0, 0))


def scenes_of(task: rp.Task, steps: int) -> list[Scene]:
    """Make the three paths, each from its posture."""
    found = []
    for path, corners in CORNERS.items():
        offset = np.add(TORSO, OFFSETS[path])
        targets = [
            pin.SE3(pin.exp3(turn), offset + place) for place, turn in _along(corners, steps)
        ]
        q0 = rp.solve_ik(task, np.array(STARTS[path]), targets[-1])
        name = f"TORM {path}"
        found.append(Scene("fetch", name, "on", task, targets, q0, q0, PERIOD))
    return found


def _along(corners: np.ndarray, steps: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Go from corner to corner at one speed: place and rotation vector at the end of each step."""
    lengths = np.linalg.norm(np.diff(corners, axis=0), axis=1)
    at = np.append(0.0, np.cumsum(lengths))
    s = at[-1] * np.arange(1, steps + 1) / steps
    points = np.column_stack([np.interp(s, at, column) for column in corners.T])
    return [(point[:3], point[3:]) for point in points]


def _moved(place: tuple[float, ...]) -> pin.SE3:
    return pin.SE3(np.eye(3), np.array(place, dtype=float))
