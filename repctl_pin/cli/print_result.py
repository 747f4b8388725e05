"""Result of a command on stdout: as JSON, or as text and the names of the written files.

``Span`` is a piece of text with its tone, which is shown as colour.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from ..base.errors import printable
from ..show.text.coloured_text import Span, coloured
from .terminal import clear_line


def print_result(
    options: argparse.Namespace,
    result: Callable[[], Any],
    text: Callable[[], str | list[Span]] = str,
    files: Sequence[str | Path] | None = None,
) -> int:
    """Print the result of a command as JSON, or as text and the names of the files; return 0.

    Only the requested form is made: JSON if ``options.json``, nothing if ``options.quiet``, else
    text.

    Parameters
    ----------
    options
        Options with ``json`` and ``quiet``.
    result, text
        Functions that return the JSON value, and the text: a str, or a list of spans, which are
        pieces of text with a colour.
    files
        Written files; None for a command that writes none.
    """
    clear_line()
    if options.json:
        found = result() if files is None else result() | {"files": [str(file) for file in files]}
        print(_as_json(found))
    elif not options.quiet:
        wrote = [printable(f"wrote {file}") for file in files or ()]
        said = text()
        shown = coloured([Span(said)] if isinstance(said, str) else said)
        print(*filter(None, [shown, *wrote]), sep="\n")
    return 0


def page_lines(files: Sequence[Path]) -> list[str]:
    """Make two lines of text: which page to open, and which other files were written.

    The page is the first of ``files``, and the others are in its folder.
    """
    page, *others = files
    names = ", ".join(file.name for file in others)
    return [f"open   {page}", f"wrote  {names} beside it"]


def _as_json(value: Any) -> str:
    """Format a value as JSON, with unprintable characters escaped, which could control a terminal.

    Non-ASCII letters stay readable.
    """
    text = json.dumps(_plain(value), indent=2, ensure_ascii=False, allow_nan=False)
    return "".join(c if c.isprintable() or c == "\n" else json.dumps(c)[1:-1] for c in text)


def _plain(value: Any) -> Any:
    """Convert a value for JSON: arrays to lists, and infinity and NaN to None, which JSON lacks."""
    if isinstance(value, dict):
        return {key: _plain(part) for key, part in value.items()}
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, (list, tuple)):
        return [_plain(part) for part in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
