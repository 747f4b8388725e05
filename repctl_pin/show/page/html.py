"""One HTML page that holds everything it needs: meshcat's viewer, the recorded scene, the motion.

The page asks nothing of a network or a server. What is large goes in as base64 of gzip, and the browser's
own ``DecompressionStream`` takes it out again.

At the browser's console, and for tests: ``repctl.ready``, ``repctl.seek(cycles)``, ``repctl.play()``,
``repctl.pause()``, ``repctl.setTraces(bool)``, ``repctl.setGhost(bool)``, ``repctl.setDrift(bool)``,
``repctl.drift(arm, shape)``, ``repctl.picture()`` (a PNG's data URL), ``repctl.errors``. Times are in shown
cycles: 1.25 is a quarter into the second. An address that ends in ``#paused`` does not start by itself.
"""

from __future__ import annotations

import base64
import gzip
import html
import json
import re
import struct
from collections.abc import Sequence
from functools import cache
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from ...errors import RepctlError

SCRIPTS = ("view.js", "arm.js", "traces.js", "cards.js", "player.js")


def page(scene: dict[str, Any], commands: Sequence[bytes], motion: bytes, *, title: str) -> str:
    """Write the page.

    Parameters
    ----------
    scene
        What the page's own script reads; plain Python types.
    commands
        meshcat commands, msgpack each.
    motion
        float32 numbers, little-endian, laid out as ``scene`` says.
    title
        Of the page; any text.
    """
    folder = files(__package__) / "assets"
    parts = {
        "TITLE": html.escape(title),
        "STYLE": (folder / "style.css").read_text("utf-8"),
        "SCRIPT": "\n".join((folder / name).read_text("utf-8") for name in SCRIPTS),
        "SCENE": as_script(scene),
        "VIEWER": _viewer(),
        "COMMANDS": pack(b"".join(struct.pack("<I", len(c)) + c for c in commands)),
        "MOTION": pack(motion),
    }
    template = (folder / "page.html").read_text("utf-8")
    return re.sub(r"\{\{(\w+)\}\}", lambda found: parts[found[1]], template)


def as_script(value: Any) -> str:
    """Write JSON that is safe inside a script element: no text in it can end the element."""
    text = json.dumps(value, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")


def pack(data: bytes) -> str:
    """Compress bytes and write them as base64."""
    return base64.b64encode(gzip.compress(data, 6, mtime=0)).decode("ascii")


def unpack(text: str) -> bytes:
    """Undo :func:`pack`."""
    return gzip.decompress(base64.b64decode(text))


def split(stream: bytes) -> list[bytes]:
    """Cut a page's command stream into its commands."""
    commands, start = [], 0
    while start < len(stream):
        (length,) = struct.unpack_from("<I", stream, start)
        commands.append(stream[start + 4 : start + 4 + length])
        start += 4 + length
    return commands


@cache
def _viewer() -> str:
    """meshcat's viewer as its package ships it."""
    spec = find_spec("meshcat")
    if spec is None or spec.origin is None:
        raise RepctlError("meshcat is not installed; pip install 'meshcat>=0.3.2'")
    bundle = Path(spec.origin).parent / "viewer" / "dist" / "main.min.js"
    if not bundle.is_file():
        raise RepctlError(f"this meshcat has no {bundle.name}; pip install --force-reinstall 'meshcat>=0.3.2'")
    return pack(bundle.read_bytes())
