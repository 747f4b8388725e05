"""Self-contained HTML page with meshcat's viewer, the recorded scene and the motion.

The page needs no network and no server. Large data and the page's script are embedded as base64 of
gzip, which the browser unpacks with its ``DecompressionStream``.

For the browser's console and for tests, the page has an object ``repctl`` with these members:

- ``ready``: true once the scene is drawn; ``errors``: list of messages
- ``seek(cycles)``, ``play()``, ``pause()``
- ``set(what, bool)``: show or hide ``"traces"``, ``"ghost"``, ``"fan"`` or ``"drift"``
- ``drift(arm, name)``: displacement, m, of a named body from its ghost, and the body's colour
- ``picture()``, ``seen()``: data URL of a PNG of the scene, and of the page
- ``record(seconds)``: start a film; return the function ``stop`` and the promise ``done`` of a Blob
- ``csv()``: the motions of all arms, as text with the columns of a study's ``motion.csv``
- ``still()``: canvas element with a picture of the scene, for print
- ``pane(arm)``: position and size of an arm's pane, as fractions of the picture

Traces are the paths of frames and elbows. The ghost is the repeatable arm at the same time or,
without one, the same arm in cycle 1. The fan is the arm at the end of each shown cycle, and drift
is the colour of displaced bodies.

Times are in shown cycles: 1.25 is a quarter into the second cycle. A page whose address ends in
``#paused`` does not start by itself.

``Dialog`` is the texts of a page's dialog, by name. ``Headline`` is a sentence on the drift, and
notes on joint speed, limits and bodies.
"""

from __future__ import annotations

import base64
import gzip
import json
import re
import struct
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from ..._version import __version__
from ...base.arguments import Array
from ...base.errors import RepctlError
from ..text.headline import Headline
from ..text.numbers import metres

SCRIPTS = (
    *("dom", "numbers", "arm/viewer", "arm/bodies", "arm/outline", "arm/between_frames"),
    *("arm/arm", "arm/eye", "arm/traces"),
    *("arm/kinematics", "arm/potentials", "arm/law", "arm/cover", "arm/table"),
    *("chrome/panes", "chrome/chart", "chrome/room", "chrome/callouts", "chrome/clock"),
    *(
        "chrome/address",
        "chrome/controls",
        "chrome/paper",
        "chrome/save",
        "chrome/console",
        "chrome/plain",
        "chrome/head",
    ),
    *("own/run", "own/sentence", "own/loops", "own/workpiece", "own/hand_loops", "own/steps"),
    *("own/proof", "own/strokes", "own/presets", "own/link", "own/csv", "own/report"),
    *("own/led_arms", "own/self_motion", "own/elbow_slider"),
    *("own/rings", "own/hand_marks", "own/gesture", "own/own"),
    *("live/live", "stage", "main"),
)
"""The modules of the page's script, each after the modules that it imports."""

BEGIN = ("unpack",)
"""The modules of the script that unpacks and runs the page's script."""


class Dialog(NamedTuple):
    """Texts of a page's dialog, by name; backticks mark code.

    Attributes
    ----------
    uses, words : dict
        ``uses`` are texts on how to use the result, by heading. ``words`` are the meanings of the
        words of the page, by word.
    """

    uses: Mapping[str, str]
    words: Mapping[str, str]


def page(
    scene: dict[str, Any],
    commands: Sequence[bytes],
    motion: Sequence[Array],
    headline: Headline,
    dialog: Dialog | None = None,
) -> str:
    """Make the HTML of the animation page, with the viewer, the bodies and the motion inside.

    Parameters
    ----------
    scene
        Data for the page's script in plain Python types, as :func:`.scene.animation_page` makes
        them. The keys ``title`` and ``caption`` are also used here.
    commands
        Commands for meshcat's viewer, each encoded as msgpack, see :mod:`.meshes`.
    motion : sequence of (T, W) arrays
        Series of W numbers at T samples; T and W differ between arrays. In this order: for each arm
        its poses, tips, elbows and points, as :func:`.scene._describe` makes them; the weights of
        the page's own controller, if it has any; the paths; and the rows of the joint plot.
    headline
        Headline above the animation.
    dialog
        Texts of the page's dialog; by default those of a study.
    """
    numbers, unit = differences(motion)
    scene = {**scene, "series": [series.shape for series in motion], "resolution": unit}
    return render(
        "page.html",
        style="page.css",
        title=scene["title"],
        caption=scene["caption"],
        headline=headline,
        scene=scene,
        dialog=dialog,
        data=Markup(_as_script(scene)),
        viewer=Markup(_viewer()),
        commands=Markup(pack(b"".join(struct.pack("<I", len(c)) + c for c in commands))),
        motion=Markup(pack(numbers)),
        script=Markup(_code(_left_out(scene))),
        begin=Markup(_script(BEGIN)),
    )


