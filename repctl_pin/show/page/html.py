"""Self-contained HTML page: meshcat's viewer, the recorded scene and the motion.

The page asks nothing of a network or a server. What is large goes in as base64 of gzip, and the
browser's own ``DecompressionStream`` takes it out again.

At the browser's console, and for tests: ``repctl.ready``, ``repctl.seek(cycles)``,
``repctl.play()``, ``repctl.pause()``,
``repctl.set("traces" or "ghost" or "fan" or "drift", bool)``, ``repctl.drift(arm, shape)``,
``repctl.picture()`` (a PNG's data URL), ``repctl.seen()`` (the same of the page),
``repctl.record(seconds)`` (a film), ``repctl.still()`` (a canvas, for print),
``repctl.pane(arm)`` (where it is in the picture), ``repctl.errors``. Times are in shown cycles:
1.25 is a quarter into the second. An address that ends in ``#paused`` does not start by itself."""

from __future__ import annotations

import base64
import gzip
import json
import re
import struct
from collections.abc import Sequence
from functools import cache
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from ...errors import RepctlError
from ..text.headline import Headline

SCRIPTS = (
    *("dom", "numbers", "viewer", "eye", "panes", "arm", "traces", "stage"),
    *("callouts", "chart", "clock", "address", "controls", "paper", "save"),
    *("live", "console", "main"),
)
"""The page's modules, each after those that it imports."""


def page(
    scene: dict[str, Any], commands: Sequence[bytes], motion: bytes, headline: Headline
) -> str:
    """Write the animation page.

    Parameters
    ----------
    scene
        What the page's own script reads, its title and caption among it; plain Python types.
    commands
        meshcat commands, msgpack each.
    motion
        float32 numbers, little-endian, laid out as ``scene`` says.
    headline
        What stands above it all.
    """
    return render(
        "page.html",
        style="page.css",
        title=scene["title"],
        caption=scene["caption"],
        headline=headline,
        scene=scene,
        data=Markup(as_script(scene)),
        viewer=Markup(_viewer()),
        commands=Markup(pack(b"".join(struct.pack("<I", len(c)) + c for c in commands))),
        motion=Markup(pack(motion)),
        script=Markup(_script()),
    )


def render(template: str, **parts: Any) -> str:
    """Fill in a template of ``assets``; text is escaped, and :class:`markupsafe.Markup` is not."""
    return _templates().get_template(template).render(parts)


@cache
def _templates() -> Environment:
    folder = files(__package__) / "assets"
    made = Environment(
        loader=FileSystemLoader(str(folder)), autoescape=True, undefined=StrictUndefined
    )
    made.globals["asset"] = lambda name: Markup((folder / name).read_text("utf-8"))
    return made


@cache
def _script() -> str:
    """Join the page's modules into one script with one scope."""
    folder = files(__package__) / "assets" / "scripts"
    texts = [(folder / f"{name}.js").read_text("utf-8") for name in SCRIPTS]
    return '"use strict";\n' + re.sub(r"(?m)^(import .*\n|export )", "", "\n".join(texts))


def as_script(value: Any) -> str:
    """Write JSON that is safe inside a script element: it cannot end the element."""
    text = json.dumps(value, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")


def pack(data: bytes) -> str:
    """Compress bytes and write them as base64."""
    return base64.b64encode(gzip.compress(data, 6, mtime=0)).decode("ascii")


@cache
def _viewer() -> str:
    """Compress meshcat's viewer, as its package ships it."""
    spec = find_spec("meshcat")
    if spec is None or spec.origin is None:
        raise RepctlError("meshcat is not installed; pip install 'meshcat>=0.3.2'")
    bundle = Path(spec.origin).parent / "viewer" / "dist" / "main.min.js"
    if not bundle.is_file():
        raise RepctlError(
            f"this meshcat has no {bundle.name}; pip install --force-reinstall 'meshcat>=0.3.2'"
        )
    return pack(bundle.read_bytes())
