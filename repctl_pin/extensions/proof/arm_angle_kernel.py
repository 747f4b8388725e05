"""C kernel of the Taylor models of an arm angle's gradient: arm_angle.c."""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np

from ...arguments import Array
from ...native import ARM_ANGLE, filled_struct, library
from .taylor import basis, space_of

_MOST = 8
"""Largest number of joints that arm_angle.c has room for: their models are on the stack."""


def gradients_in_c(
    chain: Any, Q: Array, half: Array, use: ctypes.CDLL | None = None
) -> tuple[Array, Array] | None:
    """Compute Taylor models of a gradient (K, k) on boxes of the joints that move the arm angle.

    Returns their coefficients (K, k, M) and bounds (K, k); None without the native library, or if
    the arm angle depends on more than eight joints.
    """
    on = chain.moving
    if not 0 < len(on) <= _MOST:
        return None
    native = use or library()
    if native is None:
        return None
    space, _ = held = space_of(len(on))
    arm, arrays = filled_struct(
        ARM_ANGLE,
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
    address = [ctypes.c_void_p(array.ctypes.data) for array in (Q, half, P, r)]
    done = native.arm_gradients(ctypes.byref(arm), ctypes.c_long(K), *address)
    del held, arrays
    if not done:
        raise MemoryError("no memory for the Taylor models of an arm angle")
    return P, r
