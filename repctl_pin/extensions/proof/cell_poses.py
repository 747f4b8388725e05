"""Poses of a cell or a sector as formulas of its coordinates u, for Taylor models in C.

They consist of rotations, a linear displacement and a matrix exponential.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arguments import Array, read_only
from ..cells.cell import Cell
from ..cells.sector import ANGLE, HEIGHT, RADIUS, SPIN, Sector

_TILT = 3
"""Index of a sector's first tilt among the coordinates of the task."""


@dataclass(frozen=True, eq=False)
@read_only
class Poses:
    r"""Poses (p, R) of a cell as functions of its coordinates u, and how they move.

    ``p = o + R_a(φ) (d + D u)``, ``R = R_a(φ) exp(\hat{Ω u}) R_0 R_z(ψ)``: R_a rotates about a
    sector's axis, R_z about the tool's z axis. The angles φ and ψ are linear in u.

    The velocity of the pose is known along each of the m coordinates of the task: the k of u, then
    those that symmetries remove from u, then those of width 0.

    Attributes
    ----------
    o, a : (3,) arrays
        Point, m, and direction of the axis of R_a.
    d, R0 : (3,) and (3, 3) arrays
        Position relative to o, m, and orientation of the cell's centre.
    D, Omega : (3, k) arrays
        Displacement, m, and rotation, rad, per coordinate.
    angle, spin : (k,) arrays
        φ and ψ per coordinate, rad; 0 in a cell that is not a sector.
    way, turn : (m, 3) arrays
        Displacement and rotation per metre or radian of each coordinate of the task, before R_a.
    around, twirl : (m,) arrays
        1 for the coordinate φ, and 1 for the coordinate ψ; 0 for others.
    widths : (k,) array
        Metres or radians per unit of u.
    along : (n, l) array
        Motion of the joints along the coordinates that symmetries remove.
    """

    o: Array
    a: Array
    d: Array
    R0: Array
    D: Array
    Omega: Array
    angle: Array
    spin: Array
    way: Array
    turn: Array
    around: Array
    twirl: Array
    widths: Array
    along: Array

    @classmethod
    def of(cls, cell: Cell) -> Poses:
        """Create the formulas for the coordinates u of a cell or a sector."""
        k, m, R0 = cell.k, cell.task.m, cell.placement.rotation
        away = cell.placement.translation
        way, turn = np.zeros((m, 3)), np.zeros((m, 3))
        around, twirl = np.zeros(m), np.zeros(m)
        o, a = np.zeros(3), np.array([0.0, 0.0, 1.0])
        if isinstance(cell, Sector):
            o, a = cell.axis
            away = away - o
            outward, _, up = cell.directions
            way[RADIUS], around[ANGLE] = outward, 1.0
            if m > HEIGHT:
                way[HEIGHT] = up
            if m > _TILT:
                turn[_TILT : _TILT + 2] = R0[:, :2].T
            if m > SPIN:
                twirl[SPIN] = 1.0
        else:
            rows = cell.task.rows[: len(cell.half_width)]
            way[: len(rows)] = np.eye(3)[rows]
            about = np.eye(3) if cell.task.kind == "pose" else R0.T
            turn[len(rows) :] = about[: m - len(rows)]
        moved, removed = cell.moved, np.array(cell._removed, int)
        others = np.setdiff1d(np.arange(m), np.concatenate([moved, removed]))
        order = np.concatenate([moved, removed, others])
        way, turn, around, twirl = way[order], turn[order], around[order], twirl[order]
        widths = cell.widths[moved]
        return cls(
            o,
            a,
            away,
            R0,
            (widths[:, None] * way[:k]).T,
            (widths[:, None] * turn[:k]).T,
            widths * around[:k],
            widths * twirl[:k],
            way,
            turn,
            around,
            twirl,
            widths,
            cell.along,
        )
