"""A repeatable inverse whose control loop runs in compiled C, called from Python."""

from __future__ import annotations

import ctypes
import warnings
from collections.abc import Callable
from functools import partial
from math import inf

import numpy as np
import pinocchio as pin
from numpy import ndarray
from numpy.typing import ArrayLike

from ..arguments import FLOAT, Array, positive, require_type, vector
from ..c_library import NoCompilerError, loaded_library
from ..errors import SingularityError
from ..inverse_function import InverseFunction
from ..potentials.basis import Potentials
from ..robot.task import Task
from ..strategies.control_step import Loop, failure, python_loops, share_of, speeds
from ..strategies.repeatable import RepeatableInverse
from .source import write_source
from .text import filled

NAME = "repctl_control"
_WHOLE_STEP = -1.0
_TWIST, GIVEN_LEAF, _BOUNDED = 1, 2, 4
_OK, _SINGULAR = 0, 1


def compiled_loops(task: Task, potentials: Potentials) -> Callable[[], Loop]:
    """Make what makes the quick functions in C, once in each thread; with a warning in Python,
    without a compiler."""
    path = library(RepeatableInverse(task, potentials))
    if path is None:
        return python_loops(task, potentials)
    return partial(_loop, task, ctypes.PyDLL(path), ctypes.CDLL(path))


def library(control: RepeatableInverse | InverseFunction) -> str | None:
    """Compile a control: the shared library's path; None, with a warning, where it cannot be
    compiled."""
    source = write_source(control, NAME)
    function = filled("python_function.c", NAME, {}) if isinstance(control, InverseFunction) else ""
    code = (
        source.code.replace(f'#include "{NAME}.h"', source.header)
        + filled("python.c", NAME, {})
        + function
    )
    try:
        return loaded_library(code)
    except NoCompilerError as error:
        warnings.warn(f"{error}; Python serves", UserWarning, stacklevel=4)
        return None


def call_memory(task: Task) -> tuple[dict[str, Array], ctypes.c_void_p]:
    """Make the block of memory that the calls of one thread work on: its parts by name, and its
    address."""
    n, m, r = task.n, task.m, task.r
    sizes = {"q": n, "xdot": m, "target": 16, "twist": 6, "leaf": r, "dt": 1, "report": 2, "result": n,
             "gain": 1, "limit": n, "damping": 1}  # fmt: skip
    memory = np.zeros(sum(sizes.values()))
    parts = np.split(memory, np.cumsum(list(sizes.values()))[:-1])
    return dict(zip(sizes, parts, strict=True)), ctypes.c_void_p(memory.ctypes.data)


def _loop(task: Task, held: ctypes.PyDLL, released: ctypes.CDLL) -> Loop:
    """Wrap a library: quick calls hold the interpreter's lock, long ones release it."""
    n, m, r = task.n, task.m, task.r
    parts, address = call_memory(task)
    q_in, xdot_in, twist_in, leaf_in, result = (
        parts[key] for key in ("q", "xdot", "twist", "leaf", "result")
    )
    target_in, dt_in, gain_in, report = (
        parts["target"].reshape(4, 4),
        parts["dt"],
        parts["gain"],
        parts["report"],
    )
    run_velocity, run_step = held[f"{NAME}_call_velocity"], held[f"{NAME}_call_step"]
    flags, SE3 = [ctypes.c_int(given) for given in range(8)], pin.SE3

    of_joints, of_task, of_twist, of_leaf = (n,), (m,), (6,), (r,)

    def refused(status: int, q: Array, target: pin.SE3 | None = None) -> Exception:
        if status != _SINGULAR and target is not None and np.isfinite(q).all():
            task.error(q, target)  # which refuses what is no rotation
        return failure(task, q, np.array([0.0 if status == _SINGULAR else np.nan]))

    def velocity(q: Array, xdot: Array) -> Array:
        if not (type(q) is ndarray and q.dtype is FLOAT and q.shape == of_joints):
            q = vector(q, n, "q")
        if not (type(xdot) is ndarray and xdot.dtype is FLOAT and xdot.shape == of_task):
            xdot = vector(xdot, m, "ẋ", "m/s and rad/s")
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
        given: int = 0,
    ) -> Array:
        if not (type(q) is ndarray and q.dtype is FLOAT and q.shape == of_joints):
            q = vector(q, n, "q")
        if not (isinstance(dt, float) and 0.0 < dt < inf):
            dt = positive(dt, "dt", "s")
        if not isinstance(target, SE3):
            require_type(target, SE3, "the target", "a placement (pinocchio.SE3)")
        q_in[:] = q
        target_in[:] = target.homogeneous
        dt_in[0] = dt
        if leaf is not None:
            if not (type(leaf) is ndarray and leaf.dtype is FLOAT and leaf.shape == of_leaf):
                leaf = vector(leaf, r, "the leaf c = h(q)", "one per potential")
            leaf_in[:] = leaf
            given |= GIVEN_LEAF
        if gain is None:
            gain_in[0] = _WHOLE_STEP
        else:
            share_of(gain, dt)
            gain_in[0] = gain
        if twist is not None:
            if not (type(twist) is ndarray and twist.dtype is FLOAT and twist.shape == of_twist):
                twist = vector(twist, 6, "the twist (v, ω)", "m/s and rad/s")
            twist_in[:] = twist
            given |= _TWIST
        status = run_step(address, flags[given])
        if status:
            raise refused(status, q, target)
        return result.copy()

    def bounded(
        q: Array,
        target: pin.SE3,
        dt: float,
        twist: Array | None,
        leaf: Array | None,
        gain: float | None,
        velocity_limit: ArrayLike | None,
        damping: float,
    ) -> tuple[Array, float, float]:
        dt, damping = positive(dt, "dt", "s"), positive(damping, "damping", zero=True)
        parts["limit"][:] = inf if velocity_limit is None else speeds(velocity_limit, n)
        parts["damping"][0] = damping
        following = step(q, target, dt, twist, leaf, gain, _BOUNDED)
        return following, float(report[0]), float(report[1])

    return Loop(velocity, step, bounded, *_batches(task, released))


def run_many(library: ctypes.CDLL, name: str, *arrays: Array) -> int:
    """Call a C function for every row of some arrays, the last its results: how many rows it
    did."""
    function = library[f"{NAME}_call_{name}"]
    function.restype = ctypes.c_long
    pointers = (ctypes.c_void_p(array.ctypes.data) for array in arrays)
    return function(ctypes.c_long(len(arrays[0])), *pointers)


def _batches(
    task: Task, library: ctypes.CDLL
) -> tuple[Callable[[Array], Array], Callable[[Array, Array], Array]]:
    """Make the functions of many configurations: Q (K, n) → G (K, n, m), and Q, Ẋ (K, m) → q̇ (K,
    n)."""
    n, m = task.n, task.m

    def run(name: str, *arrays: Array) -> Array:
        done = run_many(library, name, *arrays)
        if done < len(arrays[0]):
            raise SingularityError(f"the augmented Jacobian J_V is singular at row {done}")
        return arrays[-1]

    def inverses(Q: Array) -> Array:
        return run("inverses", np.ascontiguousarray(Q), np.empty((len(Q), n, m)))

    def velocities(Q: Array, Xdot: Array) -> Array:
        return run(
            "velocities", np.ascontiguousarray(Q), np.ascontiguousarray(Xdot), np.empty((len(Q), n))
        )

    return inverses, velocities
