"""Batched kinematics, and Newton's method of a chart, in the native library."""

from __future__ import annotations

import ctypes
import weakref
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...arguments import Array
from ...model.task import Task
from ...native import library
from ...strategies.native_arm import native_arm


@dataclass(frozen=True, eq=False)
class _NativePoints:
    """Kinematic chain of a task in C, and calls with it for many configurations."""

    m: int
    library: ctypes.CDLL
    arm: Any

    def placed(self, Q: Array) -> tuple[Array, Array, Array]:
        """Evaluate positions (K, 3), rotations (K, 3, 3) and J (K, m, n) at Q (K, n)."""
        K, n = Q.shape
        found = np.empty((K, 3)), np.empty((K, 3, 3)), np.empty((K, self.m, n))
        self._run("call_places", K, Q, *found)
        return found

    def solved(
        self,
        goal: tuple[Array, Array],
        chart: tuple[Array, Array, Array],
        Q: Array,
        *,
        iterations: int,
        longest: float,
        tolerance: float,
    ) -> tuple[Array, Array, Array, Array, Array]:
        """Solve ``f(q) = goal``, ``n_refᵀ (q − q_ref) = s`` from Q (K, n) by Newton's method.

        Parameters
        ----------
        goal : (K, 3) and (K, 3, 3) arrays
            Positions, m, and rotations of the target poses.
        chart : (K, n), (K, n, r) and (K, r) arrays
            q_ref, n_ref and s.
        Q : (K, n) array
            Initial configurations.
        iterations, longest, tolerance
            See :func:`repctl_pin.solvers.newton_rows`.

        Returns
        -------
        Q, R, J : (K, n), (K, 3, 3) and (K, m, n) arrays
            Configurations, and rotations and Jacobians there.
        residual, size : (K,) arrays
            Largest entry of the task error, and of the last step.
        """
        K, n = Q.shape
        Q = np.array(Q, float, order="C")
        R, J = np.empty((K, 3, 3)), np.empty((K, self.m, n))
        residual, size = np.empty(K), np.empty(K)
        limits = (
            ctypes.c_int(iterations),
            ctypes.c_double(longest),
            ctypes.c_double(tolerance),
        )
        self._run("call_points", K, *goal, *chart, *limits, Q, R, J, residual, size)
        return Q, R, J, residual, size

    def _run(self, name: str, count: int, *given: Any) -> None:
        kept = [
            np.ascontiguousarray(x, float) if isinstance(x, np.ndarray) else x
            for x in given
        ]
        pointers = (
            ctypes.c_void_p(x.ctypes.data) if isinstance(x, np.ndarray) else x
            for x in kept
        )
        self.library[name](ctypes.byref(self.arm), ctypes.c_long(count), *pointers)


_known: weakref.WeakKeyDictionary[Task, _NativePoints | None] = (
    weakref.WeakKeyDictionary()
)


def native_points(task: Task) -> _NativePoints | None:
    """Return the chain of a task in C, cached per task.

    None if there is no native library, or it does not support the task: more than 64 joints, or
    transformed joint coordinates.
    """
    if task not in _known:
        _known[task] = _made(task)
    return _known[task]


def _made(task: Task) -> _NativePoints | None:
    native = library()
    if native is None or task.coordinates is not None:
        return None
    arm = native_arm(task)
    return None if arm is None else _NativePoints(task.m, native, arm)
