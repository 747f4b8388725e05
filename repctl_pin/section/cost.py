r"""How far a section is from the desired control, and its least-squares model: what Gauss–Newton minimises."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..strategies.strategy import Batched
from .chart import Chart, Points
from .monomials import Monomials

Array = NDArray[np.float64]

_DIFFERENCE = 1e-5
"""Of s, rad, in the central differences of the residual across the fibre."""


@dataclass(frozen=True)
class Value:
    """The cost at some coefficients.

    Attributes
    ----------
    cost : float
        ``nearness + weight · mean Σ_i max(0, room − margin_i)²``, the latter over the edge; infinite where a node has
        no solution.
    nearness : float
        ``mean ‖(∂F − G_d E) C‖_F²``.
    wanted : float
        ``mean ‖G_d E C‖_F²``: half of nearness / wanted is the share of extra joint speed, for J⁺.
    margin : float
        The least joint-limit margin of all nodes.
    points : Points
    ds : (K, r, k) array
        ∂s/∂u.
    """

    cost: float
    nearness: float
    wanted: float
    margin: float
    points: Points
    ds: Array


class Cost:
    r"""``C(a) = mean over the cell of ‖∂F/∂x − G_d(F)‖_F² + penalties`` with ``s = Σ_t a_t T_t(u)``.

    ∂F/∂x is written ``∂F (EᵀE)^(−1/2)``, in joint speed per unit of task speed, so that a cell may have fewer
    coordinates than the task. T are the monomials of u.

    Parameters
    ----------
    desired
        G_d.
    chart
        In which the section is written.
    terms
        T.
    U : (K, k) array
        Nodes of the mean.
    edge : (L, k) array
        Further nodes, for the penalty alone, which is a mean over these: where limits are met first.
    room : float or (L,) array
        The margin, rad or m, below which a joint limit costs, at each of these.
    weight
        How much it costs.
    """

    def __init__(
        self,
        desired: Batched,
        chart: Chart,
        terms: Monomials,
        U: Array,
        edge: Array,
        *,
        room: float | Array = 0.0,
        weight: float = 0.0,
    ) -> None:
        self.desired, self.chart, self.terms = desired, chart, terms
        self.U, self.inner = np.concatenate([U, edge]), len(U)
        self.room, self.weight = np.broadcast_to(np.asarray(room, float), len(edge))[:, None], weight
        self.edges = max(1, len(edge))
        self.r = chart.cell.task.r
        self.T = terms.values(self.U)  # (K, N)
        self.dT = terms.slopes(self.T)  # (K, N, k)
        self.C = chart.cell.speeds(self.U)  # (K, k, k)
        self._last: Array | None = None

    def value(self, a: Array) -> Value:
        """Evaluate the cost at coefficients a (N, r)."""
        s, ds = self.T @ a, np.einsum("KNk,Nr->Krk", self.dT, a)
        points = self.chart.solve(self.U, s, self._last)
        if not points.found.all():
            points = self.chart.solve(self.U, s)
        margin = float(self.chart.cell.task.limit_margin(points.Q).min())
        if not points.found.all():
            return Value(np.inf, np.inf, np.nan, margin, points, ds)
        residual, _, wanted = self._residual(points, ds)
        nearness = float((residual[: self.inner] ** 2).sum() / self.inner)
        if not np.isfinite(nearness):
            return Value(np.inf, np.inf, np.nan, margin, points, ds)
        self._last = points.Q
        penalty = self.weight * float((self._hinge(points.Q) ** 2).sum() / self.edges)
        size = float((wanted[: self.inner] ** 2).sum() / self.inner)
        return Value(nearness + penalty, nearness, size, margin, points, ds)

    def model(self, at: Value) -> tuple[Array, Array]:
        """Evaluate the gradient (N r,) and the Gauss–Newton Hessian (N r, N r) at coefficients just evaluated.

        The residual depends on a through s and ∂s at its node alone: linearly on ∂s, by ``B ∂s``, and on s by
        central differences along the fibre.
        """
        points, chart, r = at.points, self.chart, self.r
        residual, B, _ = self._residual(points, at.ds)
        K, n, k = residual.shape
        s = np.einsum("Knr,Kn->Kr", points.n_ref, points.Q - points.q_ref)
        M = np.zeros((K, n, k, r, 1 + k))  # ∂(residual)/∂(s_j, (∂s_j C)_c)
        for j in range(r):
            step = _DIFFERENCE * np.eye(r)[j]
            ends = [chart.solve(self.U, s + w * step, points.Q + w * B @ step, iterations=3) for w in (1.0, -1.0)]
            up, down = (self._residual(end, at.ds)[0] for end in ends)
            M[:, :, :, j, 0] = (up - down) / (2 * _DIFFERENCE)
        for c in range(k):
            M[:, :, c, :, 1 + c] = B
        M[self.inner :] = 0.0
        residual[self.inner :] = 0.0
        flat = M.reshape(K, n * k, r * (1 + k))
        gram = np.swapaxes(flat, 1, 2) @ flat / self.inner  # (K, r (1 + k), r (1 + k))
        slope = np.einsum("Kap,Ka->Kp", flat, residual.reshape(K, n * k)) / self.inner
        if self.weight:
            task, Q = chart.cell.task, points.Q[self.inner :]
            hinge = self._hinge(points.Q)
            side = np.where(Q - task.lower < task.upper - Q, -1.0, 1.0) * (hinge > 0)
            D = side[:, :, None] * B[self.inner :]  # ∂hinge/∂s
            share = self.weight / self.edges
            at_s = np.arange(r) * (1 + k)
            gram[self.inner :, at_s[:, None], at_s] += share * np.swapaxes(D, 1, 2) @ D
            slope[self.inner :, at_s] += share * np.einsum("Knr,Kn->Kr", D, hinge)
        features = np.concatenate([self.T[:, :, None], self.dT @ self.C], axis=2)  # (K, N, 1 + k)
        N = features.shape[1]
        gradient = 2 * np.einsum("KNp,Krp->Nr", features, slope.reshape(K, r, 1 + k), optimize=True).ravel()
        L = np.linalg.cholesky(gram + 1e-12 * np.trace(gram, axis1=1, axis2=2).mean() * np.eye(gram.shape[1]))
        L = L.reshape(K, r, 1 + k, r * (1 + k))
        rows = np.einsum("KNp,Krpz->KzNr", features, L, optimize=True).reshape(-1, N * r)
        return gradient, 2 * rows.T @ rows

    def _residual(self, points: Points, ds: Array) -> tuple[Array, Array, Array]:
        """``(∂F − G_d E) C`` (K, n, k), ∂F/∂s (K, n, r), and ``G_d E C`` (K, n, k)."""
        dF, B = self.chart.derivative(points, ds)
        wanted = self.desired.batch(points.Q, points.J) @ self.chart.cell.twists(points.U, points.R) @ self.C
        return dF @ self.C - wanted, B, wanted

    def _hinge(self, Q: Array) -> Array:
        """How far each joint is inside the room that is to be kept from its limits, at the edge: (L, n)."""
        return np.maximum(0.0, self.room - self.chart.cell.task.limit_margin(Q[self.inner :]))
