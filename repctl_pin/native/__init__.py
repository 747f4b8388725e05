"""The native library: C code of proofs, cells and motions, built when the package is installed.

Its functions take C structs of sizes and pointers to arrays. Each struct is declared here with the
names of its members in C. ``REPCTL_NATIVE=no`` switches the library off.
"""

from __future__ import annotations

import ctypes
import functools
import os
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..base.errors import InputError

_LIBRARY = Path(__file__).with_name("librepctl.so.1")

_MISSING = (
    "is missing",
    "repctl_pin was installed without a C compiler",
    "install a C compiler (cc, gcc or clang), then install repctl_pin again",
)
"""State, cause and remedy that messages give if the library is missing."""

_OTHER = (
    "was built from other sources",
    "it was built from other sources than those beside it",
    "run `python repctl_pin/native/build.py`, or install repctl_pin again",
)
"""State, cause and remedy if the library was built from other sources: its structs may differ."""


def library() -> ctypes.CDLL | None:
    """Load the native library; None if it is switched off by ``REPCTL_NATIVE=no`` or unusable.

    A library is unusable if it is missing, does not load, or was built from other sources; the
    first call then gives a warning. Callers that also have a slower version in NumPy use this
    function; others use :func:`required_library`.
    """
    return None if os.environ.get("REPCTL_NATIVE") == "no" else _loaded()[0]


@functools.cache
def _loaded() -> tuple[ctypes.CDLL | None, str, str]:
    """Load the library and return (library, "", ""), or warn and return (None, fault, remedy).

    ``fault`` is a predicate such as "is missing"; fault and remedy complete an error message. The
    result is cached, so there is at most one warning. ``REPCTL_NATIVE`` is not read here.
    """
    state, cause, remedy = _MISSING
    if _LIBRARY.exists():
        try:
            native = ctypes.CDLL(str(_LIBRARY))
        except OSError as error:
            state, cause, remedy = "does not load", f"it does not load ({error})", _OTHER[-1]
        else:
            from .build import mark

            if mark() in _LIBRARY.read_bytes():
                return native, "", ""
            state, cause, remedy = _OTHER
    warnings.warn(
        f"no native library: {cause}, so governors and proofs do not run; {remedy}",
        UserWarning,
        stacklevel=4,
    )
    return None, state, remedy


def required_library(by: str, *, holds: bool = False) -> ctypes.CDLL:
    """Load the native library for a caller that requires it.

    ``by`` names the caller in the error message, such as "a governor". With ``holds``, Python's
    global interpreter lock is kept during each call of a C function, which makes short calls
    faster; without it, the lock is released.

    Raises
    ------
    InputError
        If the library is switched off or unusable; the message names the remedy.
    """
    native = library()
    if native is None:
        cause, remedy = "is switched off", "unset REPCTL_NATIVE"
        if os.environ.get("REPCTL_NATIVE") != "no":
            _, cause, remedy = _loaded()
        raise InputError(f"{by} requires the native library, which {cause}", remedy=remedy)
    return ctypes.PyDLL(native._name) if holds else native


def _struct(
    *first: tuple[str, Any], ints: str = "", doubles: str = "", pointers: str = ""
) -> type[ctypes.Structure]:
    """Declare a C struct for ctypes, with its members in the order of the C declaration.

    The members ``first`` are pairs (name, ctypes type). The int, double and pointer members follow,
    each kind given by its names in one text, separated by blanks.
    """
    members = [*first, *((name, ctypes.c_int) for name in ints.split())]
    members += [(name, ctypes.c_double) for name in doubles.split()]
    members += [(name, ctypes.c_void_p) for name in pointers.split()]
    return type("CStruct", (ctypes.Structure,), {"_fields_": members})


PART = _struct(
    ints="kind k count degree", pointers="joint parent factor center scale wave weight chart"
)
"""The struct Part of arm.h: one term of a sum of potentials."""

REGION = _struct(ints="count axes", pointers="center half axis position width chart")
"""The struct Region of arm.h."""

ARM = _struct(
    ints="n m joints kind coupled parts frames",
    pointers="revolute bent rows R p S offset lower upper part region frame",
)
"""The struct Arm of arm.h: the chain of a task; potentials, limits and a region."""

CLOSING = _struct(ints="count", doubles="square chord", pointers="p R")
"""The struct Closing of closing.h: the poses of a closing radius."""

CALL = _struct(pointers="arm q xdot twist leaf limit posture target numbers result inverse")
"""The struct Call of law_calls.c: the arguments of one thread."""

