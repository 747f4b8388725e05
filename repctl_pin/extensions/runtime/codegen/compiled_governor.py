"""Governor in C, called from Python; a tick takes some 10 µs."""

from __future__ import annotations

import ctypes
import warnings
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ....arguments import Array
from ....c_library import NoCompilerError, loaded_library
from ....model.chain_formulas import Placement
from ....motion.limits import Limits
from ....strategies.repeatable import RepeatableInverse
from ..governor import Governor, taken_input
from ..status import Status
from .compiled_loop import NAME
from .source import write_source

_DOUBLES = ctypes.POINTER(ctypes.c_double)
_BYTES = f"{NAME}_governor_bytes"


class CompiledGovernor(Governor):
    """Governor compiled to C, with the arguments, methods and results of :class:`Governor`.

    The code is compiled once by the system's C compiler, and stored in the user's cache. Without a
    compiler, a warning is given and :class:`Governor` runs in Python.

    Raises
    ------
    InputError
        As for :class:`Governor`, or if the potentials or the region cannot be written as C.
    """

    def __init__(
        self,
        inverse: RepeatableInverse,
        dt: float,
        limits: Limits,
        *,
        margin: float = 0.0,
    ) -> None:
        super().__init__(inverse, dt, limits, margin=margin)
        self._library = _library(inverse)
        if self._library is None:
            return
        bounds, n = self._bounds, self._task.n
        size = ctypes.c_ulong.in_dll(self._library, _BYTES).value
        self._state = ctypes.create_string_buffer(size)
        values = bounds.velocity, bounds.acceleration, bounds.jerk, [self._margin]
        self._limits: Array = np.concatenate(values)
        self._place, self._rates, self._next_q = np.zeros(12), np.zeros(6), np.zeros(n)
        self._run = self._library[f"{NAME}_governor_step"]

    def start(self, q: ArrayLike) -> None:
        """Start, or restart, at rest at a configuration; see :meth:`Governor.start`."""
        super().start(q)
        if self._library is not None:
            begin = self._library[f"{NAME}_governor_start"]
            dt, q = ctypes.c_double(self._bounds.dt), self.q
            status = begin(self._state, _address(q), dt, _address(self._limits))
            assert status == Status.OK, status  # Python refuses what C does

    def step(
        self, target: Placement | None = None, twist: ArrayLike | None = None
    ) -> tuple[Array, Status]:
        """Compute the next configuration and its status; see :meth:`Governor.step`."""
        if self._library is None:
            return super().step(target, twist)
        history = self._started().history
        goal, rates = taken_input(target, twist)
        if goal is not None:
            self._place[:3], self._place[3:] = goal.translation, goal.rotation.ravel()
        if rates is not None:
            self._rates[:] = rates
        status = self._run(
            self._state,
            None if goal is None else _address(self._place),
            None if rates is None else _address(self._rates),
            _address(self._next_q),
        )
        history[:-1], history[-1] = history[1:].copy(), self._next_q
        return self._next_q.copy(), Status(status)


def _address(values: Array) -> Any:
    return values.ctypes.data_as(_DOUBLES)


def _library(inverse: RepeatableInverse) -> ctypes.PyDLL | None:
    """Compile the governor of an inverse to a shared library, and load it.

    Returns None, after a warning, if there is no C compiler.
    """
    source = write_source(inverse, NAME, governor=True)
    size = f"const unsigned long {_BYTES} = sizeof({NAME}_governor);\n"
    code = source.code.replace(f'#include "{NAME}.h"', source.header) + size
    try:
        return ctypes.PyDLL(loaded_library(code))
    except NoCompilerError as error:
        warnings.warn(f"{error}; Python serves", UserWarning, stacklevel=4)
        return None
