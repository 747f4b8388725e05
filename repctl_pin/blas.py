"""Limit of BLAS to one thread, which is faster than two for the matrices of this package."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from threadpoolctl import threadpool_limits

_lock = threading.Lock()
_working = 0
_limits: Any = None


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limit BLAS to one thread, also usable as a decorator.

    The last thread to exit restores the previous limit."""
    global _working, _limits
    with _lock:
        if _working == 0:
            _limits = threadpool_limits(1, user_api="blas")
        _working += 1
    try:
        yield
    finally:
        with _lock:
            _working -= 1
            if _working == 0:
                _limits.restore_original_limits()