GOVERNOR_CALL = _struct(
    ints="room",
    doubles="dt",
    pointers="arm state limits target twist leaf q result samples ways kept last allows",
)
"""The struct GovernorCall of governor_calls.c: the arguments of one governor."""

TORQUE_CALL = _struct(pointers="arm q qdot inertia bias target twist leaf gains result")
"""The struct TorqueCall of governor_calls.c: the arguments of the torque law of one thread."""

CHART = _struct(
    ints="sector k removed bent terms both",
    doubles="radius height spin",
    pointers="moved coordinate joint parent factor row column "
    "p R sign origin basis turn profile center bounds scale lower upper weights",
)
"""The struct Chart of chart.h: a cell, and the chart of its function."""

CHART_CALL = _struct(ints="keep", pointers="arm chart target leaf result")
"""The struct ChartCall of chart_calls.c: the arguments of one thread."""

LAW = _struct(
    ("arm", ctypes.c_void_p),
    ints="stages steps on_leaf",
    doubles="gain",
    pointers="posture nodes weights xdot h most",
)
"""The struct Law of runge_kutta.c: a control law, and the motion that it makes."""

CHAIN = _struct(ints="P k n N", pointers="R p a shift reach revolute level first column S o")
"""The struct Chain of leaf_margin_bounds.h: the extended chain of one frame."""

PROBLEM = _struct(
    ints="frames n N r Z F F3",
    doubles="eps beta",
    pointers="frame Zq z0 kind parent variable third G C C3 T T4 E round",
)
"""The struct Problem of leaf_margin_bounds.h: chains of frames, and potentials."""

SPACE = _struct(ints="k M", pointers="left right first starts")
"""The struct Space of taylor.h: the products of monomials."""

CELL = _struct(
    ("chain", ctypes.c_void_p),
    ("space", SPACE),
    ints="r w terms F turning angled spun m removed turned slides bent radial upright levels",
    doubles="eps tool columns",
    pointers="parent variable used fourth parts rest blur near lower upper farthest "
    "o a d R0 D Omega angle spin way turn around twirl outward profile widths along beneath powers "
    "bases tips",
)
"""The struct Cell of cell_bounds.c."""

MARGINS = _struct(pointers="leaf sigma limit Q reach V split level")
"""The struct Margins of cell_bounds.c."""

BODY_TABLES = _struct(
    ints="joints bodies pairs",
    pointers="parent joint first second fixed sine versine origin slide centers radii turns halves "
    "block only_contact corners ball disc axis",
)
"""The struct BodyTables of body_bounds.c."""

BODY_GUARD = _struct(
    ints="pairs joints anchors room most at_once move nodes next left nearest excess",
    doubles="stop noise telling",
    pointers="tables reach turned kept rest anchor bound far lower way found rows best open which "
    "exact failed settled measure",
)
"""The struct BodyGuard of body_guard.c."""

ARM_ANGLE = _struct(
    ("space", SPACE),
    ints="P stereographic",
    pointers="R p a bases before revolute carries S o joint place direction",
)
"""The struct ArmAngle of arm_angle.c."""


def filled_struct(
    struct: type[ctypes.Structure],
    ints: Mapping[str, ArrayLike],
    reals: Mapping[str, ArrayLike],
    scalars: Mapping[str, Any],
) -> tuple[Any, list[NDArray[np.generic]]]:
    """Create a C struct whose pointers point to arrays, converted to C's types.

    ``ints`` and ``reals`` are arrays by member name, stored as int32 and double; ``scalars`` are
    the other members. Contiguous arrays of these types are not copied, so later changes of their
    entries have an effect in C. Returns the struct, and the list of the converted arrays. The
    struct's attribute ``held``, a dict of these arrays by name, keeps them in memory.
    """
    held: dict[str, NDArray[np.generic]] = {}
    held |= {name: np.ascontiguousarray(values, np.int32) for name, values in ints.items()}
    held |= {name: np.ascontiguousarray(values, float) for name, values in reals.items()}
    pointers = {name: values.ctypes.data for name, values in held.items()}
    made = struct(**scalars, **pointers)
    made.held = dict(held)
    return made, list(held.values())


def point(made: Any, name: str, structs: list[Any]) -> None:
    """Set the pointer ``name`` of a struct to an array of other structs.

    ``made`` is a filled C struct of ctypes; its attribute ``held`` keeps ``structs``, all of one
    type, and the array in memory. The array holds copies: later changes of a member of ``structs``
    have no effect in C.
    """
    row = (type(structs[0]) * len(structs))(*structs)
    setattr(made, name, ctypes.addressof(row))
    made.held |= {name: structs, f"{name} in a row": row}
