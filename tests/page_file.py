"""Read an animation page back: its scene, its meshcat commands and its numbers."""

from __future__ import annotations

import base64
import gzip
import json
import re
import struct
from typing import Any

import coal
import numpy as np
import pinocchio as pin
import umsgpack

import repctl_pin as rp
from repctl_pin.model.visuals import Visuals as Visuals  # what a page draws

ORANGE, GREEN, BLUE, VERMILLION = "#E69F00", "#009E73", "#0072B2", "#D55E00"
COLOURS = {"pseudoinverse": VERMILLION, "posture": GREEN, "posture_off": ORANGE, "repeatable": BLUE}
"""Okabe and Ito's colours, by the keys of a study's rows."""


def unpack(text: str) -> bytes:
    """Base64 of gzip, as the page's script undoes it."""
    return gzip.decompress(base64.b64decode(text))


def split(stream: bytes) -> list[bytes]:
    """A page's command stream, cut into its commands."""
    commands, start = [], 0
    while start < len(stream):
        (length,) = struct.unpack_from("<I", stream, start)
        commands.append(stream[start + 4 : start + 4 + length])
        start += 4 + length
    return commands


def read(page: str) -> tuple[dict[str, Any], list[dict[str, Any]], np.ndarray]:
    """Read a page back: its scene, its meshcat commands, its numbers."""
    held = dict(re.findall(r'<script type="[\w/]+" id="([\w-]+)">(.*?)</script>', page, re.DOTALL))
    commands = [umsgpack.unpackb(command) for command in split(unpack(held["commands"]))]
    assert len(unpack(held["viewer-code"])) > 500_000  # meshcat's viewer is there
    scene = json.loads(held["scene"])
    numbers = summed(unpack(held["motion"]), scene["series"], scene["resolution"])
    return scene, commands, numbers


def summed(data: bytes, series: list[list[int]], resolution: float) -> np.ndarray:
    """Undo the third differences of a page's numbers, as the page's script does."""
    bits = np.ascontiguousarray(np.frombuffer(data, np.uint8).reshape(4, -1).T)
    bits = bits.view("<u4").ravel().astype(np.int64)
    thirds, at, out = (bits >> 1) ^ -(bits & 1), 0, [np.zeros(0)]
    for rows, columns in series:
        one = thirds[at : at + rows * columns].reshape(columns, rows).T
        for _ in range(3):
            one = one.cumsum(axis=0)
        out.append(one.astype(np.int32).ravel() * resolution)
        at += rows * columns
    return np.concatenate(out)


class Drawn:
    """The visual bodies of a robot's URDF, as Pinocchio reads them.

    ``links`` are their links, ``names`` those of the bodies as a page has them, and ``points``
    (P, 3) each the corners of their meshes or boxes, in their own frames and scaled."""

    def __init__(self, robot: rp.Robot) -> None:
        self.robot = robot
        self._bodies = pin.buildGeomFromUrdf(
            robot.model,
            str(robot.description.path),
            pin.GeometryType.VISUAL,
            None,
            [str(folder) for folder in robot.package_dirs],
        )
        self.solids = list(self._bodies.geometryObjects)
        self.names = [solid.name for solid in self.solids]
        frames = robot.model.frames
        self.links = [frames[solid.parentFrame].name for solid in self.solids]
        self.points = [_corners(solid) for solid in self.solids]

    def placements(self, Q: np.ndarray) -> np.ndarray:
        """Placements (T, S, 4, 4) in the world at configurations (T, nq) of the whole robot."""
        model, data = self.robot.model, self.robot.model.createData()
        placed = self._bodies.createData()
        rows = []
        for q in self.robot.coupling.joints(Q):
            pin.updateGeometryPlacements(model, data, self._bodies, placed, q)
            rows.append([M.homogeneous for M in placed.oMg])
        return np.array(rows)

    def moved(self, now: np.ndarray, then: np.ndarray) -> np.ndarray:
        """How far each body's farthest corner is at one configuration from where it is at another:
        (S,), m."""
        ends = self.placements(np.array([now, then]))
        return np.array(
            [
                np.linalg.norm(np.c_[p, np.ones(len(p))] @ D[:3].T, axis=1).max()
                for p, D in zip(self.points, ends[0] - ends[1], strict=True)
            ]
        )


