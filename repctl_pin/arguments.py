"""What a person gives to a function: taken as it is meant, or refused in one line that names it and the remedy."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import InputError

Array = NDArray[np.float64]


def wanted(value: Any, kind: Any, name: str, what: str) -> Any:
    """Take an argument of one kind, a class or a runtime protocol.

    Parameters
    ----------
    value, kind
        What was given, and what it should be.
    name
        What the argument is called.
    what
        What to give, in words and with an example: ``"a closed path, such as rp.circle(task, q0)"``.

    Raises
    ------
    InputError
        If it is of another kind.
    """
    if isinstance(value, kind):
        return value
    raise InputError(f"{name} must be {what}; got {_shown(value)}")


def whole(value: Any, name: str, least: int = 0) -> int:
    """Take a whole number."""
    number = _number(value)
    if not (math.isfinite(number) and number == int(number) and number >= least):
        raise InputError(f"{name} must be a whole number from {least} up, not {_shown(value)}")
    return int(number)


def positive(value: Any, name: str, unit: str = "", *, zero: bool = False) -> float:
    """Take a finite number above 0, or 0 itself where that is allowed."""
    number = _number(value)
    if not (math.isfinite(number) and (number > 0 or (zero and number == 0))):
        least = f"0{unit and ' '}{unit} or more" if zero else f"above 0{unit and ' '}{unit}"
        raise InputError(f"{name} must be {least}, not {_shown(value)}")
    return number


def vector(values: ArrayLike, n: int, name: str) -> Array:
    """Take n finite numbers, one a joint: (n,)."""
    array = _array(values)
    if array is None or array.shape != (n,) or not np.isfinite(array).all():
        raise InputError(f"{name} must be {n} finite numbers, one a joint; got {_shape(values, array)}")
    return array


def rows(values: ArrayLike, n: int | None, whose: str) -> Array:
    """Take configurations (K, n), finite, one a row; with n = None of any length."""
    array = _array(values)
    if array is None or array.ndim != 2 or n not in (None, array.shape[1]) or not np.isfinite(array).all():
        width = "(K, n), one number a joint" if n is None else f"(K, {n}), {n} finite numbers a row"
        single = ": write [q] for a single q" if array is not None and n in (None, array.size) else ""
        raise InputError(f"{whose} takes Q as an array {width}; got {_shape(values, array)}{single}")
    return array


def _number(value: Any) -> float:
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError):
        return math.nan


def _array(values: ArrayLike) -> Array | None:
    try:
        return np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        return None


def _shape(values: ArrayLike, array: Array | None) -> str:
    if array is None:
        return _shown(values)
    return f"shape {array.shape}" if np.isfinite(array).all() else "numbers that are not finite"


def _shown(value: Any) -> str:
    text = " ".join(repr(value).split())
    return text if len(text) <= 60 else f"{text[:59]}…"
