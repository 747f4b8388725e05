"""Objects per thread, such as memory, so that any number of threads can call one function."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")


class PerThread(threading.local, Generic[T]):
    """Value that is created once per thread, on first use, and again in a copy or another process.

    Parameters
    ----------
    make
        Function that creates the value.

    Attributes
    ----------
    own
        Value of the current thread.
    """

    own: T

    def __init__(self, make: Callable[[], T]) -> None:
        self._make = make

    def __getattr__(self, name: str) -> T:
        if name != "own":
            raise AttributeError(name)
        self.own = self._make()
        return self.own

    def __reduce__(self) -> tuple[type[PerThread[T]], tuple[Callable[[], T]]]:
        return PerThread, (self._make,)
