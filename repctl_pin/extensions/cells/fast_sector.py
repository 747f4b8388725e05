"""Coordinates of a sector in control loops, for one placement at a time, computed with floats."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import atan2, cos, hypot, pi, sin

import numpy as np
import pinocchio as pin

from ...arguments import Array
from .cell import EDGE
from .sector import Sector


@dataclass(frozen=True, eq=False)
class FastCoordinates:
    """Functions that convert placements to coordinates u of a cell; for one thread.

    Attributes
    ----------
    u : (k,) array
        Output array of ``locate``: the coordinates.
    locate : function (p, R) → float
        Write the coordinates of a placement into ``u``. Return the deviation of the placement from
        the cell in the coordinates of width 0, m or rad.
    pull : function (D, X) → None
        Write ``X = D ∂u/∂x`` (r, m) for D (r, k), at the placement of the last call of ``locate``.
        X must be 0 before the first call.
    shift : (n,) array or None
        Output array of ``locate``: the term that the symmetries of a sector add to F; D then has
        k + l columns. None without symmetries.
    """

    u: Array
    locate: Callable[[Array, Array], float]
    pull: Callable[[Array, Array], None]
    shift: Array | None = None


def sector_coordinates(cell: Sector) -> FastCoordinates:
    """Make the functions that convert placements to coordinates of a sector.

    ``locate`` returns infinity outside the range of a symmetric coordinate.
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
    removed, rows = cell._removed, cell.task.rows[: min(3, m)].tolist()
    spin_middle = cell.spin_middle
    every: list[float] = []  # of the last placement, as its rotation in ``frame``
    frame: list[Array] = []
    pose = cell.task.kind == "pose"
    turns = pose or cell.task.kind == "axis"

    def locate(p: Array, R: Array) -> float:
        x, y, height = B.dot(p - origin).tolist()
        angle = atan2(y, x)
        every[:] = hypot(x, y) - rho, angle, height - z
        frame[:] = [R]
        if turns:
            every.extend(_turns(C, B.dot(R), angle))
            every[5] -= 2 * pi * round((every[5] - spin_middle) / (2 * pi))
        for i, k in enumerate(on):
            u[i] = every[k] / widths[k]
        inside = True
        for (
            k,
            joint,
            sign,
            most,
        ) in turned:  # all of them: potentials are evaluated outside, too
            inside = inside and abs(every[k]) <= most
            shift[joint] = sign * every[k]
        return max([abs(every[k]) for k in held], default=0.0) if inside else np.inf

    def pull(D: Array, X: Array) -> None:
        radius, angle = rho + every[0], every[1]
        c, s = cos(angle), sin(angle)
        directions = _back(c, s).dot(B).tolist()  # outward, around, along
        onto = _per_tilt(frame[0], B, C, c, s, every) if turns else None
        for slopes, out in zip(D.tolist(), X, strict=True):
            d = [0.0] * len(every)
            for i, k in enumerate(on):
                d[k] = slopes[i] / widths[k]
            for i, k in enumerate(removed):
                d[k] = slopes[len(on) + i]
            g, round_about = None, d[1]
            if onto is not None:
                A, about = onto
                g = _solved(A, d[3:])
                round_about -= about[0] * g[0] + about[1] * g[1] + about[2] * g[2]
            parts = zip(*directions, strict=True)
            v = [d[0] * e + round_about / radius * f + d[2] * a for e, f, a in parts]
            out[: len(rows)] = [v[row] for row in rows]
            if g is not None:
                out[3:] = frame[0].dot(g) if pose else g[:2]

    return FastCoordinates(u, locate, pull, shift if cell.removed else None)


def _back(c: float, s: float) -> Array:
    """Return the matrix of the rotation by −φ about the sector's axis, in its ``directions``.

    c and s are cos φ and sin φ.
    """
    return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


def _per_tilt(
    R: Array, B: Array, C: Array, c: float, s: float, every: list[float]
) -> tuple[list[list[float]], list[float]]:
    """Evaluate the angular velocity, in axes of the frame, per rad/s of tilts and angle.

    Return the two columns of the tilts as rows of a matrix, and the column (3,) of the angle φ.
    """
    J_l = pin.Jexp3(np.array([*every[3:5], 0.0])).T  # Jexp3 is J_r, its transpose J_l
    own = R.T.dot(B.T)
    A = own.dot(_back(c, s).T.dot(C)).dot(J_l[:, :2])
    return A.T.tolist(), own[:, 2].tolist()


def _solved(A: list[list[float]], d: list[float]) -> list[float]:
    """Convert a gradient d (3,) with respect to tilts and spin to one with respect to rotation.

    The rotation is in axes of the frame; A is the matrix of :func:`_per_tilt`. The result is a list
    of three numbers.
    """
    (a, b, e), (f, g, h) = A
    first, second, spin = d[0] - e * d[2], d[1] - h * d[2], d[2]
    det = a * g - b * f
    return [(first * g - second * b) / det, (second * a - first * f) / det, spin]


def _most(cell: Sector, i: int) -> float:
    return np.inf if i in cell.free else float(cell.widths[i]) * (1 + EDGE)


def _turns(C: Array, turned: Array, angle: float) -> list[float]:
    """Compute the two tilts and the spin, rad, of a target at the angle φ of the sector.

    They follow from the rotation ``R_0ᵀ R_a(−φ) R``. C and ``turned`` are the rotations R_0 of the
    middle and R of the target, in the ``directions`` of the sector.
    """
    back = _back(cos(angle), sin(angle))
    (a, _, x), (d, _, y), (g, _, h) = C.T.dot(back.dot(turned)).tolist()
    sine = hypot(x, y)
    theta = atan2(sine, h)
    # the axis of the rotation back; at 0 and at half a turn it is chosen
    first, second = (y / sine, -x / sine) if sine else (-1.0, 0.0)
    c, s = cos(theta), sin(theta)
    along = (first * a + second * d) * (1 - c)
    spin = atan2(
        d * c - first * g * s + second * along, a * c + second * g * s + first * along
    )
    return [-first * theta, -second * theta, spin]
