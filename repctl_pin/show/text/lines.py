"""Text wrapped to the width of the terminal."""

from __future__ import annotations

import re
import shutil
import sys
import textwrap
from typing import TextIO


def terminal_width() -> int | None:
    """Return the number of columns of the terminal; None if stdout is not a terminal."""
    return shutil.get_terminal_size().columns if on_terminal(sys.stdout) else None


def on_terminal(stream: TextIO | None) -> bool:
    """Check whether a stream is a terminal; it may be closed."""
    return stream is not None and not stream.closed and stream.isatty()


def fitted(text: str) -> str:
    """Wrap lines that are wider than the terminal; a pipe gets them unchanged.

    Text after a label is indented below itself.
    """
    width = terminal_width()
    return (
        text
        if width is None
        else "\n".join(part for line in text.split("\n") for part in _wrapped(line, width))
    )


def _wrapped(line: str, width: int) -> list[str]:
    if len(line) <= width or max(map(len, line.split())) > width:  # a path, to be copied
        return [line]
    label = re.match(r"\s*\S+(?: \S+){0,4} {2,}|note: |\s*", line)
    hang = label.end() if label and label.end() <= width // 2 else 2
    return textwrap.wrap(line, width, subsequent_indent=" " * hang, break_on_hyphens=False)
