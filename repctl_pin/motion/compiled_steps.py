"""Runge–Kutta steps of the built-in controllers in the native library (runge_kutta.c)."""

from __future__ import annotations

import ctypes
import functools
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..arguments import Array
from ..model.joint_chain import native_chain
from ..native import LAW, filled_struct, library
from ..potentials.polynomial import PolynomialMap
from ..redundancy.inverses import RANK_TOLERANCE
from ..strategies import PostureControl, Pseudoinverse, RepeatableInverse, Strategy
from ..strategies.pseudoinverse import WELL_CONDITIONED

Steps = Callable[[int, int, Array, Array], int]
"""Function (step, end, Q, Qdot) that writes the rows of both arrays from ``step`` on, and returns
the first step that it has not done."""

_MOST = 64
"""Maximum number of joints in C, where their matrices are on the stack."""

_AT_ONCE = 50_000
"""Number of steps per call of the C function; Ctrl-C is handled between calls."""


def compiled_steps(
    strategy: Strategy,
    tableau: tuple[Sequence[float], Sequence[float]],
    xdot: ArrayLike,
    h: ArrayLike,
    most: Array,
) -> Steps | None:
    """Make the function that integrates a strategy in C; None if that is not possible.

    It requires the native library, and a strategy and a task that runge_kutta.c supports.

    Parameters
    ----------
    strategy
        Controller.
    tableau
        Nodes c and weights b of the Runge–Kutta method.
    xdot : (steps, stages, m) array
        Task velocities of the steps of a cycle.
    h : (steps,) array
        Durations of the steps, s.
    most : (n,) array
        Joint motion per step, rad or m, at which the function stops before the step.
    """
    task = strategy.task
    parts = _parts_of(strategy)
    if parts is None or task.kind == "axis" or task.n > _MOST:
        return None
    native = library()
    chain = None if native is None else native_chain(task)
    if native is None or chain is None:
        return None
    scalars, own = parts
    reals = {
        "posture": np.zeros(task.n),
        "tensor": np.zeros(1),
        "center": np.zeros(1),
    } | own
    motion = {
        "nodes": tableau[0],
        "weights": tableau[1],
        "xdot": xdot,
        "h": h,
        "most": most,
    }
    sizes = {"stages": len(tableau[0]), "steps": len(np.asarray(h))}
    sizes |= {"arm": ctypes.addressof(chain[0])}
    law, held = filled_struct(LAW, {}, reals | motion, sizes | scalars)
    return functools.partial(_run, native, law, [chain, held])


def _run(
    native: ctypes.CDLL,
    law: ctypes.Structure,
    held: list[Any],  # the memory to which law points
    step: int,
    end: int,
    Q: Array,
    Qdot: Array,
) -> int:
    rows = [ctypes.c_void_p(array.ctypes.data) for array in (Q, Qdot)]
    while step < end:
        goal = min(step + _AT_ONCE, end)
        step = native.runge_kutta_steps(ctypes.byref(law), step, goal, *rows)
        if step < goal:
            break
    return step


def _parts_of(strategy: Strategy) -> tuple[dict[str, float], dict[str, Array]] | None:
    """Collect the scalars and arrays of a strategy's control law for C; None if unsupported."""
    kind = type(strategy)
    speed = {"sufficient": WELL_CONDITIONED**2}
    if kind is Pseudoinverse:
        return speed, {}
    if isinstance(strategy, PostureControl) and kind is PostureControl:
        return speed | {"gain": strategy.gain}, {"posture": strategy.posture}
    if isinstance(strategy, RepeatableInverse) and kind is RepeatableInverse:
        task, h = strategy.task, strategy.potentials
        tensor = h.homogeneous if isinstance(h, PolynomialMap) else None
        if tensor is not None:
            scalars: dict[str, float] = {"r": task.r, "degree": tensor.degree}
            scalars["sufficient"] = RANK_TOLERANCE / task.n ** (task.n / 2)
            return scalars, {"tensor": tensor.tensor, "center": tensor.center}
    return None
