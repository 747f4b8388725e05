"""A cell's inverse kinematic function in compiled C."""

from __future__ import annotations

import ctypes
from functools import cached_property

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..arguments import Array
from ..section import InverseFunction
from ..section.chart import Chart
from ..section.field import SectionField
from ..strategies.repeatable import RepeatableInverse
from .compiled_loop import GIVEN_LEAF, NAME, call_memory, compiled_loop, library


class CompiledFunction(InverseFunction):
    """``q = F(x; c)`` in C. What C refuses Python looks at again, and says why."""

    def __init__(self, chart: Chart, *, keep_limits: bool = True) -> None:
        super().__init__(chart, keep_limits=keep_limits)
        self._library = library(self)
        self._parts, self._address = call_memory(self.task)
        self._pose = self._parts["target"].reshape(4, 4)
        if self._library is not None:
            self._one = ctypes.PyDLL(self._library)[f"{NAME}_call_F"]
            self._many = ctypes.CDLL(self._library)[f"{NAME}_call_functions"]
            self._many.restype = ctypes.c_long

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
            Q, c = np.empty((len(U), self.task.n)), np.ascontiguousarray(c)
            arrays = (ctypes.c_void_p(array.ctypes.data) for array in (p, R, c, Q))
            if self._many(ctypes.c_long(len(U)), *arrays) == len(U):
                return Q
        return super()._batch(U, c)

    @cached_property
    def inverse(self) -> RepeatableInverse:
        """The control ``q̇ = ∂F/∂x ẋ``, in C too."""
        return RepeatableInverse(self.task, SectionField(self.chart), loops=compiled_loop)
