"""C kernel of the Taylor models of an arm angle's gradient: arm_angle.c, compiled with taylor.c."""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np

from ..arguments import Array
from ..c_library import VECTOR_FLAGS, c_struct, filled_struct, kernel
from .taylor import SPACE, space_of
from .taylor_chain import basis

_SOURCES = "taylor.c", "arm_angle.c"

_MOST = 8
"""Largest number of joints for which the models fit on the stack of a thread."""


_ARM = c_struct(
    ("space", SPACE),
    ints="P stereographic",
    pointers="R p a bases before revolute carries S o joint place direction",
)
"""The struct Arm of arm_angle.c."""


def gradients_in_c(
    chain: Any, Q: Array, half: Array, use: ctypes.CDLL | None = None
) -> tuple[Array, Array] | None:
    """Compute Taylor models of a gradient (K, k) on boxes of the joints that move the arm angle.

    Returns their coefficients (K, k, M) and bounds (K, k); None without a compiler, or if the arm
    angle depends on more than eight joints.
    """
    on = chain.moving
    if not 0 < len(on) <= _MOST:
        return None
    space, _ = held = space_of(len(on))
    header = f"#include <math.h>\n#define MOST {space.M}"
    library = use or kernel(__package__, *_SOURCES, header=header, flags=VECTOR_FLAGS)
    if library is None:
        return None
    arm, arrays = filled_struct(
        _ARM,
        {
            "before": chain.before,
            "revolute": chain.revolute,
            "carries": chain.carries,
            "joint": chain.joint,
        },
        {name: getattr(chain, name) for name in ("R", "p", "a", "o", "place")}
        | {"bases": [basis(axis) for axis in chain.a], "S": chain.S[:, on]}
        | {"direction": chain.direction},
        {"space": space, "P": len(chain.p), "stereographic": int(chain.stereographic)},
    )
    K, k = Q.shape
    P, r = np.zeros((K, k, space.M)), np.zeros((K, k))
    Q, half = np.ascontiguousarray(Q, float), np.ascontiguousarray(half, float)
    library.arm_gradients.restype = ctypes.c_int
    address = [ctypes.c_void_p(array.ctypes.data) for array in (Q, half, P, r)]
    done = library.arm_gradients(ctypes.byref(arm), ctypes.c_long(K), *address)
    del held, arrays
    if not done:
        raise MemoryError("no memory for the Taylor models of an arm angle")
    return P, r
