"""The terminal: progress on one line of it, text as wide as it is, and its end."""

from __future__ import annotations

import argparse
import json
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ..errors import printable
from ..show.text.lines import on_terminal


def progress(quiet: bool) -> Callable[[str], None]:
    """Show what is being done on one line of a terminal, from now on; elsewhere only what begins
    with "note: "."""
    shown = on_terminal(sys.stderr)

    def say(text: str) -> None:
        clear_line()
        if text.startswith("note: "):
            print(printable(text), file=sys.stderr, flush=True)
        elif shown:
            print(f"… {printable(text)}", end="", file=sys.stderr, flush=True)

    if quiet:
        return lambda text: None
    say("starting up")
    return say


def clear_line() -> None:
    """Wipe the line of progress."""
    if on_terminal(sys.stderr):
        print("\r\x1b[2K", end="", file=sys.stderr, flush=True)


def report(
    options: argparse.Namespace,
    result: Callable[[], Any],
    text: Callable[[], str] = str,
    files: Sequence[str | Path] | None = None,
) -> int:
    """Print what a command found: as JSON, or as text and the files that it wrote; the command is
    done.

    Parameters
    ----------
    options
        ``json`` and ``quiet`` say which.
    result, text
        Make what a script reads, and what a person does.
    files
        What was written; None for a command that writes nothing.
    """
    clear_line()
    if options.json:
        found = result() if files is None else result() | {"files": [str(file) for file in files]}
        print(as_json(found, indent=2))
    elif not options.quiet:
        wrote = [printable(f"wrote {file}") for file in files or ()]
        print(*filter(None, [printable(text(), lines=True), *wrote]), sep="\n")
    return 0


def as_json(value: Any, indent: int | None = None) -> str:
    """Write JSON that any terminal can show: what does not print is escaped, which JSON reads as
    the same."""
    text = json.dumps(
        value, indent=indent, ensure_ascii=False, default=lambda array: array.tolist()
    )
    return "".join(c if c.isprintable() or c == "\n" else json.dumps(c)[1:-1] for c in text)


@contextmanager
def until_stopped() -> Iterator[threading.Event]:
    """Give an event that Ctrl-C, SIGTERM and the end of the terminal set, in the main thread."""
    stop = threading.Event()
    numbers = [signal.SIGINT, signal.SIGTERM]
    if (
        hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN
    ):  # ignored under nohup
        numbers.append(signal.SIGHUP)
    before = {number: signal.signal(number, lambda *_: stop.set()) for number in numbers}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
