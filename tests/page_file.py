"""Read an animation page back: its scene, its meshcat commands and its numbers."""

from __future__ import annotations

import base64
import gzip
import json
import re
import struct
from typing import Any

import numpy as np
import umsgpack

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
