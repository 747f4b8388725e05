"""C constants of a filled struct: its arrays, the structs it points to, and itself."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from typing import Any

import numpy as np

from .text import integer, row

_TYPES = {"frame": "Arm"}
"""Types of the members that do not bear their type's name."""


def constants(made: Any, kind: str, name: str) -> str:
    """Write a struct of :func:`repctl_pin.native.filled_struct` as ``static const`` C.

    Parameters
    ----------
    made
        The struct; ``made.held`` has its arrays, and the structs it points to, by member.
    kind
        Name of its type in C; a struct that the member ``x`` points to is an ``X``, a frame an
        ``Arm``.
    name
        Name of the constant; the names of its arrays begin with it.
    """
    return "\n".join(_definitions(made, kind, name)) + "\n"


def _definitions(made: Any, kind: str, name: str) -> Iterator[str]:
    entries = []
    for member, of in made._fields_:
        held = made.held.get(member)
        if of is not ctypes.c_void_p:
            entries.append(_number(getattr(made, member), of))
        elif held is None or len(held) == 0:
            entries.append("NULL")
        else:
            yield from _array(held, member, f"{name}_{member}")
            entries.append(f"{name}_{member}")
    yield f"static const {kind} {name}[1] = {{{{{', '.join(entries)}}}}};"


def _array(held: Any, member: str, name: str) -> Iterator[str]:
    """Write the array of numbers, or of structs, that a member points to."""
    if isinstance(held, np.ndarray):
        real = held.dtype.kind == "f"
        values = row(held.ravel()) if real else integer(held.ravel())
        yield f"static const {'double' if real else 'int'} {name}[{held.size}] = {values};"
        return
    kind, entries = _TYPES.get(member, member.capitalize()), []
    for k, one in enumerate(held):
        *arrays, last = _definitions(one, kind, f"{name}_{k}")
        yield from arrays
        entries.append(last.split(" = ")[1][1:-2])
    yield f"static const {kind} {name}[{len(held)}] = {{{', '.join(entries)}}};"


def _number(value: Any, of: Any) -> str:
    return row([value])[1:-1] if of is ctypes.c_double else str(value)
