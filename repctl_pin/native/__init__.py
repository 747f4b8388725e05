"""The native library: C kernels of proofs, charts and motions, built when the package is installed.

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

_LIBRARY = Path(__file__).with_name("librepctl.so.1")

REMEDY = "install a C compiler (cc, gcc or clang), then install repctl_pin again"
"""How to get the native library."""


def library() -> ctypes.CDLL | None:
    """Load the native library; None if it is switched off, or missing, after one warning."""
    return None if os.environ.get("REPCTL_NATIVE") == "no" else _loaded()


@functools.cache
def _loaded() -> ctypes.CDLL | None:
    cause = "repctl_pin was installed without a C compiler"
    if _LIBRARY.exists():
        try:
            return ctypes.CDLL(str(_LIBRARY))
        except OSError as error:
            cause = f"it does not load ({error})"
    warnings.warn(
        f"no native library: {cause}, so proofs take 4 to 20 times as long; {REMEDY}",
        UserWarning,
        stacklevel=4,
    )
    return None


def _struct(
    *first: tuple[str, Any], ints: str = "", doubles: str = "", pointers: str = ""
) -> type[ctypes.Structure]:
    """Declare a C struct: its first members, then ints, doubles and pointers, names in a text."""
    members = [*first, *((name, ctypes.c_int) for name in ints.split())]
    members += [(name, ctypes.c_double) for name in doubles.split()]
    members += [(name, ctypes.c_void_p) for name in pointers.split()]
    return type("CStruct", (ctypes.Structure,), {"_fields_": members})


CHAIN = _struct(ints="P n m kind", pointers="revolute rows R p axis S offset")
"""The struct Chain of chain.h: the serial chain of a task."""

LAW = _struct(
    ("chain", ctypes.c_void_p),
    ints="stages steps r degree",
    doubles="gain sufficient",
    pointers="posture tensor center nodes weights xdot h most",
)
"""The struct Law of runge_kutta.c: a control law, and the motion that it makes."""

PROBLEM = _struct(
    ints="P k n N r Z F F3",
    doubles="eps beta",
    pointers="R p a shift reach revolute level first column S o "
    "Zq z0 kind parent variable third G C C3 T T4 E round",
)
"""The struct Problem of leaf_margin_bounds.h."""

SPACE = _struct(ints="k M", pointers="left right first starts")
"""The struct Space of taylor.h: the products of monomials."""

CELL = _struct(
    ("chain", ctypes.c_void_p),
    ("space", SPACE),
    ints="w terms F turning angled spun m removed turned slides",
    doubles="tool columns",
    pointers="parent variable used fourth parts rest blur near lower upper farthest "
    "o a d R0 D Omega angle spin way turn around twirl widths along beneath powers bases tips",
)
"""The struct Cell of cell_bounds.c."""

MARGINS = _struct(pointers="leaf sigma limit Q reach V split")
"""The struct Margins of cell_bounds.c."""

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
    """Create a C struct with pointers to arrays.

    Returns the struct, and the list of these arrays, which must live as long as the struct.
    """
    held: dict[str, NDArray[np.generic]] = {}
    held |= {
        name: np.ascontiguousarray(values, np.int32) for name, values in ints.items()
    }
    held |= {
        name: np.ascontiguousarray(values, float) for name, values in reals.items()
    }
    pointers = {name: values.ctypes.data for name, values in held.items()}
    return struct(**scalars, **pointers), list(held.values())
