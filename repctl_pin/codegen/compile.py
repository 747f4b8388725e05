"""A repeatable control, or a cell's inverse kinematic function, in compiled C, called from
Python."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import cached_property, partial
from typing import overload

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..arguments import Array, require_type
from ..inverse_function import InverseFunction
from ..inverse_function.cell_potentials import CellPotentials
from ..inverse_function.chart import Chart
from ..robot.formulas import Placement, as_placement
from ..robot.task import Task
from ..strategies.repeatable import RepeatableInverse
from ..threads import PerThread
from .compiled_loop import GIVEN_LEAF, NAME, call_memory, compiled_loops, library, run_many


class CompiledFunction(InverseFunction):
    """``q = F(x; c)`` in C. What C refuses Python looks at again, and says why."""

    def __init__(self, chart: Chart, *, keep_limits: bool = True) -> None:
        super().__init__(chart, keep_limits=keep_limits)
        self._library = library(InverseFunction(chart, keep_limits=keep_limits))
        if self._library is not None:
            one = ctypes.PyDLL(self._library)[f"{NAME}_call_F"]
            self._many = ctypes.CDLL(self._library)
            self._one = PerThread(partial(_one_pose, self.task, one))

    def __call__(self, target: Placement, *, leaf: ArrayLike | None = None) -> Array:
        """Evaluate F: the joints (n,) for a pose of the cell; see :class:`InverseFunction`."""
        if not isinstance(target, pin.SE3):
            target = as_placement(target)
        if self._library is not None:
            q = self._one.own(target, None if leaf is None else self._leaf(leaf))
            if q is not None:
                return q
        return super().__call__(target, leaf=leaf)

    def _batch(self, U: Array, c: Array) -> Array:
        if self._library is not None:
            p, R = map(np.ascontiguousarray, self.cell.placements(U))
            Q = np.empty((len(U), self.task.n))
            if run_many(self._many, "functions", p, R, np.ascontiguousarray(c), Q) == len(U):
                return Q
        return super()._batch(U, c)

    @cached_property
    def inverse(self) -> RepeatableInverse:
        """The control ``q̇ = ∂F/∂x ẋ``, in C too."""
        if self._library is None:  # which was said
            return super().inverse
        return RepeatableInverse(
            self.task, CellPotentials(self.chart), region=self.cell, loops=compiled_loops
        )


def _one_pose(
    task: Task, run: Callable[..., int]
) -> Callable[[pin.SE3, Array | None], Array | None]:
    """Make the function (target, leaf or None) → q (n,) of one thread; None where C refuses."""
    parts, address = call_memory(task)
    pose, leaf_in, result = parts["target"].reshape(4, 4), parts["leaf"], parts["result"]

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
def compiled(control: RepeatableInverse | InverseFunction) -> RepeatableInverse | InverseFunction:
    """Make the same inverse with ``velocity``, ``step``, ``batch`` and ``velocities`` in compiled
    C, or the same F.

    It is compiled once with the machine's C compiler, and kept in the user's cache. Without a
    compiler there is a warning, and Python is used. Any number of threads may call it.

    Parameters
    ----------
    control
        An inverse of polynomials, Fourier series, or their sums. Or a cell's inverse kinematic
        function, such as ``found.function``: then F, ``batch`` and its ``inverse`` are in C.

    Returns
    -------
    RepeatableInverse or InverseFunction

    Raises
    ------
    InputError
        If its potentials are user-defined functions, which cannot be written as C.

    Examples
    --------
    >>> fast = rp.compiled(design.inverse)
    >>> np.allclose(fast.velocity(q0, np.array([0.1, 0.0])), design.inverse.velocity(q0, np.array([0.1, 0.0])))
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
