"""The polynomials q_ref and n_ref of a cell's chart, and bounds of their derivatives on boxes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arguments import Array, read_only
from ..inverse_function.chart import Chart
from ..inverse_function.monomials import Monomials


@dataclass(frozen=True, eq=False)
@read_only
class Polynomials:
    """q_ref and n_ref of a chart, their slopes, and bounds of the higher ones on the whole cell.

    Attributes
    ----------
    chart : Chart
    most : list of arrays
        ``most[d]`` (k, …, k, n, 1 + r), with d axes k: bounds of the d-th derivatives.
    coefficients : list of arrays
        ``coefficients[d]`` (k, …, k, N, n, 1 + r): those of the d-th derivatives, d up to 3.
    """

    chart: Chart
    most: list[Array]
    coefficients: list[Array]

    def __repr__(self) -> str:
        return f"<Polynomials of {self.chart.monomials.size} terms>"

    @classmethod
    def of(cls, chart: Chart) -> Polynomials:
        """Bound the derivatives of a chart's polynomials by the absolute values of their terms."""
        monomials, shape = chart.monomials, chart.coefficients.shape
        every = [chart.coefficients]
        for order in range(1, 5):
            flat = every[-1].reshape(-1, *shape)
            C = np.stack(
                [_derivative(monomials, one, j) for one in flat for j in range(monomials.k)]
            )
            every.append(C.reshape(*(monomials.k,) * order, *shape))
        return cls(chart, [np.abs(C).sum(axis=-3) for C in every], every[:4])

    def sizes(self) -> tuple[Array, Array]:
        """Add up the bounds on the whole cell: of all derivatives, (n, 1 + r), and of those with
        respect to each coordinate, (k, n, 1 + r)."""
        most = self.most[:4]
        slope = sum(m.sum(axis=tuple(range(1, order))) for order, m in enumerate(most) if order)
        return np.asarray(most[0] + np.sum(slope, axis=0), float), np.asarray(slope, float)

    def at(self, Uc: Array) -> tuple[Array, Array, Array]:
        """Evaluate (q_ref, n_ref), their slopes and curvatures: (K, n, 1 + r), (K, k, …) and (K, k,
        k, …)."""
        T, C = self.chart.monomials.values(Uc), self.coefficients
        values, slopes, curvatures = (np.tensordot(T, c, axes=(1, -3)) for c in C[:3])
        return values, slopes, curvatures

    def most_in(
        self, Uc: Array, values: Array, first: Array, second: Array, h: Array
    ) -> list[Array]:
        """Bound q_ref, n_ref and their derivatives to the third order in boxes, given their values
        at the centres."""
        T = self.chart.monomials.values(Uc)
        third = np.abs(np.tensordot(T, self.coefficients[3], axes=(1, -3)))
        third = third + np.einsum("ibcdnx,Kd->Kibcnx", self.most[4], h)
        two = np.abs(second) + np.einsum("Kibcnx,Kc->Kibnx", third, h)
        one = np.abs(first) + np.einsum("Kibnx,Kb->Kinx", two, h)
        return [np.abs(values) + np.einsum("Kinx,Ki->Knx", one, h), one, two, third]


def _derivative(monomials: Monomials, C: Array, j: int) -> Array:
    """Differentiate polynomials with coefficients C (N, …) with respect to u_j: coefficients
    again."""
    out = np.zeros_like(C)
    powers = monomials.exponents[:, j]
    on = powers > 0
    np.add.at(out, monomials.lower[j][on], C[on] * powers[on].reshape(-1, *[1] * (C.ndim - 1)))
    return out
