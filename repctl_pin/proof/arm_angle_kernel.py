"""C kernel of the Taylor models of an arm angle's gradient: arm_angle.c, compiled with taylor.c."""

from __future__ import annotations

import ctypes
from importlib.resources import files
from typing import Any

import numpy as np

from ..arguments import Array
from ..c_library import VECTOR_FLAGS, NoCompilerError, loaded_library
from .c_struct import Space, filled, space_of
from .taylor_chain import basis

_MOST = 8
"""Largest number of joints for which the models fit on the stack of a thread."""


class _Arm(ctypes.Structure):
    """The struct Arm of arm_angle.c."""

    _fields_ = [
        ("space", Space),
        *((name, ctypes.c_int) for name in ("P", "stereographic")),
        *(
            (name, ctypes.c_void_p)
            for name in (
                *("R", "p", "a", "bases", "before", "revolute", "carries"),
                *("S", "o", "joint", "place", "direction"),
            )
        ),
    ]


_loaded: dict[int, ctypes.CDLL | None] = {}


def library(terms: int) -> ctypes.CDLL | None:
    """Return the kernel for models of ``terms`` monomials; None without a compiler."""
    if terms not in _loaded:
        try:
            _loaded[terms] = ctypes.CDLL(loaded_library(source(terms), VECTOR_FLAGS))
        except (NoCompilerError, OSError):
            _loaded[terms] = None
    return _loaded[terms]


def source(terms: int) -> str:
    """Return the C source of the kernel for models of ``terms`` monomials."""
    folder = files(__package__)
    parts = [
        folder.joinpath(name).read_text(encoding="ascii")
        for name in ("taylor.c", "arm_angle.c")
    ]
    return "\n".join(["#include <math.h>", f"#define MOST {terms}", *parts])


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
    kernel = use or library(space.M)
    if kernel is None:
        return None
    arm, arrays = filled(
        _Arm,
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
    kernel.arm_gradients.restype = ctypes.c_int
    address = [ctypes.c_void_p(array.ctypes.data) for array in (Q, half, P, r)]
    done = kernel.arm_gradients(ctypes.byref(arm), ctypes.c_long(K), *address)
    del held, arrays
    if not done:
        raise MemoryError("no memory for the Taylor models of an arm angle")
    return P, r
