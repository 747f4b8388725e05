"""What the work of a design is spread over: nothing, processes of this machine, or a cluster."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from ..errors import InputError

BLAS_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Where the libraries of linear algebra read how many threads they may use, when they are loaded."""


@contextmanager
def executor_of(options: argparse.Namespace) -> Iterator[Any]:
    """Open what ``--processes`` or ``--dask`` asks for, and close it."""
    if options.dask is not None:
        try:
            from distributed import Client
        except ImportError:
            raise InputError("--dask needs Dask: pip install 'dask[distributed]'") from None
        try:
            client = Client(options.dask, timeout=10)
        except (OSError, ValueError, TimeoutError) as error:
            raise InputError(f"--dask {options.dask}: no scheduler answers there ({error})") from None
        with client:
            yield client
    elif options.processes > 1:
        import multiprocessing
        import os
        from concurrent.futures import ProcessPoolExecutor

        # each worker does its own share: BLAS threads on top would only slow it down
        os.environ.update(dict.fromkeys(BLAS_THREADS, "1"))
        context = multiprocessing.get_context("spawn")
        pool = ProcessPoolExecutor(options.processes, mp_context=context, initializer=_ignore_interrupt)
        try:
            yield pool
        finally:
            pool.shutdown(wait=True, cancel_futures=True)
    else:
        yield None


def _ignore_interrupt() -> None:
    """Leave Ctrl-C to the process that started the workers."""
    import signal

    signal.signal(signal.SIGINT, signal.SIG_IGN)
