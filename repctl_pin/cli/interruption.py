"""Ctrl-C: one line and exit code 130, whenever it comes."""

from __future__ import annotations

import os
import signal
import sys
from types import FrameType

from .terminal import clear_line

CODE = 130


def heed_interrupts() -> None:
    """Let Ctrl-C raise ``KeyboardInterrupt``, but leave at once where that would be lost.

    Libraries try imports and catch whatever comes of them; an exception in a finaliser is dropped. Nothing has
    been written there, so the process may end as it is.
    """
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # else somebody wants it otherwise
        signal.signal(signal.SIGINT, _interrupted)


def say_interrupted() -> int:
    """Say the line, and return the exit code."""
    clear_line()
    print("repctl: interrupted; nothing half-written was left", file=sys.stderr, flush=True)
    return CODE


def _interrupted(number: int, frame: FrameType | None) -> None:
    names, importing = set(), False
    while frame is not None:
        names.add(frame.f_code.co_name)
        importing = importing or "importlib" in frame.f_code.co_filename
        frame = frame.f_back
    processes = sys.modules.get("multiprocessing")
    alone = processes is None or not processes.active_children()
    if (importing or "__del__" in names) and "write_whole" not in names and alone:
        os._exit(say_interrupted())
    raise KeyboardInterrupt
