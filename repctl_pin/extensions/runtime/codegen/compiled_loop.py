"""Control step of a repeatable inverse in compiled C, called from Python."""

from __future__ import annotations

import ctypes
import warnings
from contextlib import suppress

import numpy as np

from ....arguments import Array
from ....c_library import VECTOR_FLAGS, NoCompilerError, loaded_library
from ....model.task import Task
from ....strategies.repeatable import RepeatableInverse
from ...cells.function import InverseFunction
from .cell_function import LANES
from .source import write_source
from .text import filled

NAME = "repctl_control"
GIVEN_LEAF = 2


def library(control: RepeatableInverse | InverseFunction) -> str | None:
    """Compile an inverse or a cell function to a shared library, and return its path.

    Returns None, after a warning, if there is no C compiler.
    """
    source, many = write_source(control, NAME), isinstance(control, InverseFunction)
    function = filled("python_function.c", NAME, {"lanes": LANES}) if many else ""
    code = (
        source.code.replace(f'#include "{NAME}.h"', source.header)
        + filled("python.c", NAME, {})
        + function
    )
    try:
        if many:
            with suppress(NoCompilerError):  # some compilers refuse these flags
                return loaded_library(code, VECTOR_FLAGS)
        return loaded_library(code)
    except NoCompilerError as error:
        warnings.warn(f"{error}; Python serves", UserWarning, stacklevel=4)
        return None


def call_memory(task: Task) -> tuple[dict[str, Array], ctypes.c_void_p]:
    """Allocate the arguments of the C calls of one thread: ``arm_call`` in ``python.c``.

    Returns an array for each argument, by name, and the address of the memory.
    """
    n, m, r = task.n, task.m, task.r
    sizes = {
        "q": n,
        "xdot": m,
        "target": 16,
        "twist": 6,
        "leaf": r,
        "dt": 1,
        "report": 2,
        "result": n,
        "gain": 1,
        "limit": n,
        "damping": 1,
    }
    memory = np.zeros(sum(sizes.values()))
    parts = np.split(memory, np.cumsum(list(sizes.values()))[:-1])
    return dict(zip(sizes, parts, strict=True)), ctypes.c_void_p(memory.ctypes.data)
