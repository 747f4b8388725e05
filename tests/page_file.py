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
from repctl_pin.robot.visuals import Visuals as Visuals  # what a page draws

ORANGE, GREEN, BLUE, VERMILLION = "#E69F00", "#009E73", "#0072B2", "#D55E00"
COLOURS = {
    "pseudoinverse": VERMILLION,
    "posture": GREEN,
    "posture_off": ORANGE,
    "repeatable": BLUE,
}
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
    held = dict(
        re.findall(
            r'<script type="[\w/]+" id="([\w-]+)">(.*?)</script>', page, re.DOTALL
        )
    )
    commands = [
        umsgpack.unpackb(command) for command in split(unpack(held["commands"]))
    ]
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
        solids = self._bodies.geometryObjects
        self.names = [solid.name for solid in solids]
        self.links = [robot.model.frames[solid.parentFrame].name for solid in solids]
        self.points = [_corners(solid) for solid in solids]

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
        [np.cos(t) * np.cos(turn), np.cos(t) * np.sin(turn), np.full(24, np.sin(t))]
        for t in tilt
    ]
    upper = shape.radius * np.swapaxes(rims, 1, 2).reshape(-1, 3) + [0, 0, half]
    return np.vstack([upper, upper * [1, 1, -1]])
