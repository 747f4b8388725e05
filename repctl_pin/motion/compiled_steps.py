"""Runge–Kutta steps of the built-in controllers in the native library (runge_kutta.c).

The same steps in Python would take most of the time of a study. A controller (a map from q and ẋ to
q̇) that has no C code is integrated in Python by :mod:`follow`. J⁺ is the pseudoinverse of the
Jacobian. The steps of all cycles are counted from 0: step k leads from row k of Q (T + 1, n), the
configurations, to row k + 1, and row k of Qdot (T + 1, n) is q̇ at the start of step k.

``ARM`` is the C struct of a task and its potentials. ``LAW`` is the C struct of a controller, a
Runge–Kutta method and the steps of a cycle.
"""

from __future__ import annotations

import ctypes
import functools
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..base.arguments import Array
from ..native import LAW, filled_struct, library
from ..strategies import PostureControl, Pseudoinverse, RepeatableInverse, Strategy
from ..strategies.native_arm import library_arm

Steps = Callable[[int, int, Array, Array], int]
"""Function (step, end, Q, Qdot) that takes the steps from ``step`` to ``end``, writes their results
to rows of both arrays, and returns the first step that was not taken."""

_AT_ONCE = 50_000
"""Number of steps per call of the C function; Ctrl-C is handled between calls."""


def compiled_steps(
    strategy: Strategy,
    tableau: tuple[Sequence[float], Sequence[float]],
    xdot: ArrayLike,
    h: ArrayLike,
    most: Array,
) -> Steps | None:
    """Create the function that integrates a strategy in C: (step, end, Q, Qdot) → int.

    That function takes the steps ``step`` to ``end`` − 1, and writes q and q̇ to the rows of Q and
    Qdot. Row ``step`` of Q must hold the configuration at the start. The result is the number of
    the first step that was not taken: ``end`` if all were taken.

    Return None without the native library, and for a strategy or task that runge_kutta.c does not
    support; :func:`follow` then takes the same steps in Python, more slowly.

    Parameters
    ----------
    strategy
        Controller.
    tableau
        Nodes c, fractions of the step, and weights b of the Runge–Kutta method, one each per stage.
    xdot : (steps, stages, m) array
        Task velocity ẋ at each stage of each step of a cycle, m/s and rad/s.
    h : (steps,) array
        Durations of the steps, s.
    most : (n,) array
        Maximum motion of each joint per step, rad or m; the function stops before a longer step.
    """
    native = library()
    law = None if native is None else _law_of(strategy)
    if native is None or law is None or strategy.task.kind == "axis":
        return None
    arm, scalars, posture = law
    motion = {"nodes": tableau[0], "weights": tableau[1], "xdot": xdot, "h": h}
    sizes = {"stages": len(tableau[0]), "steps": len(np.asarray(h))}
    sizes |= {"arm": ctypes.addressof(arm)}
    made, held = filled_struct(LAW, {}, posture | motion | {"most": most}, sizes | scalars)
    return functools.partial(_run, native, made, [arm, held])


def _run(
    native: ctypes.CDLL,
    law: ctypes.Structure,
    held: list[Any],  # the memory to which law points
    step: int,
    end: int,
    Q: Array,
    Qdot: Array,
) -> int:
    """Take the steps ``step`` to ``end`` − 1 in C, and return the first step that was not taken.

    ``native`` is the library, and ``law`` the struct :data:`LAW`. ``held`` are the arrays and
    structs to which ``law`` points, so that their memory is not freed. The results are written to
    the rows of Q and Qdot. C stops at a step that fails or is too long; the caller then repeats the
    step in Python, which raises the error.
    """
    rows = [ctypes.c_void_p(array.ctypes.data) for array in (Q, Qdot)]
    while step < end:
        goal = min(step + _AT_ONCE, end)
        step = native.runge_kutta_steps(ctypes.byref(law), step, goal, *rows)
        if step < goal:
            break
    return step


def _law_of(strategy: Strategy) -> tuple[Any, dict[str, float], dict[str, Array]] | None:
    """Return the parts of the C struct LAW that depend on a strategy; None if C lacks its formula.

    The result is the tuple (struct :data:`ARM`, numbers by name, arrays by name). A repeatable
    inverse has the number ``on_leaf`` = 1, by which C holds the potentials constant. A posture
    control has the number ``gain``, 1/s, and the array ``posture`` (n,). For J⁺, both dicts are
    empty.
    """
    kind = type(strategy)
    if isinstance(strategy, RepeatableInverse) and kind is RepeatableInverse:
        arm = strategy._law.own.arm
        return None if arm is None else (arm, {"on_leaf": 1}, {})
    if kind is not Pseudoinverse and kind is not PostureControl:
        return None
    arm = library_arm(strategy.task)
    if arm is None or not isinstance(strategy, PostureControl):
        return None if arm is None else (arm, {}, {})
    return arm, {"gain": strategy.gain}, {"posture": strategy.posture}
