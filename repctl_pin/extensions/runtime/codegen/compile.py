"""Compiled C versions of repeatable inverses and of cell functions, called from Python."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Literal, overload

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ....arguments import Array, as_int, require_choice, require_type
from ....errors import InputError
from ....model.chain_formulas import Placement, as_placement, as_placements
from ....model.task import Task
from ....strategies.repeatable import RepeatableInverse
from ....threads import PerThread
from ...cells.chart import Chart
from ...cells.function import MOST_THREADS, InverseFunction
from ...cells.targets import FORMS, as_poses, homogeneous
from .compiled_loop import GIVEN_LEAF, NAME, call_memory, library

_PART = 2048
"""Number of poses at a time, per thread; their arrays stay in the processor's cache."""


class _CompiledFunction(InverseFunction):
    """Inverse kinematic function ``q = F(x; c)`` in C.

    If a C call fails, Python evaluates F again, for the error message.
    """

    def __init__(self, chart: Chart, *, keep_limits: bool = True) -> None:
        super().__init__(chart, keep_limits=keep_limits)
        self._library = library(InverseFunction(chart, keep_limits=keep_limits))
        if self._library is not None:
            one = ctypes.PyDLL(self._library)[f"{NAME}_call_F"]
            self._many = ctypes.CDLL(self._library)
            self._one = PerThread(partial(_one_pose, self.task, one))

    def __call__(self, target: Placement, *, leaf: ArrayLike | None = None) -> Array:
        """Evaluate F, the configuration (n,) for a pose; see :class:`InverseFunction`."""
        if not isinstance(target, pin.SE3):
            target = as_placement(target)
        if self._library is not None:
            q = self._one.own(target, None if leaf is None else self._leaf(leaf))
            if q is not None:
                return q
        return super().__call__(target, leaf=leaf)

    def batch(
        self,
        targets: Sequence[Placement] | Array,
        *,
        leaf: ArrayLike | None = None,
        missing: Literal["raise", "nan"] = "raise",
        threads: int = 1,
    ) -> Array:
        """Evaluate F at many targets: (K, n); see :meth:`InverseFunction.batch`.

        Python evaluates the targets again at which C has no configuration.
        """
        threads = as_int(threads, "threads", 1, MOST_THREADS)
        require_choice(missing, ("raise", "nan"), "missing")
        if not isinstance(targets, np.ndarray):
            placements = as_placements(targets, "target", FORMS)
            targets = homogeneous(*as_poses(self.task, placements))
        if self._library is None or targets.ndim < 2:
            return super().batch(targets, leaf=leaf, missing=missing)
        try:
            c = np.ascontiguousarray(self._leaves(leaf, len(targets)))
            Q = self._compiled(targets, c, threads)
            failed = np.flatnonzero(np.isnan(Q[:, 0]))
            if len(failed):
                left, on = targets[failed], c[failed]
                Q[failed] = super().batch(left, leaf=on, missing=missing)
        except InputError:  # again, for the number of the target
            return super().batch(targets, leaf=leaf, missing=missing)
        return Q

    def _compiled(self, targets: Array, C: Array, threads: int) -> Array:
        """Evaluate F (K, n) in C at targets, on the leaves C (K, r), part by part.

        Rows without a configuration are NaN.
        """
        run = self._many[f"{NAME}_call_functions"]
        Q, stride = np.empty((len(targets), self.task.n)), ctypes.c_int(C.shape[1])

        def evaluate(begin: int) -> None:
            part = slice(begin, begin + _PART)
            X = self._matrices(targets[part])
            arrays = X, C[part], Q[part]
            x, c, q = (ctypes.c_void_p(array.ctypes.data) for array in arrays)
            run(ctypes.c_long(len(X)), x, c, stride, q)

        parts = range(0, len(targets), _PART)
        if threads == 1 or len(parts) < 2:
            for begin in parts:
                evaluate(begin)
        else:
            with ThreadPoolExecutor(threads) as pool:
                list(pool.map(evaluate, parts))
        return Q

    def _matrices(self, targets: Array) -> Array:
        """Convert targets to homogeneous matrices (K, 4, 4); NaN for coordinates outside."""
        if targets.shape[1:] == (4, 4) and targets.dtype == float:
            return np.ascontiguousarray(targets)
        if targets.ndim != 2 or targets.shape[1] == 7:
            return homogeneous(*as_poses(self.task, targets))
        U, off = self._coordinates(targets)
        p, R = self.cell.placements(U)
        p[~self.cell._contains(U, off)] = np.nan
        return homogeneous(p, R)


def _one_pose(
    task: Task, run: Callable[..., int]
) -> Callable[[pin.SE3, Array | None], Array | None]:
    """Create the function (target, leaf or None) → q (n,) that calls C from one thread.

    It returns None if C returns an error.
    """
    parts, address = call_memory(task)
    pose, leaf_in, result = (
        parts["target"].reshape(4, 4),
        parts["leaf"],
        parts["result"],
    )

    def one(target: pin.SE3, leaf: Array | None) -> Array | None:
        pose[:] = target.homogeneous
        if leaf is not None:
            leaf_in[:] = leaf
        if run(address, 0 if leaf is None else GIVEN_LEAF):
            return None
        return result.copy()

    return one


@overload
def compiled(control: RepeatableInverse) -> RepeatableInverse: ...
@overload
def compiled(control: InverseFunction) -> InverseFunction: ...
def compiled(
    control: RepeatableInverse | InverseFunction,
) -> RepeatableInverse | InverseFunction:
    """Compile a repeatable inverse or a cell function to C.

    The returned inverse runs ``velocity``, ``step``, ``batch`` and ``velocities`` in C. The
    returned cell function runs F, ``batch`` and its ``inverse`` in C.

    The code is compiled once by the system's C compiler, and stored in the user's cache. Without a
    compiler, a warning is given and the result runs in Python. Any number of threads can call it.

    Parameters
    ----------
    control
        Inverse with potentials that are polynomials, Fourier series, or their sums; or a cell's
        inverse kinematic function, such as ``found.function``.

    Returns
    -------
    RepeatableInverse or InverseFunction
        Compiled version of ``control``, with its interface.

    Raises
    ------
    InputError
        If the potentials are user-defined functions, which cannot be written as C.

    Examples
    --------
    >>> fast = rp.compiled(design.inverse)
    >>> xdot = np.array([0.1, 0.0])
    >>> np.allclose(fast.velocity(q0, xdot), design.inverse.velocity(q0, xdot))
    True
    """
    if isinstance(control, InverseFunction):
        return _CompiledFunction(control.chart, keep_limits=control.keep_limits)
    require_type(
        control,
        RepeatableInverse,
        "inverse",
        "a repeatable inverse, such as design.inverse, or found.function",
    )
    return control
