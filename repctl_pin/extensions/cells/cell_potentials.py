r"""Potentials of which an inverse function over a cell is a leaf: ``h(q) = n_ref(u)ᵀ (q −
q_ref(u))``, with u the coordinates of the pose f(q) in the cell."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.linalg.blas import dgemv

from ...arguments import Array
from ...model import fast_kinematics
from ...native import PART, filled_struct, point
from ...potentials.fast_potentials import InPlace
from .chart import Chart
from .fast_function import fast_coordinates, monomials_at
from .kinematics import placed
from .native_function import native_chart

_CELL = 2
"""Kind of these potentials in arm.h."""


class CellPotentials:
    r"""The r potentials of a chart, whose leaf {h(q) = c} is the function with s = c.

    .. math:: V^T = n_{ref}^T + \left[ (\partial n_{ref}^T)(q - q_{ref})
              - n_{ref}^T \partial q_{ref} \right] \frac{\partial u}{\partial x} J

    ∂ is the derivative with respect to u. :class:`RepeatableInverse` accepts these potentials like
    polynomials of q. Outside the cell, the polynomials in u extrapolate and are not meaningful.

    Parameters
    ----------
    chart
        Chart with q_ref and n_ref.
    """

    def __init__(self, chart: Chart) -> None:
        self.chart, self.n = chart, chart.cell.task.n

    def value(self, q: Array) -> Array:
        """Evaluate the potentials h (r,) at q (n,)."""
        return self.values(np.asarray(q, float)[None])[0]

    def values(self, Q: Array) -> Array:
        """Evaluate the potentials h (K, r) at every row of Q (K, n)."""
        p, R, _ = placed(self.chart.cell.task, Q)
        cell = self.chart.cell
        q_ref, n_ref = self.chart.reference(cell.coordinates(p, R)[0])
        away = cell._wrapped(Q - q_ref - cell._shifts(p, R))
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
        dq, dn = self.chart.slopes(U)
        away = cell._wrapped(Q - q_ref - cell._shifts(p, R))
        D = np.einsum("Knrk,Kn->Krk", dn, away) - np.einsum("Knr,Knk->Krk", n_ref, dq)
        D = np.concatenate([D, -np.swapaxes(n_ref, 1, 2) @ cell.along], axis=2)
        return n_ref + np.swapaxes(D @ dU @ J, 1, 2)

    def native_part(self) -> Any:
        """Create the struct :data:`PART` of the potentials, for the native library."""
        part, _ = filled_struct(PART, {}, {}, {"kind": _CELL})
        point(part, "chart", [native_chart(self.chart)])
        return part

    def in_place(self, V_T: Array, e: Array) -> InPlace:
        """Make functions that write Vᵀ into V_T (r, n), and c − h into e (r,)."""
        chart, task = self.chart, self.chart.cell.task
        n, m, r, k, N = task.n, task.m, task.r, chart.cell.k, chart.monomials.size
        J = np.zeros((m, n))
        jacobian, *_ = fast_kinematics.in_place(task, J, np.zeros(m))
        here = task._data.oMf[task._frame_id]
        p, R = here.translation, here.rotation
        cell = fast_coordinates(chart.cell)
        locate, pull, shift = cell.locate, cell.pull, cell.shift
        along, wrapped = chart.cell.along, chart.cell._wrapped
        T, monomials = monomials_at(chart.monomials, cell.u)
        C = np.moveaxis(chart.coefficients, 0, -1).swapaxes(0, 1)  # (1 + r, n, N)
        C_T = np.asfortranarray(C.reshape(n * (1 + r), N))
        C_q, C_n = (
            np.ascontiguousarray(C[0]),
            np.ascontiguousarray(C[1:].swapaxes(1, 2).reshape(r * N, n)),
        )
        lower, powers = (
            chart.monomials.lower,
            np.ascontiguousarray(chart.monomials.exponents.T, float),
        )  # (k, N)
        both, away, h = np.zeros(n * (1 + r)), np.zeros(n), np.zeros(r)
        q_ref, n_T = both[:n], both[n:].reshape(r, n)
        dT, turned, moved = np.zeros((k, N)), np.zeros(r * N), np.zeros((r, N))
        whole, X, bent = (
            np.zeros((r, k + along.shape[1])),
            np.zeros((r, m)),
            np.zeros((r, n)),
        )
        D, beside = whole[:, :k], whole[:, k:]
        by_terms = turned.reshape(r, N)
        take, multiply, subtract, add, dot, dT_T = (
            T.take,
            np.multiply,
            np.subtract,
            np.add,
            np.dot,
            dT.T,
        )

        def slope(q: Array) -> None:
            jacobian(q)
            locate(p, R)
            monomials()
            dgemv(1.0, C_T, T, 0.0, both, 0, 1, 0, 1, 0, 1)
            subtract(q, q_ref, away)
            if shift is not None:
                subtract(away, shift, away)
                wrapped(away)
                beside[:] = -n_T.dot(along)
            dot(n_T, away, h)
            dot(C_n, away, turned)
            dot(n_T, C_q, moved)
            subtract(
                by_terms, moved, moved
            )  # (r, N): D = ∂h/∂u at this q is the slope of the polynomials with these
            take(lower, None, dT, "clip")
            multiply(dT, powers, dT)
            D[:] = moved.dot(dT_T)
            pull(whole, X)
            dot(X, J, bent)
            add(n_T, bent, V_T)

        def gap(leaf: Array) -> None:
            subtract(leaf, h, e)

        return slope, gap
