"""Text wrapped to the width of the terminal, and its colours.

``Span`` is a piece of text with its tone, which is shown as colour.
"""

from __future__ import annotations

import os
import re
import shutil
import sys
import textwrap
from collections.abc import Iterable, Sequence
from typing import NamedTuple, TextIO

from ...base.errors import printable

COLUMNS = 80
"""Width, in columns, of text that does not go to a terminal."""

_COLOURS = {"bad": "31", "good": "32"}
"""ANSI colour code (Select Graphic Rendition) of each tone: red and green."""


class Span(NamedTuple):
    """Piece of text, with its tone, its exact value and the controller to which it belongs.

    ``tone`` is ``bad``, ``good``, ``near`` (a small body distance, or bodies that are not checked
    for collisions) or empty. A page shows every tone as a colour, a terminal only ``bad`` and
    ``good``. ``exact`` is the value that a rounded text stands for, such as
    ``elbow_link: 0.0321 m``, or empty. ``whose`` chooses a colour that a page shows instead of the
    tone: that of the controller ``usual`` or ``repeatable``, or ``ink``, that of plain text. If
    ``whose`` is empty, the tone is shown.
    """

    text: str
    tone: str = ""
    exact: str = ""
    whose: str = ""


def capital(text: str) -> str:
    """Capitalise the first letter of a text; all others are unchanged."""
    return text[:1].upper() + text[1:]


def noted(text: str) -> str:
    """Put ``note: `` before a note; a warning, which begins with ``! ``, is unchanged."""
    return text if text.startswith("! ") else f"note: {text}"


def coloured(spans: Iterable[Span]) -> str:
    """Join pieces of text; on a terminal, their tones become colours.

    ``bad`` is red and ``good`` green. The environment variable ``NO_COLOR``, and ``TERM=dumb``,
    switch colours off. Control sequences within a piece are escaped.
    """
    plain = os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb"
    colours = {} if plain or not on_terminal(sys.stdout) else _COLOURS
    return "".join(
        f"\x1b[{colours[span.tone]}m{printable(span.text, lines=True)}\x1b[0m"
        if span.tone in colours
        else printable(span.text, lines=True)
        for span in spans
    )


def wrapped(spans: Sequence[Span]) -> list[Span]:
    """Wrap a sentence made of pieces to the width of the terminal, and return the pieces.

    A piece keeps its tone even if it contains a line break. A no-break space keeps two words on one
    line.
    """
    text = "".join(span.text for span in spans).rstrip(" ")
    letters = list(text)
    begin = 0
    last = 0
    width = terminal_width()
    for i, letter in enumerate(f"{text} "):
        if letter == " ":
            if i - begin > width and last > begin:
                letters[last], begin = "\n", last + 1
            last = i
    lines = "".join(letters).replace("\u00a0", " ")
    at = 0
    out = []
    for span in spans:
        out.append(span._replace(text=lines[at : at + len(span.text)]))
        at += len(span.text)
    return out


def terminal_width() -> int:
    """Return the number of columns of the terminal; 80 if stdout is not a terminal."""
    return shutil.get_terminal_size().columns if on_terminal(sys.stdout) else COLUMNS


def on_terminal(stream: TextIO | None) -> bool:
    """Check whether a stream is a terminal; False for None, or if the stream is closed."""
    return stream is not None and not stream.closed and stream.isatty()


def fitted(text: str, width: int | None = None) -> str:
    """Wrap lines that are wider than ``width`` characters; by default, than the terminal.

    After a label such as ``note: `` or ``! ``, continuation lines are indented to the start of the
    text.
    """
    columns = width or terminal_width()
    return "\n".join(part for line in text.split("\n") for part in _wrapped(line, columns))


def _wrapped(line: str, width: int) -> list[str]:
    """Wrap one line to a width, in characters; a line with an overlong word stays whole.

    Such a word is usually a path, which the user wants to copy.
    """
    if len(line) <= width or max(map(len, line.split())) > width:  # a path, to be copied
        return [line]
    label = re.match(r"\s*\S+(?: \S+){0,4} {2,}|note: |! |\s*", line)
    hang = label.end() if label and label.end() <= width // 2 else 2
    return textwrap.wrap(line, width, subsequent_indent=" " * hang, break_on_hyphens=False)
