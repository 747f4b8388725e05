"""The polynomials q_ref and n_ref of a cell's chart, expanded on boxes, with bounds of the rest."""

from __future__ import annotations

from dataclasses import dataclass
from math import factorial

import numpy as np

from ..arguments import Array, read_only
from ..inverse_function.chart import Chart
from ..inverse_function.monomials import Monomials
from .taylor import ORDER


@dataclass(frozen=True, eq=False)
@read_only
class Polynomials:
    """q_ref and n_ref of a chart, to be expanded to degree 3 on boxes.

    Attributes
    ----------
    chart : Chart
    parts : (N, M, n, 1 + r) array
        Coefficients of ``∂^α / α!``, for each of the M monomials of degree up to 3.
    fourth : (F, k) array of int
        The exponents α of degree 4.
    rest : (F, n, 1 + r) array
        Bounds of ``∂^α / α!`` on the whole cell.
    sizes : (n, 1 + r) array
        Bounds of the values and of all these derivatives, added: what rounding is relative to.
    """

    chart: Chart
    parts: Array
    fourth: Array
    rest: Array
    sizes: Array

    def __repr__(self) -> str:
        return f"<Polynomials of {self.chart.monomials.size} terms>"

    @classmethod
    def of(cls, chart: Chart) -> Polynomials:
        """Differentiate a chart's polynomials, and bound the fourth derivatives by the absolute
        values of their terms."""
        monomials = chart.monomials
        derivatives = Monomials(monomials.k, ORDER + 1)
        every = {(0,) * monomials.k: chart.coefficients}
        for i, alpha in enumerate(derivatives.exponents[1:], 1):
            lower = tuple(derivatives.exponents[derivatives.parent[i]].tolist())
            every[tuple(alpha.tolist())] = _derivative(
                monomials, every[lower], int(derivatives.variable[i])
            )
        scaled = np.stack(
            [every[tuple(a.tolist())] / _factorial(a) for a in derivatives.exponents], axis=1
        )
        low = int(derivatives.starts[ORDER + 1])
        sizes = np.abs(scaled[:, :low]).sum(axis=(0, 1))
        rest = np.abs(scaled[:, low:]).sum(axis=0) * (1 + 1e-12)
        return cls(chart, scaled[:, :low], derivatives.exponents[low:], rest, sizes)

    @property
    def used(self) -> Array:
        """Number of terms that each derivative has, (M,): the others are 0."""
        starts, degrees = self.chart.monomials.starts, Monomials(self.chart.monomials.k, ORDER)
        left = np.maximum(self.chart.monomials.degree - degrees.exponents.sum(axis=1), -1)
        return np.asarray(starts[left + 1])

    def shifted(self, Uc: Array, half: Array) -> tuple[Array, Array]:
        """Expand in t, ``u = u_c + h t``, on boxes (K, k) to degree 3: coefficients (K, M, n, 1 +
        r) in the order of the monomials, and a bound of the rest (K, n, 1 + r)."""
        P = np.tensordot(self.chart.monomials.values(Uc), self.parts, axes=1)
        P *= Monomials(Uc.shape[1], ORDER).values(half)[:, :, None, None]
        powers = np.prod(half[:, None] ** self.fourth, axis=2)
        return P, np.tensordot(powers, self.rest, axes=1) * (1 + 1e-12)


def _factorial(alpha: Array) -> int:
    return int(np.prod([factorial(int(a)) for a in alpha]))


def _derivative(monomials: Monomials, C: Array, j: int) -> Array:
    """Differentiate polynomials with coefficients C (N, …) with respect to u_j: coefficients
    again."""
    out = np.zeros_like(C)
    powers = monomials.exponents[:, j]
    on = powers > 0
    np.add.at(out, monomials.lower[j][on], C[on] * powers[on].reshape(-1, *[1] * (C.ndim - 1)))
    return out