def _corners(solid: pin.GeometryObject) -> np.ndarray:
    """Corners (P, 3) of a mesh or a box, or of the polytope by which a page measures round bodies:
    rims of 24 corners, at seven heights on a half sphere."""
    shape = solid.geometry
    if isinstance(shape, coal.BVHModelBase):
        return shape.vertices()
    if isinstance(shape, coal.Box):
        return (np.indices((2, 2, 2)).reshape(3, -1).T * 2 - 1) * shape.halfSide
    turn, tilt = 2 * np.pi * np.arange(24) / 24, np.zeros(1)
    half = getattr(shape, "halfLength", 0.0)
    if isinstance(shape, coal.Sphere):
        tilt = np.radians(np.arange(0, 91, 15))
    else:
        assert isinstance(shape, coal.Cylinder), shape
    rims = [
        [np.cos(t) * np.cos(turn), np.cos(t) * np.sin(turn), np.full(24, np.sin(t))] for t in tilt
    ]
    upper = shape.radius * np.swapaxes(rims, 1, 2).reshape(-1, 3) + [0, 0, half]
    return np.vstack([upper, upper * [1, 1, -1]])


class Pane:
    """What a page holds of one arm: ``names`` of its bodies, their placements (T, S, 4, 4) at the
    shown samples, ``tip`` and ``elbow`` (T, K, 3) of its chains, ``origin`` (T, 3) of what is
    violated, and the ``points`` of each moving body by which the page measures."""

    def __init__(self, scene: dict[str, Any], arm: dict[str, Any], take: Any) -> None:
        samples = len(scene["cycles"]) * scene["perCycle"]
        shapes = arm["shapes"]
        self.names = [shape["name"] for shape in shapes]
        moving = [k for k, shape in enumerate(shapes) if shape["pose"] is None]
        poses = np.empty((samples, len(shapes), 7))
        poses[:, moving] = take(samples, len(moving), 7)
        for k, shape in enumerate(shapes):
            if shape["pose"] is not None:
                poses[:, k] = shape["pose"]
        self.placements = matrices(poses)
        self.tip, self.elbow = (take(samples, arm["chains"], 3) for _ in range(2))
        self.origin = take(samples, 3) if arm["broken"] else None
        self.points = {self.names[k]: take(shapes[k]["points"], 3) for k in moving}

    def of(self, drawn: Drawn) -> np.ndarray:
        """The placements in the order of another reader's bodies."""
        return self.placements[:, [self.names.index(name) for name in drawn.names]]


def matrices(poses: np.ndarray) -> np.ndarray:
    """Poses (T, M, 7) as matrices (T, M, 4, 4), by Pinocchio."""
    return np.array([[pin.XYZQUATToSE3(p).homogeneous for p in row] for row in poses.astype(float)])


def panes(scene: dict[str, Any], numbers: np.ndarray) -> tuple[list[Pane], list[np.ndarray]]:
    """What the numbers of a page are: its arms, and its paths (P, 3)."""
    at = 0

    def take(*shape: int) -> np.ndarray:
        nonlocal at
        part, at = numbers[at : at + int(np.prod(shape))], at + int(np.prod(shape))
        return part.reshape(shape)

    arms = [Pane(scene, arm, take) for arm in scene["arms"]]
    paths = [take(count, 3) for count in scene["paths"]]
    if joints := scene["joints"]:
        samples = len(scene["cycles"]) * joints["perCycle"]
        for arm in arms:
            arm.joints = take(samples, len(joints["names"])) / joints["scale"]
    assert at == len(numbers)
    return arms, paths


def circling(
    task: rp.Task, q0: Any, *, radius: float, steps: int, other: str = "repeatable"
) -> dict[str, rp.Motion]:
    """J⁺ for two circles of 2 s, and beside it a control that closes: the extended Jacobian with
    constant rows."""
    path = rp.circle(task, q0, radius)
    N0 = np.linalg.svd(task.jacobian(q0))[2][task.m :]
    closing = rp.CustomInverse(
        task, lambda q: np.linalg.inv(np.vstack([task.jacobian(q), N0]))[:, : task.m]
    )
    controls = {"J⁺": rp.Pseudoinverse(task), other: closing}
    return {
        name: rp.follow(control, path, q0, cycles=2, steps=steps, period=2.0)
        for name, control in controls.items()
    }
