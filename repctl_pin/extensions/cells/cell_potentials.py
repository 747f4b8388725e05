r"""Potentials of which an inverse function over a cell is a leaf: ``h(q) = n_ref(u)ᵀ (q −
q_ref(u))``, with u the coordinates of the pose f(q) in the cell."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...arguments import Array
from ...native import PART, filled_struct, point
from .cell import Cell
from .chart import Chart
from .kinematics import placed
from .native_function import native_chart

_CELL = 2
"""Kind of these potentials in arm.h."""


class CellPotentials:
    r"""The r potentials of a chart, whose leaf {h(q) = c} is the function with s = c.

    Their gradients are those of :meth:`Chart.gradients`. :class:`RepeatableInverse` accepts these
    potentials like polynomials of q. Outside the cell, the polynomials in u extrapolate and are not
    meaningful.

    Parameters
    ----------
    chart
        Chart with q_ref and n_ref.
    """

    def __init__(self, chart: Chart) -> None:
        self.chart, self.n = chart, chart.cell.task.n

    @property
    def region(self) -> Cell:
        """The cell, which is the region Ω of an inverse with these potentials."""
        return self.chart.cell.whole

    def value(self, q: Array) -> Array:
        """Evaluate the potentials h (r,) at q (n,)."""
        return self.values(np.asarray(q, float)[None])[0]

    def values(self, Q: Array) -> Array:
        """Evaluate the potentials h (K, r) at every row of Q (K, n)."""
        p, R, _ = placed(self.chart.cell.task, Q)
        cell = self.chart.cell
        q_ref, n_ref = self.chart.reference(cell.coordinates(p, R)[0])
        away = cell._away(Q, q_ref, p, R)
        return np.einsum("Knr,Kn->Kr", n_ref, away)

    def gradient(self, q: Array) -> Array:
        """Evaluate the gradients V = ∂hᵀ/∂q at q (n,): (n, r)."""
        return self.gradients(np.asarray(q, float)[None])[0]

    def gradients(self, Q: Array) -> Array:
        """Evaluate the gradients V at every row of Q (K, n): (K, n, r)."""
        Q = np.asarray(Q, float)
        p, R, J = placed(self.chart.cell.task, Q)
        cell = self.chart.cell
        U, dU = cell.slopes(p, R)
        q_ref, n_ref = self.chart.reference(U)
        away = cell._away(Q, q_ref, p, R)
        return self.chart.gradients(U, dU, J, n_ref, away)

    def _native_part(self) -> Any:
        """Create the struct :data:`PART` of the potentials, for the native library."""
        chart = native_chart(self.chart)
        part, _ = filled_struct(PART, {}, {}, {"kind": _CELL, "count": chart.terms})
        point(part, "chart", [chart])
        return part
