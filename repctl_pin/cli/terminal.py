"""The terminal: progress on one line of it, text as wide as it is, and its end."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from ..show.text.lines import fitted, on_terminal


def progress(quiet: bool) -> Callable[[str], None]:
    """Show what is being done on one line of a terminal; nothing anywhere else."""
    if quiet or not on_terminal(sys.stderr):
        return lambda text: None

    def say(text: str) -> None:
        clear_line()
        print(f"… {text}", end="", file=sys.stderr, flush=True)

    return say


def clear_line() -> None:
    """Wipe the line of progress."""
    if on_terminal(sys.stderr):
        print("\r\x1b[2K", end="", file=sys.stderr, flush=True)


def tell(text: str) -> None:
    """Print text, wrapped where a terminal is too narrow for it."""
    print(fitted(text))


@contextmanager
def until_stopped() -> Iterator[threading.Event]:
    """Give an event that Ctrl-C, SIGTERM and the end of the terminal set, in the main thread."""
    stop = threading.Event()
    numbers = [signal.SIGINT, signal.SIGTERM]
    if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:  # ignored under nohup
        numbers.append(signal.SIGHUP)
    before = {number: signal.signal(number, lambda *_: stop.set()) for number in numbers}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
