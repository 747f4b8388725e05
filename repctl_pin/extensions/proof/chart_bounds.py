"""Taylor expansions of a chart's polynomials q_ref and n_ref on boxes, with remainder bounds."""

from __future__ import annotations

from dataclasses import dataclass
from math import factorial, prod

import numpy as np

from ...arguments import Array, read_only
from ..cells.chart import Chart
from ..cells.monomials import Monomials
from .taylor import ORDER


@dataclass(frozen=True, eq=False)
@read_only
class Polynomials:
    """The polynomials q_ref and n_ref of a chart, prepared for expansion to degree 3 on boxes.

    The last axis of the arrays holds q_ref, then the r columns of n_ref; ∂^α is the derivative with
    exponents α, one per coordinate of the cell.

    Attributes
    ----------
    chart : Chart
        The chart.
    parts : (T, M, n, 1 + r) array
        Coefficients of the polynomials ``∂^α / α!`` in the chart's T monomials, for each of the M
        exponents α of degree up to 3.
    fourth : (F, k) array of int
        The exponents α of degree 4.
    rest : (F, n, 1 + r) array
        Bounds of ``|∂^α / α!|`` for these on the whole cell.
    sizes : (n, 1 + r) array
        Sums of the bounds of all derivatives ``∂^α / α!`` up to degree 3, to which rounding errors
        are relative.
    """

    chart: Chart
    parts: Array
    fourth: Array
    rest: Array
    sizes: Array

    @classmethod
    def of(cls, chart: Chart) -> Polynomials:
        """Compute the derivatives of a chart's polynomials, and bounds of the fourth ones.

        A bound is the sum of the absolute values of a polynomial's coefficients.
        """
        monomials = chart.monomials
        derivatives = Monomials(monomials.k, ORDER + 1)
        every = {(0,) * monomials.k: chart.coefficients}
        for i, alpha in enumerate(derivatives.exponents[1:], 1):
            lower = tuple(derivatives.exponents[derivatives.parent[i]].tolist())
            every[tuple(alpha.tolist())] = _derivative(
                monomials, every[lower], int(derivatives.variable[i])
            )
        scaled = np.stack(
            [
                every[tuple(alpha)] / prod(map(factorial, alpha))
                for alpha in derivatives.exponents.tolist()
            ],
            axis=1,
        )
        low = int(derivatives.starts[ORDER + 1])
        sizes = np.abs(scaled[:, :low]).sum(axis=(0, 1))
        rest = np.abs(scaled[:, low:]).sum(axis=0) * (1 + 1e-12)
        return cls(chart, scaled[:, :low], derivatives.exponents[low:], rest, sizes)

    @property
    def used(self) -> Array:
        """Number of leading terms that can be nonzero in each derivative ``∂^α``: (M,)."""
        starts, degrees = (
            self.chart.monomials.starts,
            Monomials(self.chart.monomials.k, ORDER),
        )
        left = np.maximum(
            self.chart.monomials.degree - degrees.exponents.sum(axis=1), -1
        )
        return np.asarray(starts[left + 1])


def _derivative(monomials: Monomials, C: Array, j: int) -> Array:
    """Differentiate polynomials with coefficients C (T, …) with respect to u_j.

    Returns the coefficients (T, …) of the derivatives.
    """
    out = np.zeros_like(C)
    powers = monomials.exponents[:, j]
    on = powers > 0
    np.add.at(
        out, monomials.lower[j][on], C[on] * powers[on].reshape(-1, *[1] * (C.ndim - 1))
    )
    return out
