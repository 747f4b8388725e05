"""Forward kinematics and Jacobians of many configurations at once, in C if it can hold the chain.

Arrays have one row per configuration, K in all. Letters: n joints, m task coordinates.
"""

from __future__ import annotations

import ctypes
import weakref
from typing import Any

import numpy as np

from ..base.arguments import Array
from ..native import library
from .joint_chain import native_chain
from .task import Task

_chains: weakref.WeakKeyDictionary[Task, Any] = weakref.WeakKeyDictionary()
"""Result of :func:`native_chain` by task: kinematic chains for C, with the arrays they point to."""


def chain_for_c(task: Task) -> Any | None:
    """Return the kinematic chain of a task as a struct for calls of C, cached per task.

    Return None without the native library, or with more than 64 joints, which C cannot hold.
    """
    if library() is None:
        return None
    if task not in _chains:
        _chains[task] = native_chain(task)
    made = _chains[task]
    return None if made is None else made[0]


def run(name: str, arm: Any, count: int, *given: Any) -> None:
    """Call a function of the native library for ``count`` configurations, with a kinematic chain.

    ``name`` is the name of the function, and ``arm`` the C struct of the chain. The function is
    called with the address of ``arm``, ``count``, and ``given``: further arguments, arrays, C
    numbers or None. Arrays that the function fills must be contiguous arrays of float.
    """
    kept = [np.ascontiguousarray(x, float) if isinstance(x, np.ndarray) else x for x in given]
    pointers = (ctypes.c_void_p(x.ctypes.data) if isinstance(x, np.ndarray) else x for x in kept)
    native = library()
    assert native is not None, "there is a chain for it"
    getattr(native, name)(ctypes.byref(arm), ctypes.c_long(count), *pointers)


def placed(task: Task, Q: Array) -> tuple[Array, Array, Array]:
    """Evaluate the forward kinematics and the task Jacobian at every row of Q (K, n).

    C evaluates them if possible. Return positions (K, 3), m, rotation matrices (K, 3, 3), and J (K,
    m, n).
    """
    arm = chain_for_c(task)
    if arm is None:
        return (*task._placements(task._matrix(Q)), task.jacobians(Q))
    K = len(Q)
    found = np.empty((K, 3)), np.empty((K, 3, 3)), np.empty((K, task.m, task.n))
    run("call_places", arm, K, Q, *found)
    return found


def jacobians(task: Task, Q: Array) -> Array:
    """Evaluate the task Jacobian J at every row of Q (K, n), in C if possible: (K, m, n)."""
    arm = chain_for_c(task)
    if arm is None:
        return task.jacobians(Q)
    J = np.empty((len(Q), task.m, task.n))
    run("call_places", arm, len(Q), Q, None, None, J)
    return J
