"""C structs of the kernels, with pointers to arrays."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .taylor import products


class Space(ctypes.Structure):
    """The struct Space of taylor.c."""

    _fields_ = [
        *((name, ctypes.c_int) for name in ("k", "M")),
        *((name, ctypes.c_void_p) for name in ("left", "right", "first", "starts")),
    ]


def space_of(k: int) -> tuple[Any, list[NDArray[np.generic]]]:
    """Create the struct Space of models in k variables, and the arrays that it points to."""
    pairs = products(k)
    return filled(
        Space,
        {
            "left": pairs.left,
            "right": pairs.right,
            "first": np.append(pairs.first, len(pairs.left)),
            "starts": pairs.starts,
        },
        {},
        {"k": k, "M": int(pairs.starts[-1])},
    )


def filled(
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
