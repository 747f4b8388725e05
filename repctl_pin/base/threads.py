"""One object per thread, such as scratch memory, and the limit of BLAS to one thread.

BLAS is the library of matrix operations that NumPy calls; BLAS starts threads of its own.
"""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache
from typing import Any, Generic, TypeVar

T = TypeVar("T")

BLAS_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Environment variables that limit the threads of BLAS libraries, which read them when loaded."""

_lock = threading.Lock()
_working = 0
_limits: Any = None


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limit BLAS to one thread, also usable as a decorator.

    One thread is faster than two for the small matrices of this package. The last thread to leave
    the context restores the previous limit.
    """
    global _working, _limits
    with _lock:
        if _working == 0:
            _limits = _blas_libraries(len(sys.modules)).limit(limits=1, user_api="blas")
        _working += 1
    try:
        yield
    finally:
        with _lock:
            _working -= 1
            if _working == 0:
                _limits.restore_original_limits()


@lru_cache(maxsize=1)
def _blas_libraries(modules: int) -> Any:
    """Find the BLAS libraries of this process; return threadpoolctl's controller of them.

    The search takes milliseconds, so its result is cached until ``modules``, the number of imported
    modules, changes: an import can load another library.
    """
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


class PerThread(threading.local, Generic[T]):
    """Container of a value that each thread, copy and process creates for itself on first use.

    Scratch memory of Pinocchio and of C cannot be shared between threads, nor pickled.

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
