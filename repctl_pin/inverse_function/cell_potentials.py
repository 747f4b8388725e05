r"""Potentials of a cell's function: ``h(q) = n_ref(u)ᵀ (q − q_ref(u))``, with u the cell's
coordinates of f(q)."""

from __future__ import annotations

import numpy as np
from scipy.linalg.blas import dgemv

from ..arguments import Array
from ..potentials.fast_potentials import InPlace
from ..robot import fast_kinematics
from .chart import Chart
from .fast_function import in_place, monomials_at
from .kinematics import placed


class CellPotentials:
    r"""r potentials whose leaf h = 0 is the function of a chart, and whose leaf h = c is that with
    label c.

    .. math:: V^T = n_{ref}^T + \left[ (\partial n_{ref}^T)(q - q_{ref})
              - n_{ref}^T \partial q_{ref} \right] \frac{\partial u}{\partial x} J

    :class:`RepeatableInverse` takes them like polynomials of q. Outside the cell the polynomials of
    u extrapolate and are not meaningful.

    Parameters
    ----------
    chart
        The chart; the function is its s = 0.
    """

    def __init__(self, chart: Chart) -> None:
        self.chart, self.n = chart, chart.cell.task.n

    def value(self, q: Array) -> Array:
        """Evaluate h(q): (r,)."""
        return self.values(np.asarray(q, float)[None])[0]

    def values(self, Q: Array) -> Array:
        """Evaluate h at every row of Q (K, n): (K, r)."""
        p, R, _ = placed(self.chart.cell.task, Q)
        cell = self.chart.cell
        q_ref, n_ref = self.chart.reference(cell.coordinates(p, R)[0])
        away = cell._wrapped(Q - q_ref - cell._shifts(p, R))
        return np.einsum("Knr,Kn->Kr", n_ref, away)

    def gradient(self, q: Array) -> Array:
        """Evaluate V = ∂hᵀ/∂q: (n, r)."""
        return self.gradients(np.asarray(q, float)[None])[0]

    def gradients(self, Q: Array) -> Array:
        """Evaluate V at every row of Q (K, n): (K, n, r)."""
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

    def in_place(self, V_T: Array, e: Array) -> InPlace:
        """Make the functions that write Vᵀ into an array (r, n), and c − h into one (r,)."""
        chart, task = self.chart, self.chart.cell.task
        n, m, r, k, N = task.n, task.m, task.r, chart.cell.k, chart.monomials.size
        J = np.zeros((m, n))
        jacobian = fast_kinematics.in_place(task, J, np.zeros(m)).jacobian
        here = task._data.oMf[task._frame_id]
        p, R = here.translation, here.rotation
        cell = in_place(chart.cell)
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
        whole, X, bent = np.zeros((r, k + along.shape[1])), np.zeros((r, m)), np.zeros((r, n))
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

        return InPlace(slope, gap)
