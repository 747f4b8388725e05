"""Argument validation: convert the value, or raise a one-line InputError.

The error names the argument and the remedy. In its message, ``name`` is the argument's name,
``each`` or ``what`` describes the required value, and ``unit`` is the unit of the value. Each
function returns the checked or converted value.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from inspect import signature
from os import PathLike
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import InputError, unknown

Array = NDArray[np.float64]
T = TypeVar("T")
F = TypeVar("F", bound=Callable[..., Any])

FLOAT = np.dtype(float)
"""NumPy type of doubles in native byte order, which compiled code takes without conversion."""

MOST_NODES = 2**22
"""Maximum number of nodes of a region, limited by memory and time."""

_MIN_LENGTH = 1e-12
"""Minimum length by which joint positions may be divided, rad or m."""

MOST_STEPS = 10_000_000
"""Maximum number of steps of a motion."""


def require_type(value: Any, kind: type[T], name: str, what: str) -> T:
    """Require an instance of a class or runtime protocol, and return it.

    Parameters
    ----------
    value, kind
        The argument, and its required type.
    name
        Name of the argument.
    what
        Description of the type, with an example: ``"a closed path, such as rp.circle(task, q0)"``.

    Raises
    ------
    InputError
        If the argument is of another type, or is itself a class.
    """
    if isinstance(value, kind) and not isinstance(value, type):
        return value
    raise InputError(f"must be {what}; got {shown(value)}", argument=name)


def function(value: F, name: str, what: str, takes: int = 1) -> F:
    """Require a function of ``takes`` positional arguments, and return it."""
    if callable(value) and not isinstance(value, type) and _binds(value, takes):
        return value
    raise InputError(f"must be {what}; got {shown(value)}", argument=name)


def _binds(value: Callable[..., Any], takes: int) -> bool:
    """Test whether a callable accepts ``takes`` arguments; True if its signature is not known.

    Some functions of compiled code have no signature. The function is not called.
    """
    try:
        signature(value).bind(*[None] * takes)
    except TypeError:
        return False
    except ValueError:  # a built-in function
        return True
    return True


def require_choice(value: Any, names: Iterable[str], kind: str) -> str:
    """Require one of the texts ``names``, and return it; else raise an InputError.

    ``kind`` is the noun for such a name in the message, for example ``goal``: "unknown goal …".
    """
    names = tuple(names)
    if isinstance(value, str) and value in names:
        return value
    raise unknown(kind, value if isinstance(value, str) else shown(value), names)


def as_int(value: Any, name: str, least: int = 0, most: int | None = None) -> int:
    """Convert an argument to an integer from ``least`` to ``most``; None means no upper bound."""
    number = _number(value)
    if not (math.isfinite(number) and number == int(number) and number >= least):
        raise InputError(
            f"must be a whole number from {least} up, not {shown(value)}", argument=name
        )
    if most is not None and number > most:
        raise InputError(f"can be at most {most:,}, not {shown(value)}", argument=name)
    return int(value) if isinstance(value, int) else int(number)


def positive(value: Any, name: str, unit: str = "", *, zero: bool = False) -> float:
    """Convert an argument to a finite number above 0; with ``zero=True``, 0 is allowed, too."""
    number = _number(value)
    if not (math.isfinite(number) and (number > 0 or (zero and number == 0))):
        least = f"0{unit and ' '}{unit} or more" if zero else f"above 0{unit and ' '}{unit}"
        raise InputError(
            f"must be {least}{' and finite' if number > 0 else ''}, not {shown(value)}",
            argument=name,
        )
    return number


def finite(value: Any, name: str, unit: str = "") -> float:
    """Convert an argument to a finite number of any sign; ``unit`` is named in the message."""
    number = _number(value)
    if not math.isfinite(number):
        number_of = f"a finite number{unit and ', '}{unit}"
        raise InputError(f"must be {number_of}, not {shown(value)}", argument=name)
    return number


def vector(values: ArrayLike, n: int | None, name: str, each: str = "one per joint") -> Array:
    """Copy n finite numbers to an array (n,); with n = None, one or more numbers.

    ``each`` describes one number in the message, such as ``one per joint``.
    """
    array = as_numbers(values)
    wrong = array is None or array.ndim != 1 or not array.size or n not in (None, array.size)
    if array is None or wrong or not np.isfinite(array).all():
        count = f"{n} finite numbers" if n is not None else "a list of finite numbers"
        raise InputError(
            f"must be {count}{each and ', '}{each}; got {_shape(values, array)}", argument=name
        )
    return array


def per_joint(
    values: ArrayLike, n: int, name: str, each: str = "one per joint", *, finite: bool = False
) -> Array:
    """Convert one number above 0, or n numbers above 0, to an array (n,); a single one is repeated.

    Infinity is allowed unless ``finite`` is True. With ``finite``, the numbers must be at least
    1e-12, because the caller divides joint positions by them.
    """
    array = as_numbers(values)
    most = (
        array is not None
        and array.shape in ((), (1,), (n,))
        and (not finite or np.isfinite(array).all())
    )
    if array is None or not most or not (array > 0).all():
        what = "finite number" if finite else "number"
        raise InputError(
            f"must be one {what} above 0 or {n} of them, {each}; got {shown(values)}", argument=name
        )
    if finite and (array < _MIN_LENGTH).any():
        raise InputError(
            f"must be at least {_MIN_LENGTH:g}, to exceed the rounding error of a joint position; "
            f"got {shown(values)}",
            argument=name,
        )
    return np.full(n, array) if array.size == 1 else array


def limits(values: ArrayLike, n: int, name: str, each: str = "one per joint") -> Array:
    """Convert n limits to an array (n,); infinity stands for no limit, and NaN is refused.

    ``each`` describes one number in the message.
    """
    array = as_numbers(values)
    if array is None or array.shape != (n,) or np.isnan(array).any():
        raise InputError(f"must be {n} numbers, {each}; got {shown(values)}", argument=name)
    return array


def as_configurations(values: ArrayLike, n: int | None, whose: str) -> Array:
    """Convert finite configurations, one per row, to an array (K, n); with n = None, any n.

    Anything else raises an InputError. ``whose`` is the noun at the beginning of its message, such
    as ``this cell``: "this cell takes Q …". A single configuration (n,) is refused, too, and the
    message then says to write ``[q]``.
    """
    array = as_numbers(values)
    if (
        array is None
        or array.ndim != 2
        or n not in (None, array.shape[1])
        or not np.isfinite(array).all()
    ):
        width = f"(K, {n}), {n} finite numbers per row"
        if n is None:
            width = "(K, n), one number per joint"
        single = (
            "; write [q] for a single q" if array is not None and n in (None, array.size) else ""
        )
        raise InputError(
            f"{whose} takes Q as an array {width}; got {_shape(values, array)}{single}"
        )
    return array


def as_matrices(
    *given: tuple[str, ArrayLike, str], exact: bool = False, finite: bool = True
) -> list[Array]:
    """Convert stacks of matrices to float arrays, and check that their sizes match.

    Each stack is given as (name, array, axes), such as ``("J", J, "m n"), ("V", V, "n r")``.
    ``axes`` has the required sizes of the array's last axes. A size is a number, or a letter that
    stands for the same size in all arrays. Only the sizes ``r`` and ``K`` can be 0. The leading
    axes, before these last ones, must broadcast between the arrays; with ``exact``, no array can
    have leading axes. Without ``finite``, NaN and infinity are accepted. The arrays are returned in
    the given order; an array of doubles is not copied.
    """
    sizes: dict[str, int] = {}
    arrays = []
    for name, values, axes in given:
        letters = axes.split()
        native = type(values) is np.ndarray and values.dtype is FLOAT  # not copied
        array: Array | None = values if native else as_numbers(values)  # type: ignore[assignment]
        last = () if array is None else array.shape[-len(letters) :]
        fits = len(last) == len(letters) and (not exact or array is None or array.ndim == len(last))
        fits = fits and all(
            size == (int(x) if x.isdecimal() else sizes.setdefault(x, size)) and (size or x in "rK")
            for x, size in zip(letters, last, strict=True)
        )
        if array is None or not fits or (finite and not np.isfinite(array).all()):
            known = "" if name == given[0][0] else _known(letters, sizes)
            shape = f"({'' if exact else '..., '}{', '.join(letters)}){known and ' with '}{known}"
            what = "finite numbers" if finite else "numbers"
            raise InputError(f"must be {what} {shape}; got {_shape(values, array)}", argument=name)
        arrays.append(array)
    _require_broadcast(arrays, given)
    return arrays


def _known(letters: Sequence[str], sizes: Mapping[str, int]) -> str:
    """Format the known sizes of an array's axes, as ``n = 7``; empty if none is known.

    ``letters`` name the axes of the array, as in (K, n). ``sizes`` has the known sizes by letter.
    """
    return ", ".join(f"{x} = {sizes[x]}" for x in letters if x in sizes)


def _require_broadcast(
    arrays: Sequence[Array], given: Sequence[tuple[str, ArrayLike, str]]
) -> None:
    """Raise InputError unless the leading axes of stacks of matrices broadcast.

    ``arrays`` are the converted arrays, and ``given`` their names, values and axes, for the
    message.
    """
    leading = [
        a.shape[: a.ndim - len(axes.split())] for a, (_, _, axes) in zip(arrays, given, strict=True)
    ]
    if len(set(leading)) > 1:
        try:
            np.broadcast_shapes(*leading)
        except ValueError:
            names = ", ".join(name for name, _, _ in given)
            raise InputError(
                f"{names} have different leading sizes: {leading}; "
                "give arrays for the same configurations"
            ) from None


def evaluated(
    function: Callable[..., ArrayLike], q: Array, shape: tuple[int, ...], what: str, *more: Array
) -> Array:
    """Call a user's function as ``function(q, *more)``; return its result as an array of a shape.

    ``what`` names the result in the message, such as ``the gradient of h``.

    Raises
    ------
    InputError
        If the result does not have this shape, or is not finite; the message shows q.
    """
    required = " × ".join(map(str, shape)) + " finite numbers"
    try:
        values, why = np.array(function(q, *more), dtype=float), ""
    except (TypeError, ValueError, IndexError) as error:
        values, why = np.full(shape, np.nan), f": {error}"
    if not shape:
        required = "one finite number"
        values = values.reshape(()) if values.size == 1 else values
    if values.shape != shape or not np.isfinite(values).all():
        raise InputError(f"{what} must be {required}, but is not at q = {row(q)}{why}")
    return values


def flag(value: Any, name: str) -> bool:
    """Require True or False, or 1 or 0, and return it as a bool."""
    if isinstance(value, (bool, np.bool_)) or (isinstance(value, int) and value in (0, 1)):
        return bool(value)
    raise InputError(f"must be True or False, not {shown(value)}", argument=name)


def progress_option(value: Any) -> Any:
    """Require True, False, or a function of two arguments, for ``progress``; return the value."""
    if not callable(value):
        return flag(value, "progress")
    what = "True, False or a function of the step (text) and the fraction done"
    return function(value, "progress", what, 2)


def list_of(values: Any, name: str, what: str) -> list[Any]:
    """Convert an iterable to a list; refuse text and mappings.

    A text would become a list of its letters, which the user never means.
    """
    no_list = isinstance(values, (str, bytes, type, Mapping)) or (
        isinstance(values, np.ndarray) and values.ndim != 1
    )
    if isinstance(values, Iterable) and not no_list:
        return list(values)
    raise InputError(f"must be {what}, not {shown(values)}", argument=name)


def list_of_names(values: Any, name: str, what: str) -> tuple[str, ...]:
    """Convert one name, or a list of names, to a tuple."""
    listed = (values,) if isinstance(values, str) else tuple(list_of(values, name, what))
    if all(isinstance(v, str) for v in listed):
        return listed
    raise InputError(f"must be {what}, not {shown(values)}", argument=name)


def freeze(made: object, /, **values: Any) -> None:
    """Set the attributes ``values`` of a frozen dataclass object; arrays become read-only views.

    The ``__post_init__`` of the object ``made`` calls this function, because a frozen object allows
    no ordinary assignment. The caller's own arrays stay writable.
    """
    for name, value in values.items():
        kept = unwritable(value) if isinstance(value, np.ndarray) else value
        object.__setattr__(made, name, kept)


def unwritable(array: NDArray[Any]) -> NDArray[Any]:
    """Return a read-only view of an array, or the array itself if it is read-only."""
    if not array.flags.writeable:
        return array
    view = array.view()
    view.setflags(write=False)
    return view


def read_only(cls: type[T]) -> type[T]:
    """Class decorator, below ``@dataclass``: make array fields of a frozen dataclass read-only.

    Copied and unpickled objects are read-only, too. The caller's arrays stay writable.
    """
    checks = getattr(cls, "__post_init__", None)

    def __post_init__(self: Any) -> None:
        if checks is not None:
            checks(self)
        freeze(self, **vars(self))

    def __setstate__(self: Any, state: dict[str, Any]) -> None:
        freeze(self, **state)

    cls.__post_init__ = __post_init__  # type: ignore[attr-defined]
    cls.__setstate__ = __setstate__  # type: ignore[attr-defined]
    return cls


def row(q: Array) -> str:
    """Format a configuration for a message, such as ``(0.1, -1.571)``."""
    return "(" + ", ".join(f"{value:.4g}" for value in np.ravel(q)) + ")"


def percentage(share: float) -> str:
    """Format a fraction, 0 to 1, in per cent: ``5.8 %``; only exactly 0 and 1 give 0 and 100 %."""
    if 0 < share < 0.0005:
        return "< 0.1 %"
    if 0.9995 <= share < 1:
        return "> 99.9 %"
    return f"{100 * share:.0f} %" if share in (0, 1) else f"{100 * share:.1f} %"


def ratio_in_percent(ratio: float, digits: int = 3) -> str:
    """Format a ratio in per cent, with ``digits`` digits and no exponent: ``0.0899 %``, ``1234 %``.

    Ratios above 0 and below 1e-5 give ``under 0.001 %``.
    """
    value = 100 * ratio
    if 0 < value < 1e-3:
        return "under 0.001 %"
    large = abs(value) >= 10**digits
    return f"{value:.0f} %" if large else f"{value:.{digits}g} %"


def file_name(value: Any, name: str = "file") -> Path:
    """Convert the name of a file or folder to a path."""
    if isinstance(value, (str, PathLike)) and str(value) and "\0" not in str(value):
        return Path(value)
    raise InputError(f"must be a file's name, not {shown(value)}", argument=name)


def _number(value: Any) -> float:
    """Convert a number to a float; NaN if it is not a number, so that the caller refuses it.

    A text such as ``"1"`` does not count as a number, and neither does an array.
    """
    if type(value) is float:  # the usual case
        return value
    try:
        return (
            math.nan
            if isinstance(value, (str, bytes, bytearray)) or np.ndim(value)
            else float(value)
        )
    except (TypeError, ValueError, OverflowError):
        return math.nan


def as_numbers(values: ArrayLike) -> Array | None:
    """Copy numbers of any shape to an array of doubles; None if they are ragged or not numbers.

    The caller raises the error for None, because only the caller knows what was required.
    """
    try:
        array = np.asarray(values)
        return np.array(array, dtype=float, order="C") if array.dtype.kind in "biuf" else None
    except (TypeError, ValueError, OverflowError):
        return None


def _shape(values: ArrayLike, array: Array | None) -> str:
    if array is None:
        return shown(values)
    return f"shape {array.shape}" if np.isfinite(array).all() else "numbers that are not finite"


def shown(value: Any) -> str:
    """Format a value for a message, on one line of at most 60 characters.

    A user's value can be long, or contain terminal control sequences.
    """
    text = " ".join(repr(value).split())
    text = text if len(text) <= 60 else f"{text[:59]}…"
    return text.encode("unicode_escape").decode() if not text.isprintable() else text
