"""A repeatable control in compiled C, called from Python."""

from __future__ import annotations

from typing import overload

from ..arguments import wanted
from ..section import InverseFunction
from ..strategies.repeatable import RepeatableInverse
from .compiled_function import CompiledFunction
from .compiled_loop import compiled_loop


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
