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
    return json.loads(held["scene"]), commands, np.frombuffer(unpack(held["motion"]), "<f4")
