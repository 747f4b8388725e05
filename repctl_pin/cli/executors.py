"""Executors of a design: none, processes of this machine, or a Dask cluster."""

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
"""Environment variables that limit the threads of BLAS libraries, which read them when loaded."""


@contextmanager
def executor_of(options: Options) -> Iterator[Any]:
    """Open the executor of ``--processes`` or ``--dask``, and close it later; None without them."""
    if options.dask is not None:
        try:
            from distributed import Client
        except ImportError:
            remedy = "run `pip install 'dask[distributed]'`"
            raise InputError(
                "--dask requires Dask, which is not installed", remedy=remedy
            ) from None
        try:
            client = Client(options.dask, timeout=10)
        except (OSError, ValueError, TimeoutError) as error:
            raise InputError(
                f"{options.dask}: no scheduler answers there ({error})",
                argument="--dask",
            ) from None
        with client:
            yield client
    elif options.processes > 1:
        import multiprocessing
        import os
        from concurrent.futures import ProcessPoolExecutor

        # one BLAS thread per worker: more would slow it down
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
    """Start the workers with SIGINT blocked, so that only the parent process handles Ctrl-C."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        for _ in range(processes):
            pool.submit(int)
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
