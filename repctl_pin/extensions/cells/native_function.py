"""q = F(x; c) in the native library: tables of a chart, and calls for one pose and for many."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pinocchio as pin

from ...arguments import Array
from ...native import CHART, CHART_CALL, filled_struct, library
from ...strategies.native_arm import native_arm
from .chart import Chart

_PART = 2048
"""Number of poses at a time, per thread; their arrays stay in the processor's cache."""

_FOURS = 4
"""Number of monomials that chart.c adds at a time."""


class _NativeFunction:
    """Cell function in C, from the tables of its chart.

    Parameters
    ----------
    native
        The native library.
    arm
        Struct Arm of the task, from :func:`native_arm`.
    chart
        The chart.
    keep_limits
        True to check the joint limits on the leaf c = 0, too.
    """

    def __init__(
        self, native: ctypes.CDLL, arm: Any, chart: Chart, keep_limits: bool
    ) -> None:
        self._native, self._held = native, ctypes.PyDLL(native._name)
        self._arm, self._chart = arm, native_chart(chart)
        self._keep = int(keep_limits)
        self._n, self._r = chart.cell.task.n, chart.cell.task.r

    def of_one(self) -> Callable[[pin.SE3, Array | None], Array | None]:
        """Create the function (target, leaf or None) → q (n,), with the memory of one thread.

        It returns None where C has no configuration.
        """
        target, leaf, result = np.zeros((4, 4)), np.zeros(self._r), np.zeros(self._n)
        parts = {"target": target, "leaf": leaf, "result": result}
        to = {
            "arm": ctypes.addressof(self._arm),
            "chart": ctypes.addressof(self._chart),
            "keep": self._keep,
        }
        call, _ = filled_struct(CHART_CALL, {}, parts, to)
        address = ctypes.c_void_p(ctypes.addressof(call))
        run = self._held.call_configuration  # keeps the interpreter's lock: faster

        def one(at: pin.SE3, c: Array | None, _memory: Any = call) -> Array | None:
            target[:] = at.homogeneous
            if c is not None:
                leaf[:] = c
            return None if run(address, c is not None) else result.copy()

        return one

    def of_many(
        self, targets: Array, C: Array, matrices: Callable[[Array], Array], threads: int
    ) -> Array:
        """Evaluate F (K, n) at targets (K, …) on the leaves C (K, r), part by part.

        ``matrices`` converts targets to homogeneous matrices (K, 4, 4). Rows without a
        configuration are NaN.
        """
        Q = np.empty((len(targets), self._n))
        to = ctypes.byref(self._arm), ctypes.byref(self._chart)

        def evaluate(begin: int) -> None:
            part = slice(begin, begin + _PART)
            X = matrices(targets[part])
            rows = (ctypes.c_void_p(x.ctypes.data) for x in (X, C[part], Q[part]))
            count = ctypes.c_long(len(X))
            self._native.call_configurations(*to, self._keep, count, *rows)

        parts = range(0, len(targets), _PART)
        if threads == 1 or len(parts) < 2:
            for begin in parts:
                evaluate(begin)
        else:
            with ThreadPoolExecutor(threads) as pool:
                list(pool.map(evaluate, parts))
        return Q


def native_function(chart: Chart, keep_limits: bool) -> _NativeFunction | None:
    """Create the C version of a cell function; None without the native library, or if it cannot
    hold the task (more than 64 joints)."""
    native = library()
    arm = None if native is None else native_arm(chart.cell.task)
    if native is None or arm is None:
        return None
    return _NativeFunction(native, arm, chart, keep_limits)


def native_chart(chart: Chart) -> Any:
    """Create the struct :data:`CHART` of a chart."""
    ints, reals, scalars = chart.cell._tables()
    terms, both, weights = _weights(chart)
    row, column = _elimination_order(chart)
    more = (0, terms - chart.monomials.size)
    ints |= {
        "parent": np.pad(chart.monomials.parent, more),
        "factor": np.pad(chart.monomials.variable, more),
        "row": np.argsort(row),
        "column": np.argsort(column),
    }
    scalars |= {"terms": terms, "both": both}
    return filled_struct(CHART, ints, reals | {"weights": weights}, scalars)[0]


def _weights(chart: Chart) -> tuple[int, int, Array]:
    """Arrange the coefficients of q_ref and n_ref for chart.c.

    Returns the number of monomials, a multiple of 4; the number of those in which n_ref has
    coefficients; and the coefficients. Each row belongs to a monomial: those of q_ref, then, in the
    first rows, those of n_refᵀ. Both parts of a row have an even length, padded with zeros.
    """
    C = np.moveaxis(chart.coefficients, 2, 1)  # (N, 1 + r, n)
    C = np.pad(C, ((0, -len(C) % _FOURS), (0, 0), (0, 0)))
    used = np.flatnonzero(C[:, 1:].any(axis=(1, 2)))
    both = -(-(used.max(initial=0) + 1) // _FOURS) * _FOURS
    q_ref = np.pad(C[:, 0], ((0, 0), (0, C.shape[2] % 2)))
    n_ref = C[:both, 1:].reshape(both, -1)
    n_ref = np.pad(n_ref, ((0, 0), (0, n_ref.shape[1] % 2)))
    first = np.concatenate([q_ref[:both], n_ref], axis=1)
    return len(C), int(both), np.concatenate([first.ravel(), q_ref[both:].ravel()])


def _elimination_order(chart: Chart) -> tuple[list[int], list[int]]:
    """Order rows and columns of J_V by complete pivoting in the middle of the cell.

    Returns the indices of the rows, and of the columns, in their new order, in which the C code
    eliminates without exchanges.
    """
    q, V = chart.coefficients[0, :, 0], chart.coefficients[0, :, 1:]
    A = np.concatenate([chart.cell.task.jacobian(q), V.T])
    n = len(A)
    rows, columns = list(range(n)), list(range(n))
    for k in range(n):
        i, j = np.unravel_index(int(np.argmax(np.abs(A[k:, k:]))), (n - k, n - k))
        for order, B, at in ((rows, A, k + int(i)), (columns, A.T, k + int(j))):
            order[k], order[at] = order[at], order[k]
            B[[k, at]] = B[[at, k]]
        if A[k, k] == 0.0:
            break
        A[k + 1 :] -= np.outer(A[k + 1 :, k] / A[k, k], A[k])
    return rows, columns
