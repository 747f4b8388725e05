"""Scratch memory for each thread: one object may be called from any number of them."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")


class PerThread(threading.local, Generic[T]):
    """Make something anew in each thread that asks for it.

    Parameters
    ----------
    make
        What makes it.

    Attributes
    ----------
    own
        What was made in this thread.
    """

    def __init__(self, make: Callable[[], T]) -> None:
        self.own = make()
