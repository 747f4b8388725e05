"""Results that many tests look at are computed once in a run of the tests, whose workers share
them."""

from __future__ import annotations

import fcntl
import os
import pickle
from collections.abc import Callable
from functools import cache, wraps
from pathlib import Path
from typing import Any, TypeVar

import repctl_pin as rp

Function = TypeVar("Function", bound=Callable[..., Any])

folder: list[Path] = []
"""The folder of this run; empty in a run of one process, or before it has begun."""


def made_once(file: Path, make: Callable[[], bytes]) -> Path:
    """A file of this run, whose content the first worker that needs it makes; the others wait."""
    with file.with_suffix(".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # until it is closed, also by a death
        if not file.exists():
            draft = file.with_name(f"{os.getpid()}-{file.name}")
            draft.write_bytes(make())
            draft.replace(file)  # whole, whoever reads it
    return file


def shared(compute: Function) -> Function:
    """Compute once for each argument; every call returns a copy of its own.

    The first worker that needs a result computes and writes it; the others wait, and read it."""

    @cache
    def pickled(given: tuple[Any, ...]) -> bytes:
        name = "-".join(map(str, (compute.__module__, compute.__name__, *given))) + ".pickle"
        file = folder[0] / name if folder else None
        if file is None:
            return pickle.dumps(compute(*given))
        return made_once(file, lambda: pickle.dumps(compute(*given))).read_bytes()

    @wraps(compute)
    def found(*given: Any) -> Any:
        return pickle.loads(pickled(given))

    return found  # type: ignore[return-value]


@shared
def study_of(name: str, cycles: int = 3, steps: int = 60) -> rp.Study:
    """A study whose design is of degree 1; only for rooms whose choices are quick."""
    return rp.study(name, cycles=cycles, steps=steps, degree=1)
