"""What is to be done: closed paths round a start, from the posture and off it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
from robots import STARTS
from scipy.spatial.transform import Rotation

import repctl_pin as rp

RADIUS = 0.1  # m
BLEND = 0.005  # m
TILT = 0.2  # rad
OFF = 0.5  # rad
PERIOD = 5.0  # s


@dataclass(frozen=True)
class Scene:
    """One path from one start: the poses to reach, one a step, and the joints to begin from."""

    arm: str
    path: str
    start: str  # "on" the posture or "off" it
    task: rp.Task
    targets: list[pin.SE3]
    q0: np.ndarray
    posture: np.ndarray
    period: float = PERIOD

    @property
    def dt(self) -> float:
        """Time of a step, s."""
        return self.period / len(self.targets)


def scenes_of(arm: str, task: rp.Task, steps: int) -> list[Scene]:
    """Make the circle, the rounded square and a random tour, each from the posture and off it."""
    problem = rp.Problem(task, start=STARTS.get(arm), path=f"circle:{RADIUS}")
    found = []
    paths = {
        "circle": problem.path,
        "square": _square(task, problem.start),
        "tour": _tour(task, problem.start),
    }
    for name, path in paths.items():
        posture = rp.solve_ik(task, problem.start, path.placement(0.0))
        targets = [path.placement((k + 1) / steps) for k in range(steps)]
        scene = Scene(arm, name, "on", task, targets, posture, posture)
        found += [scene, replace(scene, start="off", q0=off_the_posture(task, posture))]
    return found


def off_the_posture(task: rp.Task, posture: np.ndarray) -> np.ndarray:
    """Move the elbow by 0.5 rad with the frame in place, to the side that has more room to the
    limits."""
    here, sides = task.placement(posture), []
    for sign in (1.0, -1.0):
        q, N = posture, rp.redundancy.nullspace(task.jacobian(posture))
        direction = sign * N[:, 0]
        while np.linalg.norm(q - posture) < OFF:
            J = task.jacobian(q)
            along = direction - np.linalg.pinv(J) @ (J @ direction)
            direction = along / np.linalg.norm(along)
            q = rp.solve_ik(task, q + 0.02 * direction, here)
        sides.append(q)
    return max(sides, key=lambda q: task.limit_margin(q).min())


def _square(task: rp.Task, q0: np.ndarray) -> rp.TaskPath:
    """Draw a horizontal square of 0.14 m with round corners, the start in the middle of one."""
    corners = 1.4 * RADIUS * np.array([[-1, 0, 0], [-1, 1, 0], [0, 1, 0]])
    return rp.polygon(task, q0, corners, blend=BLEND)


def _tour(task: rp.Task, q0: np.ndarray, seed: int = 0) -> rp.TaskPath:
    """Draw a tour of six random poses 0.1 m and 0.2 rad from the start, corners rounded."""
    here, rng = task.placement(q0), np.random.default_rng(seed)
    steps, tilts = rng.normal(size=(6, 3)), rng.normal(size=(6, 3))
    points = here.translation + RADIUS * steps / np.linalg.norm(steps, axis=1, keepdims=True)
    turns = Rotation.from_rotvec(
        TILT * tilts / np.linalg.norm(tilts, axis=1, keepdims=True)
    ).as_matrix()
    turns = turns @ here.rotation
    return rp.waypoints(np.vstack([points, points[:1]]), [*turns, turns[0]], blend=BLEND)
