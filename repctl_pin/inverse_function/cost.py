r"""Cost of a candidate function: its distance from the desired control, and margin penalties."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..arguments import Array, read_only
from ..solvers import Damping, Point, Step, levenberg_marquardt
from ..strategies.strategy import Batched
from .chart import Chart, Points
from .margins import Margin
from .monomials import Monomials

_DIFFERENCE = 1e-5
"""Step of s, rad, in the central differences of the residual along the self-motion."""

_MOST = 30
_ENOUGH = 1e-4

_REGULAR = 1e-10
"""Damping that is always there, in units of the diagonal of H."""

_RULES = Damping()
"""A step that does not lower the cost is computed anew, with more damping."""


@dataclass(frozen=True, eq=False)
@read_only
class Value:
    """The cost at some coefficients.

    Attributes
    ----------
    cost : float
        ``nearness + weight · Σ mean Σ_i max(0, asked − margin_i)²``, with a mean per margin over
        its own poses; infinite if a node has no solution.
    nearness : float
        ``mean ‖(∂F − G_d E) C‖_F²``.
    desired_square : float
        ``mean ‖G_d E C‖_F²``; for J⁺, half of nearness / desired_square is the extra joint speed.
    points : Points
    ds : (K, r, k) array
        ∂s/∂u.
    """

    cost: float
    nearness: float
    desired_square: float
    points: Points
    ds: Array


@dataclass(frozen=True, eq=False)
@read_only
class Penalty:
    """A penalised margin.

    Attributes
    ----------
    margin : Margin
    U : (L, k) array
        Poses at which it is penalised.
    asked : (L,) array
        Margin below which it is penalised there.
    """

    margin: Margin
    U: Array
    asked: Array


class Cost:
    r"""``C(a) = mean over the cell of ‖∂F/∂x − G_d(F)‖_F² + penalties`` with ``s = Σ_t a_t
    T_t(u)``.

    ∂F/∂x is written ``∂F (EᵀE)^(−1/2)``, in joint speed per unit of task speed, because a cell may
    have fewer coordinates than the task. T are the monomials of u.

    Parameters
    ----------
    desired
        G_d.
    chart
        The chart in which the function is written.
    terms
        T.
    U : (K, k) array
        Nodes of the mean.
    kept
        Penalised margins; each penalty is a mean over its own poses.
    weight
        Weight of the penalties.
    """

    def __init__(
        self,
        desired: Batched,
        chart: Chart,
        terms: Monomials,
        U: Array,
        kept: Sequence[Penalty] = (),
        *,
        weight: float = 0.0,
    ) -> None:
        self.desired, self.chart, self.terms, self.weight = desired, chart, terms, weight
        self.U, self.inner = np.concatenate([U, *(part.U for part in kept)]), slice(len(U))
        ends = np.cumsum([len(U), *(len(part.U) for part in kept)])
        self.kept = [
            (part, slice(a, b)) for part, a, b in zip(kept, ends, ends[1:], strict=False) if b > a
        ]
        self.T = terms.values(self.U)  # (K, N)
        self.dT = terms.slopes(self.T)  # (K, N, k)
        self.C = chart.cell.speeds(U)  # (inner, k + l, k + l)
        self.r = chart.cell.task.r
        self._last: Array | None = None

    def value(self, a: Array) -> Value:
        """Evaluate the cost at coefficients a (N, r)."""
        s, ds = self.T @ a, np.einsum("KNk,Nr->Krk", self.dT, a)
        points = self.chart.solve(self.U, s, self._last)
        if not points.found.all():
            points = self.chart.solve(self.U, s)
        if not points.found.all():
            return Value(np.inf, np.inf, np.nan, points, ds)
        residual, _, desired_square = self._residual(points.chosen(self.inner), ds[self.inner])
        nearness = float((residual**2).sum() / len(residual))
        if not np.isfinite(nearness):
            return Value(np.inf, np.inf, np.nan, points, ds)
        self._last = points.Q
        hinges = [_hinge(part, points.Q[at]) for part, at in self.kept]
        penalty = self.weight * sum(float((hinge**2).sum() / len(hinge)) for hinge in hinges)
        return Value(
            nearness + penalty,
            nearness,
            float((desired_square**2).sum() / len(desired_square)),
            points,
            ds,
        )

    def model(self, at: Value) -> tuple[Array, Array]:
        """Evaluate the gradient (N r,) and the Gauss–Newton Hessian (N r, N r) at coefficients just
        evaluated.

        The residual depends on a through s and ∂s at its node alone: linearly on ∂s, by ``B ∂s``;
        its derivative by s is taken by central differences. A margin depends on s alone."""
        chart, r = self.chart, self.chart.cell.task.r
        points, ds = at.points.chosen(self.inner), at.ds[self.inner]
        residual, B, _ = self._residual(points, ds)
        K, n, k = residual.shape  # here k counts the coordinates removed by a symmetry, too
        s = np.einsum("Knr,Kn->Kr", points.n_ref, points.Q - points.q_ref)
        M = np.zeros((K, n, k, r, 1 + k))  # ∂(residual)/∂(s_j, (∂s_j C)_c)
        for j in range(r):
            step = _DIFFERENCE * np.eye(r)[j]
            ends = [
                chart.solve(points.U, s + w * step, points.Q + w * B @ step, iterations=3)
                for w in (1.0, -1.0)
            ]
            up, down = (self._residual(end, ds)[0] for end in ends)
            M[:, :, :, j, 0] = (up - down) / (2 * _DIFFERENCE)
        for c in range(k):
            M[:, :, c, :, 1 + c] = B
        flat = M.reshape(K, n * k, r * (1 + k))
        gram = np.zeros((len(self.U), r * (1 + k), r * (1 + k)))
        slope = np.zeros((len(self.U), r * (1 + k)))
        gram[self.inner] = np.swapaxes(flat, 1, 2) @ flat / K
        slope[self.inner] = np.einsum("Kap,Ka->Kp", flat, residual.reshape(K, n * k)) / K
        features = np.zeros((len(self.U), self.T.shape[1], 1 + k))
        features[:, :, 0] = self.T
        features[self.inner, :, 1:] = self.dT[self.inner] @ self.C[:, : chart.cell.k]
        at_s = np.arange(r) * (1 + k)
        for part, where in self.kept:
            there = at.points.chosen(where)
            hinge = _hinge(part, there.Q)
            onto = chart.derivative(there, at.ds[where])[1]
            D = -part.margin.slopes(there.Q, onto) * (hinge > 0)[:, :, None]  # ∂hinge/∂s
            share = self.weight / len(hinge)
            gram[where, at_s[:, None], at_s] = share * np.swapaxes(D, 1, 2) @ D
            slope[where, at_s] = share * np.einsum("KPr,KP->Kr", D, hinge)
        N = features.shape[1]
        gradient = (
            2
            * np.einsum("KNp,Krp->Nr", features, slope.reshape(-1, r, 1 + k), optimize=True).ravel()
        )
        L = np.linalg.cholesky(
            gram + 1e-12 * np.trace(gram, axis1=1, axis2=2).mean() * np.eye(gram.shape[1])
        )
        L = L.reshape(-1, r, 1 + k, r * (1 + k))
        rows = np.einsum("KNp,Krpz->KzNr", features, L, optimize=True).reshape(-1, N * r)
        return gradient, 2 * rows.T @ rows

    def _residual(self, points: Points, ds: Array) -> tuple[Array, Array, Array]:
        """Evaluate ``(∂F − G_d E) C`` (K, n, k), ∂F/∂s (K, n, r), and ``G_d E C`` (K, n, k)."""
        dF, B = self.chart.derivative(points, ds)
        desired_square = (
            self.desired.batch(points.Q, points.J)
            @ self.chart.cell.twists(points.U, points.R)
            @ self.C
        )
        return dF @ self.C - desired_square, B, desired_square


def _hinge(part: Penalty, Q: Array) -> Array:
    """Evaluate the part of each requested margin that is missing: (L, P)."""
    return np.maximum(0.0, part.asked[:, None] - part.margin.measure(Q))


@dataclass(frozen=True, eq=False)
@read_only
class Descent:
    """End of a minimisation of the cost.

    Attributes
    ----------
    a : (N, r) array
    value : Value
        The cost there.
    start : float
        The cost at the start.
    steps : int
    """

    a: Array
    value: Value
    start: float
    steps: int


def descend(cost: Cost, a: Array, *, enough: float = _ENOUGH) -> Descent:
    """Minimise the cost from coefficients a (N, r), by Levenberg and Marquardt's method.

    Parameters
    ----------
    cost
        The cost.
    a
        Initial coefficients; the function must exist there at every node.
    enough
        Relative decrease of the cost below which the iteration ends.
    """
    found = levenberg_marquardt(_Problem(cost), a, _RULES, steps=_MOST, tolerance=enough)
    return Descent(found.at.x, found.at.data, found.start, found.steps)


class _Problem:
    """The cost as a least-squares problem, with Marquardt's scaling by the diagonal of H."""

    def __init__(self, cost: Cost) -> None:
        self.cost = cost

    def evaluate(self, x: Array) -> Point[Value]:
        """Evaluate the cost; a step may not end where a node has no solution."""
        value = self.cost.value(x)
        return Point(value.cost, value.cost, True, value, x)

    def merit(self, x: Array) -> float:
        """Evaluate the cost alone."""
        return self.cost.value(x).cost

    def model(self, at: Point[Value]) -> tuple[Array, Array, Array]:
        """Evaluate the gradient, the Gauss–Newton Hessian, and the scaling (N r,)."""
        gradient, H = self.cost.model(at.data)
        return gradient, H, _scaling(H)

    def step(self, model: tuple[Array, Array, Array], damping: float) -> Step:
        """Solve ``(H + μ D) dx = −g``."""
        gradient, H, scale = model
        matrix = H + np.diag((damping + _REGULAR) * scale)
        dx = -np.asarray(np.linalg.solve(matrix, gradient), float)
        predicted = -float(gradient @ dx) - 0.5 * float(dx @ matrix @ dx)
        return Step(dx.reshape(-1, self.cost.r), predicted, damping)


def _scaling(H: Array) -> Array:
    """Take the diagonal of H, with its zeros lifted."""
    diagonal = np.diag(H)
    return diagonal + 1e-12 * diagonal.max()


def predicted_gain(cost: Cost, a: Array) -> float:
    """Predict the relative decrease of the cost in one Gauss–Newton step from a (N, r).

    Infinite if the function does not exist at some node.
    """
    value = cost.value(a)
    if not np.isfinite(value.cost):
        return np.inf
    gradient, H = cost.model(value)
    step = np.linalg.solve(H + np.diag(_REGULAR * _scaling(H)), gradient)
    return float(0.5 * gradient @ step / value.cost)
