"""Progress on a terminal, and nothing anywhere else."""

from __future__ import annotations

import sys
from collections.abc import Callable

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