def render(template: str, **parts: Any) -> str:
    """Fill in a template, a file of the folder ``assets``, with the given parts.

    Texts are escaped for HTML, unless they are :class:`markupsafe.Markup`.
    """
    return _templates().get_template(template).render(parts)


@cache
def _templates() -> Environment:
    """Create the Jinja environment of the page's templates; cached.

    A part that a template needs and does not get raises an error.
    """
    folder = files(__package__) / "assets"
    made = Environment(
        loader=FileSystemLoader(str(folder)), autoescape=True, undefined=StrictUndefined
    )
    made.globals["version"] = __version__
    made.globals["metres"] = metres
    made.globals["asset"] = lambda name: Markup(_dense((folder / name).read_text("utf-8")))
    return made


def _dense(style: str) -> str:
    """Remove from a style sheet the comments and white space that only human readers need."""
    return re.sub(r"/\*.*?\*/|\s*([{}])\s*|([;,:])\s+", r"\1\2", style, flags=re.DOTALL)


def _left_out(scene: dict[str, Any]) -> tuple[str, ...]:
    """List the JavaScript modules, by name, that a page with the data ``scene`` never calls."""
    live = () if scene["live"] else ("live/live",)
    return live if scene["cover"] else (*live, "arm/potentials", "arm/cover", "arm/table")


@cache
def _code(left_out: tuple[str, ...]) -> str:
    """Pack the page's script without the modules ``left_out``; cached."""
    return pack(_script(SCRIPTS, left_out).encode())


def _script(names: tuple[str, ...], left_out: tuple[str, ...] = ()) -> str:
    """Join JavaScript modules of the page, in the order of ``names``, into one script.

    The modules ``left_out`` are not included. All modules share one scope.
    """
    folder = files(__package__) / "assets" / "scripts"
    texts = [(folder / f"{name}.js").read_text("utf-8") for name in names if name not in left_out]
    return _joined(texts)


def _joined(texts: Sequence[str]) -> str:
    """Join JavaScript modules into one script.

    Comments, indentation, imports, exports, empty lines, and line breaks at brackets and after
    commas are removed. A line that begins with # keeps its line break: it is a directive of GLSL
    code in a string.
    """
    dropped = r"(?m)^(import [^;]*;\n|export |\s*//.*\n|\n| +)|(?<=[;,{})\]]) // .*$"
    script = re.sub(dropped, "", "\n".join(texts))
    breaks = r"(?m)(^#.*\n)|(?<=[{(\[,])\n(?!#)|,?\n(?=[})\]])"
    return '"use strict";\n' + re.sub(breaks, lambda found: found[1] or "", script)


def _as_script(value: Any) -> str:
    """Convert a value to JSON that is safe inside a script element of a page.

    A text that contains ``</script>`` cannot end the element.
    """
    text = json.dumps(value, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")


def pack(data: bytes) -> str:
    """Compress bytes by gzip and encode them as base64 text, for a page that contains its data."""
    return base64.b64encode(gzip.compress(data, 6, mtime=0)).decode("ascii")


def differences(motion: Sequence[Array]) -> tuple[bytes, float]:
    """Encode (T, W) arrays as bytes that compress well; return the bytes and the resolution.

    An array has W numbers for each of T samples. Numbers are rounded to multiples of the
    resolution: 1e-7, or more if a number exceeds 100. The third differences along the columns of
    each array, which are small for smooth motions, become integers of 32 bits, with the sign in the
    lowest bit. The lowest bytes of all integers are written first, the highest bytes last.
    """
    most = max((np.abs(series).max(initial=0.0) for series in motion), default=0.0)
    unit = max(1e-7, float(most) / 2**30)
    thirds = [
        np.diff(np.rint(series / unit), n=3, axis=0, prepend=np.zeros((3, len(series.T))))
        for series in motion
    ]
    d = np.concatenate([third.T.ravel() for third in thirds]).astype(np.int64)
    d = d.astype("<i4")  # modulo 2³², as the sums that undo it
    planes = ((d << 1) ^ (d >> 31)).view(np.uint8).reshape(-1, 4).T
    return planes.tobytes(), unit


@cache
def _viewer() -> str:
    """Compress the script of the installed meshcat viewer, and encode it as base64.

    The page contains it, so that it needs no network. RepctlError is raised if the installed
    meshcat lacks the script.
    """
    spec = find_spec("meshcat")
    if spec is None or spec.origin is None:
        raise RepctlError(
            "a page requires meshcat, which is not installed; run `pip install 'meshcat>=0.3.2'`"
        )
    bundle = Path(spec.origin).parent / "viewer" / "dist" / "main.min.js"
    if not bundle.is_file():
        raise RepctlError(
            f"the installed meshcat lacks {bundle.name}; "
            "run `pip install --force-reinstall 'meshcat>=0.3.2'`"
        )
    return pack(bundle.read_bytes())
