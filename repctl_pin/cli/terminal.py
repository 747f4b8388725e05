"""Progress and messages of a command on one line of the terminal, and stop signals."""

from __future__ import annotations

import shutil
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from ..base.errors import printable
from ..show.text.coloured_text import fitted, on_terminal


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


@contextmanager
def until_stopped() -> Iterator[threading.Event]:
    """Yield an event that Ctrl-C, SIGTERM and SIGHUP set, for a command that runs until stopped.

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
