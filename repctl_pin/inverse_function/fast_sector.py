"""Coordinates of a sector in control loops: one placement at a time, in plain floats."""

from __future__ import annotations

from collections.abc import Callable
from math import atan2, cos, hypot, pi, sin

import numpy as np

from ..arguments import Array
from .sector import Sector

_EDGE = 1e-9

Located = tuple[Array, Array, Callable[[Array, Array], float], Callable[[Array, Array], None]]


def closures(cell: Sector) -> Located:
    """Make the memory of u (k,) and of the shift (n,) of the symmetries, and two functions.

    The first writes both of a placement (p, R), and returns the distance along held coordinates, m
    or rad, or infinity beyond a symmetric one. The second writes ``X = D ∂u/∂x`` for D (r, k + l).
    """
    m, (rho, z), B = cell.task.m, cell.middle, np.ascontiguousarray(cell.directions)
    origin, C = cell.axis[0].copy(), np.ascontiguousarray(B @ cell.placement.rotation)
    u, shift = np.zeros(cell.k), np.zeros(cell.task.n)
    on, widths = cell.moved.tolist(), cell.widths.tolist()
    held = [i for i in range(m) if not widths[i]]
    turned = [
        (one.coordinate, one.joint, float(one.sign), _most(cell, one.coordinate))
        for one in cell.removed
    ]
    here = [np.zeros((1, 3)), np.eye(3)[None]]

    def locate(p: Array, R: Array) -> float:
        here[0], here[1] = p[None], R[None]
        x, y, height = B.dot(p - origin).tolist()
        angle = atan2(y, x)
        every = [hypot(x, y) - rho, angle, height - z]
        if m > 3:
            every += _turns(C, B.dot(R), angle)
        for i, k in enumerate(on):
            u[i] = every[k] / widths[k]
        for k, joint, sign, most in turned:
            if not abs(every[k]) <= most:
                return np.inf
            shift[joint] = sign * every[k]
        return max([abs(every[k]) for k in held], default=0.0)

    def pull(D: Array, X: Array) -> None:
        X[:] = D @ cell.slopes(here[0], here[1])[1][0]

    return u, shift, locate, pull


def _most(cell: Sector, i: int) -> float:
    return np.inf if i in cell.free else float(cell.widths[i]) * (1 + _EDGE)


def _turns(C: Array, turned: Array, angle: float) -> list[float]:
    """Measure the tilts and the spin, from the rotations of middle and target in the directions of
    the middle: ``T = R_0ᵀ R_a(−φ) R``."""
    c, s = cos(angle), sin(angle)
    back = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    (a, _, x), (d, _, y), (g, _, h) = C.T.dot(back.dot(turned)).tolist()
    sine = hypot(x, y)
    if sine < 1e-12:
        tilt = (0.0 if h > 0 else pi, 0.0)
        return [*tilt, atan2(d, a) if h > 0 else atan2(-d, a)]
    theta = atan2(sine, h)
    first, second = y / sine, -x / sine  # the axis of the rotation back, less its sign
    along = (first * a + second * d) * (1 - h / hypot(sine, h))
    cosine = h / hypot(sine, h)
    sine = sin(theta)
    spin = atan2(
        d * cosine - first * g * sine + second * along,
        a * cosine + second * g * sine + first * along,
    )
    return [-y * theta / hypot(x, y), x * theta / hypot(x, y), spin]
