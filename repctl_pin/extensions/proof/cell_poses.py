"""Poses of a cell or a sector as formulas of its coordinates u, for Taylor models.

They consist of rotations, a linear displacement and a matrix exponential.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arguments import Array, read_only
from ...model.chain_formulas import skew
from ..cells.cell import Cell
from ..cells.sector import ANGLE, HEIGHT, RADIUS, SPIN, Sector
from .taylor import TaylorModel, dot
from .taylor_chain import fixed


@dataclass(frozen=True, eq=False)
@read_only
class Poses:
    r"""Poses (p, R) of a cell as functions of its coordinates u.

    ``p = o + R_a(φ) (d + D u)``, ``R = R_a(φ) exp(\hat{Ω u}) R_0 R_z(ψ)``: R_a rotates about a
    sector's axis, R_z about the tool's z axis. The angles φ and ψ are linear in u.

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
    """

    o: Array
    a: Array
    d: Array
    R0: Array
    D: Array
    Omega: Array
    angle: Array
    spin: Array

    @classmethod
    def of(cls, cell: Cell) -> Poses:
        """Create the formulas for the coordinates u of a cell or a sector."""
        k, R0, p0 = cell.k, cell.placement.rotation, cell.placement.translation
        D, Omega = np.zeros((2, 3, k))
        turns = np.zeros((6, k))
        if isinstance(cell, Sector):
            outward, _, along = cell.directions
            ways = {RADIUS: outward, HEIGHT: along}
            tilts = {3: R0[:, 0], 4: R0[:, 1]}
            o, a = cell.axis
        else:
            rows = cell.task.rows[: len(cell.half_width)]
            ways = {i: np.eye(3)[row] for i, row in enumerate(rows)}
            about = np.eye(3) if cell.task.kind == "pose" else R0.T
            tilts = {
                len(rows) + i: about[i] for i in range(len(cell.widths) - len(rows))
            }
            o, a = np.zeros(3), np.array([0.0, 0.0, 1.0])
        for i, which in enumerate(cell.moved):
            width = cell.widths[which]
            if which in ways:
                D[:, i] = width * ways[which]
            elif which in tilts:
                Omega[:, i] = width * tilts[which]
            else:
                turns[which, i] = width
        return cls(o, a, p0 - o, R0, D, Omega, turns[ANGLE], turns[SPIN])

    def at(self, Uc: Array, half: Array) -> tuple[TaylorModel, TaylorModel]:
        """Compute Taylor models of p (K, 3) and of the columns of R (K, 3, 3) on boxes.

        The boxes are ``u = Uc + half · t``, with Uc and half (K, k), and t are the variables of the
        models.
        """
        R = self._exponential(Uc, half)  # (K, column, 3)
        p = self._linear(self.D, Uc, half)
        p = p + fixed(p, self.d)
        if self.spin.any():
            s, c = self._linear(self.spin[None], Uc, half).sine_cosine()
            x, y = R[:, 0], R[:, 1]
            R = _columns([x * c + y * s, y * c - x * s, R[:, 2]])
        if self.angle.any():
            s, c = self._linear(self.angle[None], Uc, half).sine_cosine()
            p, R = (
                self._turned(p, s, c),
                _columns([self._turned(R[:, i], s, c) for i in range(3)]),
            )
        return p + fixed(p, self.o), R

    def _turned(self, x: TaylorModel, s: TaylorModel, c: TaylorModel) -> TaylorModel:
        """Rotate vectors x (K, 3) about the axis a by φ: ``x + s a × x + (1 − c) a × (a × x)``.

        s and c are the models of the sine and the cosine of φ.
        """
        hat = skew(self.a)
        return x + s * x.combined(hat) + (x - c * x).combined(hat @ hat)

    def _exponential(self, Uc: Array, half: Array) -> TaylorModel:
        """Compute the model of ``exp(ω̂) R_0 = (c + s ω̂ + d ω ωᵀ) R_0`` by columns, (K, 3, 3).

        With ``ω = Ω u`` and its length θ, c = cos θ, s = sin θ / θ and d = (1 − cos θ) / θ².
        """
        omega = self._linear(self.Omega, Uc, half)
        start = [fixed(omega, column) for column in self.R0.T]
        if not self.Omega.any():
            return _columns(start)
        c, s, d = dot(omega, omega).exponential()
        parts = []
        for i in range(3):
            along = omega.combined(self.R0[:, i][None])
            x = (
                c * start[i]
                + s * omega.combined(-skew(self.R0[:, i]))
                + d * (along * omega)
            )
            parts.append(x)
        return _columns(parts)

    @staticmethod
    def _linear(rows: Array, Uc: Array, half: Array) -> TaylorModel:
        k = Uc.shape[1]
        base = TaylorModel.constant(k, Uc @ rows.T)
        P = base.P.copy()
        P[..., 1 : 1 + k] = rows * half[:, None]
        return TaylorModel(k, P, 1e-15 * (1 + np.abs(P).sum(axis=-1)))


def _columns(models: list[TaylorModel]) -> TaylorModel:
    """Stack models of vectors (K, 3) to a model of shape (K, number of vectors, 3)."""
    P = np.stack([x.P for x in models], axis=1)
    return TaylorModel(models[0].k, P, np.stack([x.r for x in models], axis=1))
