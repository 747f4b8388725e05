"""A repeatable control, or a cell's inverse kinematic function, in compiled C, called from Python."""

from __future__ import annotations

import ctypes
from functools import cached_property
from typing import overload

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..arguments import Array, wanted
from ..section import InverseFunction
from ..section.chart import Chart
from ..section.field import SectionField
from ..strategies.repeatable import RepeatableInverse
from .compiled_loop import GIVEN_LEAF, NAME, call_memory, compiled_loop, library, run_many


class CompiledFunction(InverseFunction):
    """``q = F(x; c)`` in C. What C refuses Python looks at again, and says why."""

    def __init__(self, chart: Chart, *, keep_limits: bool = True) -> None:
        super().__init__(chart, keep_limits=keep_limits)
        self._library = library(self)
        self._parts, self._address = call_memory(self.task)
        self._pose = self._parts["target"].reshape(4, 4)
        if self._library is not None:
            self._one = ctypes.PyDLL(self._library)[f"{NAME}_call_F"]
            self._many = ctypes.CDLL(self._library)

    def __call__(self, target: pin.SE3, *, leaf: ArrayLike | None = None) -> Array:
        """Evaluate F: the joints (n,) for a pose of the cell; see :class:`InverseFunction`."""
        if self._library is not None and isinstance(target, pin.SE3):
            self._pose[:] = target.homogeneous
            if leaf is not None:
                self._parts["leaf"][:] = self._leaf(leaf)
            if not self._one(self._address, 0 if leaf is None else GIVEN_LEAF):
                return self._parts["result"].copy()
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
        return RepeatableInverse(self.task, SectionField(self.chart), loops=compiled_loop)


@overload
def compiled(control: RepeatableInverse) -> RepeatableInverse: ...
@overload
def compiled(control: InverseFunction) -> InverseFunction: ...
def compiled(control: RepeatableInverse | InverseFunction) -> RepeatableInverse | InverseFunction:
    """Make the same inverse with ``velocity``, ``step``, ``batch`` and ``velocities`` in compiled C, or the same F.

    It is compiled once with the machine's C compiler, and kept in the user's cache. Without a compiler there is a
    warning, and Python is used. Not thread-safe: make one per thread.

    Parameters
    ----------
    control
        An inverse of polynomials, Fourier series, or their sums. Or a cell's inverse kinematic function, such as
        ``found.function``: then F, ``batch`` and its ``inverse`` are in C.

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
    wanted(control, RepeatableInverse, "inverse", "a repeatable inverse, such as design.inverse, or found.function")
    return RepeatableInverse(control.task, control.field, region=control.region, loops=compiled_loop)
