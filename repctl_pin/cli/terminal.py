"""Terminal output: progress on one line, results as text or JSON, and stop signals.

``Span`` is a piece of text with its tone, which is shown as colour.
"""

from __future__ import annotations

import argparse
import json
import math
import shutil
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ..base.errors import printable
from ..show.text.coloured_text import Span, coloured, fitted, on_terminal


def progress(quiet: bool) -> Callable[[str], None]:
    """Make the callback that reports progress; it is called with the name of each new step.

    On a terminal, the callback rewrites one line. A text that begins with ``note: `` is a note: it
    gets a line of its own. If stderr is not a terminal, only notes are printed. With ``quiet``,
    nothing is printed.
    """
    shown = on_terminal(sys.stderr)

    def say(text: str) -> None:
        clear_line()
        if text.startswith("note: "):
            say_line(text)
        elif shown:  # a longer line would leave its first rows behind
            line = f"… {printable(text)}"[: shutil.get_terminal_size().columns - 1]
            print(line, end="", file=sys.stderr, flush=True)

    if quiet:
        return lambda text: None
    say("starting up")
    return say


def in_percent(say: Callable[[str], None]) -> Callable[[str, float], None]:
    """Make a callback (step, fraction) that passes texts such as ``fitting 40 %`` to ``say``.

    The fraction goes from 0 to 1; at 0 and 1, the text is the step alone.
    """
    return lambda step, fraction: say(
        f"{step} {100 * fraction:.0f} %" if 0 < fraction < 1 else step
    )


def say_line(text: str) -> None:
    """Print a message on stderr as one line, with control characters escaped.

    The line is wrapped only on a terminal, so that a log has one line per message.
    """
    line = printable(text)
    if on_terminal(sys.stderr):
        line = fitted(line, shutil.get_terminal_size().columns)
    print(line, file=sys.stderr, flush=True)


def clear_line() -> None:
    """Erase the progress line on the terminal, so that the next output begins on an empty line."""
    if on_terminal(sys.stderr):
        print("\r\x1b[2K", end="", file=sys.stderr, flush=True)


def report(
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
        print(_as_json(found, indent=2))
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


def _as_json(value: Any, indent: int | None = None) -> str:
    """Format a value as JSON, with unprintable characters escaped, which could control a terminal.

    Non-ASCII letters stay readable; ``indent`` is as in ``json.dumps``.
    """
    text = json.dumps(_plain(value), indent=indent, ensure_ascii=False, allow_nan=False)
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


@contextmanager
def until_stopped() -> Iterator[threading.Event]:
    """Yield an event that Ctrl-C, SIGTERM and SIGHUP set, for a command that runs until then.

    The earlier handlers are restored at the end of the block. Use it only in the main thread,
    because only that thread receives signals.
    """
    stop = threading.Event()
    numbers = [signal.SIGINT, signal.SIGTERM]
    # ignored under nohup
    if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
        numbers.append(signal.SIGHUP)
    before = {number: signal.signal(number, lambda *_: stop.set()) for number in numbers}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
