r"""A section as potentials: ``h(q) = n_ref(u)ᵀ (q − q_ref(u))``, u the cell's coordinates of f(q)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .chart import Chart
from .kinematics import placed

Array = NDArray[np.float64]


class SectionField:
    r"""r potentials whose leaf h = 0 is the section of a chart, and whose leaf h = c is the one with label c.

    .. math:: V^T = n_{ref}^T + \left[ (\partial n_{ref}^T)(q - q_{ref}) - n_{ref}^T \partial q_{ref} \right]
              \frac{\partial u}{\partial x} J

    An ordinary field: :class:`RepeatableInverse` takes it as it takes polynomials of q. Beyond the cell
    the polynomials of u extrapolate, and lose their meaning.

    Parameters
    ----------
    chart
        Of the section, which is its s = 0.
    """

    def __init__(self, chart: Chart) -> None:
        self.chart = chart

    def value(self, q: Array) -> Array:
        """Evaluate h(q): (r,)."""
        return self.values(np.asarray(q, float)[None])[0]

    def values(self, Q: Array) -> Array:
        """Evaluate h at every row of Q (K, n): (K, r)."""
        Q = np.asarray(Q, float)
        p, R, _ = placed(self.chart.cell.task, Q)
        q_ref, n_ref = self.chart.reference(self.chart.cell.coordinates(p, R)[0])
        return np.einsum("Knr,Kn->Kr", n_ref, Q - q_ref)

    def gradient(self, q: Array) -> Array:
        """Evaluate V = ∂hᵀ/∂q: (n, r)."""
        return self.gradients(np.asarray(q, float)[None])[0]

    def gradients(self, Q: Array) -> Array:
        """Evaluate V at every row of Q (K, n): (K, n, r)."""
        Q = np.asarray(Q, float)
        p, R, J = placed(self.chart.cell.task, Q)
        U, dU = self.chart.cell.slopes(p, R)
        q_ref, n_ref = self.chart.reference(U)
        dq, dn = self.chart.slopes(U)
        D = np.einsum("Knrk,Kn->Krk", dn, Q - q_ref) - np.einsum("Knr,Knk->Krk", n_ref, dq)
        return n_ref + np.swapaxes(D @ dU @ J, 1, 2)
