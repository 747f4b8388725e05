"""Control step of a repeatable inverse in compiled C, called from Python."""

from __future__ import annotations

import ctypes
import warnings
from collections.abc import Callable
from contextlib import suppress
from functools import partial

import numpy as np
import pinocchio as pin

from ....arguments import Array
from ....c_library import VECTOR_FLAGS, NoCompilerError, loaded_library
from ....errors import SingularityError
from ....model.task import Task
from ....potentials.basis import Potentials
from ....strategies.control_step import python_loops
from ....strategies.fast_loop import FastLoop, StepLimits, checked, failure
from ....strategies.repeatable import RepeatableInverse
from ...cells.function import InverseFunction
from .cell_function import LANES
from .source import write_source
from .text import filled

NAME = "repctl_control"
_WHOLE_STEP = -1.0
_TWIST, GIVEN_LEAF, _BOUNDED = 1, 2, 4
_OK, _SINGULAR = 0, 1


def compiled_loops(task: Task, potentials: Potentials) -> Callable[[], FastLoop]:
    """Create a factory of the C functions of a control step; each call makes those of one thread.

    Without a C compiler, a warning is given and the functions are in Python.
    """
    path = library(RepeatableInverse(task, potentials))
    if path is None:
        return python_loops(task, potentials)
    return partial(_loop, task, ctypes.PyDLL(path), ctypes.CDLL(path))


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


def _loop(task: Task, held: ctypes.PyDLL, released: ctypes.CDLL) -> FastLoop:
    """Create the :class:`FastLoop` of a shared library, for one thread.

    The library is loaded twice. Calls of ``held``, for one configuration, keep Python's global
    interpreter lock; calls of ``released``, for batches, release it.
    """
    parts, address = call_memory(task)
    q_in, xdot_in, twist_in = parts["q"], parts["xdot"], parts["twist"]
    leaf_in, dt_in, gain_in = parts["leaf"], parts["dt"], parts["gain"]
    limit_in, damping_in = parts["limit"], parts["damping"]
    target_in, report, result = (
        parts["target"].reshape(4, 4),
        parts["report"],
        parts["result"],
    )
    run_velocity, run_step = held[f"{NAME}_call_velocity"], held[f"{NAME}_call_step"]
    flags = [ctypes.c_int(given) for given in range(8)]

    def refused(status: int, q: Array, target: pin.SE3 | None = None) -> Exception:
        if status != _SINGULAR and target is not None and np.isfinite(q).all():
            task.error(q, target)  # which refuses what is no rotation
        return failure(task, q, np.array([0.0 if status == _SINGULAR else np.nan]))

    def velocity(q: Array, xdot: Array) -> Array:
        q_in[:] = q
        xdot_in[:] = xdot
        status = run_velocity(address)
        if status:
            raise refused(status, q)
        return result.copy()

    def step(
        q: Array,
        target: pin.SE3,
        dt: float,
        twist: Array | None,
        leaf: Array | None,
        gain: float | None,
        bounds: StepLimits | None,
    ) -> Array:
        given = 0
        q_in[:] = q
        target_in[:] = target.homogeneous
        dt_in[0] = dt
        gain_in[0] = _WHOLE_STEP if gain is None else gain
        if leaf is not None:
            leaf_in[:] = leaf
            given |= GIVEN_LEAF
        if twist is not None:
            twist_in[:] = twist
            given |= _TWIST
        if bounds is not None:
            limit_in[:] = bounds.velocity_limit
            damping_in[0] = bounds.damping
            given |= _BOUNDED
        status = run_step(address, flags[given])
        if status:
            raise refused(status, q, target)
        return result.copy()

    law = FastLoop(
        velocity,
        step,
        lambda: (float(report[0]), float(report[1])),
        *_batches(task, released),
    )
    return checked(task, law)


def _run_many(library: ctypes.CDLL, name: str, *arrays: Array) -> int:
    """Call a C function on all rows of several arrays, the last of which receives the results.

    Returns the number of rows that were evaluated before the first failure.
    """
    function = library[f"{NAME}_call_{name}"]
    function.restype = ctypes.c_long
    pointers = (ctypes.c_void_p(array.ctypes.data) for array in arrays)
    return function(ctypes.c_long(len(arrays[0])), *pointers)


def _batches(
    task: Task, library: ctypes.CDLL
) -> tuple[Callable[[Array], Array], Callable[[Array, Array], Array]]:
    """Create the batched functions: Q (K, n) → G (K, n, m), and Q, Ẋ (K, m) → q̇ (K, n)."""
    n, m = task.n, task.m

    def run(name: str, *arrays: Array) -> Array:
        done = _run_many(library, name, *arrays)
        if done < len(arrays[0]):
            raise SingularityError(
                f"the augmented Jacobian J_V is singular at row {done}"
            )
        return arrays[-1]

    def inverses(Q: Array) -> Array:
        return run("inverses", np.ascontiguousarray(Q), np.empty((len(Q), n, m)))

    def velocities(Q: Array, Xdot: Array) -> Array:
        return run(
            "velocities",
            np.ascontiguousarray(Q),
            np.ascontiguousarray(Xdot),
            np.empty((len(Q), n)),
        )

    return inverses, velocities
