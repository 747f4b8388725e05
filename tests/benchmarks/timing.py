"""The least time of some runs."""

from __future__ import annotations

import time
from collections.abc import Callable


def seconds(
    work: Callable[[], object], repeats: int = 3, clock: Callable[[], float] = time.perf_counter
) -> float:
    """Run a few times; the least time, s. ``time.thread_time`` leaves out what others do on the
    machine meanwhile."""
    times = []
    for _ in range(repeats):
        start = clock()
        work()
        times.append(clock() - start)
    return min(times)
