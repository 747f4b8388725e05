"""What the work of a design is spread over: nothing, processes of this machine, or a cluster."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from .given import Options

if TYPE_CHECKING:
    from concurrent.futures import Executor

BLAS_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Where the libraries of linear algebra read how many threads they may use, when they are
loaded."""


@contextmanager
def executor_of(options: Options) -> Iterator[Any]:
    """Open what ``--processes`` or ``--dask`` asks for, and close it."""
    if options.dask is not None:
        try:
            from distributed import Client
        except ImportError:
            raise InputError("--dask needs Dask: pip install 'dask[distributed]'") from None
        try:
            client = Client(options.dask, timeout=10)
        except (OSError, ValueError, TimeoutError) as error:
            raise InputError(
                f"--dask {options.dask}: no scheduler answers there ({error})"
            ) from None
        with client:
            yield client
    elif options.processes > 1:
        import multiprocessing
        import os
        from concurrent.futures import ProcessPoolExecutor

        # each worker does its own share: BLAS threads on top would only slow it down
        os.environ.update(dict.fromkeys(BLAS_THREADS, "1"))
        pool = ProcessPoolExecutor(
            options.processes, mp_context=multiprocessing.get_context("spawn")
        )
        try:
            _start(pool, options.processes)
            yield pool
        finally:
            pool.shutdown(wait=True, cancel_futures=True)
    else:
        yield None


def _start(pool: Executor, processes: int) -> None:
    """Start the workers without Ctrl-C, from their first moment on: it is for the process that
    starts them."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        for _ in range(processes):
            pool.submit(int)
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
