"""Progress on a terminal, and nothing anywhere else."""

from __future__ import annotations

import sys
from collections.abc import Callable


def progress(quiet: bool) -> Callable[[str], None]:
    """Show what is being done on one line of a terminal; nothing anywhere else."""
    if quiet or not _on_terminal():
        return lambda text: None

    def say(text: str) -> None:
        clear_line()
        print(f"… {text}", end="", file=sys.stderr, flush=True)

    return say


def clear_line() -> None:
    """Wipe the line of progress."""
    if _on_terminal():
        print("\r\x1b[2K", end="", file=sys.stderr, flush=True)


def _on_terminal() -> bool:
    """Say whether a person sees stderr; it may be closed."""
    return sys.stderr is not None and sys.stderr.isatty()
