"""Compiled C versions of repeatable inverses and of cell functions, called from Python."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property, partial
from typing import overload

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..arguments import Array, require_type
from ..inverse_function import InverseFunction
from ..inverse_function.cell_potentials import CellPotentials
from ..inverse_function.chart import Chart
from ..robot.chain_formulas import Placement, as_placement
from ..robot.task import Task
from ..strategies.repeatable import RepeatableInverse
from ..threads import PerThread
from .compiled_loop import (
    GIVEN_LEAF,
    NAME,
    call_memory,
    compiled_loops,
    library,
    run_many,
)

_LEAST_PART = 1024
"""Minimum number of poses per thread; for fewer, another thread is not worthwhile."""


class CompiledFunction(InverseFunction):
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

    def _batch(
        self, U: Array, C: Array, threads: int, *, missing: bool = False
    ) -> Array:
        if self._library is not None and len(C) and (C == C[0]).all():
            p, R = self.cell.placements(U)
            poses = np.concatenate([p, R.reshape(-1, 9)], axis=1)
            Q, leaf = np.empty((len(U), self.task.n)), np.ascontiguousarray(C[0])
            size = max(_LEAST_PART, -(-len(U) // threads))
            parts = [slice(i, i + size) for i in range(0, len(U), size)]

            def run(part: slice) -> bool:
                count = len(Q[part])
                return (
                    run_many(self._many, "functions", poses[part], leaf, Q[part])
                    == count
                )

            if len(parts) < 2:
                done = all(map(run, parts))
            else:
                with ThreadPoolExecutor(threads) as pool:
                    done = all(list(pool.map(run, parts)))
            if done:
                return Q
        return super()._batch(U, C, threads, missing=missing)

    @cached_property
    def inverse(self) -> RepeatableInverse:
        """Repeatable inverse ``q̇ = ∂F/∂x ẋ``, also compiled to C."""
        if self._library is None:  # a warning was given
            return super().inverse
        return RepeatableInverse(
            self.task,
            CellPotentials(self.chart),
            region=self.cell,
            loops=compiled_loops,
        )


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
        return CompiledFunction(control.chart, keep_limits=control.keep_limits)
    require_type(
        control,
        RepeatableInverse,
        "inverse",
        "a repeatable inverse, such as design.inverse, or found.function",
    )
    return RepeatableInverse(
        control.task, control.potentials, region=control.region, loops=compiled_loops
    )
