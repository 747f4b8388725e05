"""The poses of a cell where a section has the least room: searched for, not only sampled."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arguments import Array
from .chart import Chart, Points
from .margins import Margin
from .monomials import Monomials

_STEPS, _FIRST, _LONGEST, _SHORTEST = 25, 0.2, 0.5, 1e-4
"""Steps of a search, and their lengths in u."""

_JUMP = 1.0
"""A joint step, rad or m, that means another section."""


@dataclass(frozen=True)
class Section:
    """``s(u) = Σ_t a_t T_t(u)`` in a chart.

    Attributes
    ----------
    chart : Chart
    terms : Monomials
        T.
    a : (N, r) array
    """

    chart: Chart
    terms: Monomials
    a: Array

    @classmethod
    def zero(cls, chart: Chart) -> Section:
        """Make the section s = 0."""
        return cls(chart, Monomials(chart.cell.k, 0), np.zeros((1, chart.cell.task.r)))

    def at(self, U: Array, Q: Array | None = None) -> Points:
        """Find its points at U (K, k)."""
        return self.chart.solve(U, self.terms.values(U) @ self.a, Q)

    def derivative(self, at: Points) -> Array:
        """Differentiate it with respect to u: (K, n, k)."""
        slopes = self.terms.slopes(self.terms.values(at.U))
        return self.chart.derivative(at, np.einsum("KNk,Nr->Krk", slopes, self.a))[0]


def searched(section: Section, margin: Margin, U: Array) -> Array:
    """Go from poses U (K, k) down a margin inside the cell, all at once; every pose on the way (L, k), ends last.

    Steps along the gradient, without its parts that point out of the cell: longer after a step that helped, shorter
    after one that did not.
    """
    here = section.at(U)
    here = here.chosen(here.found)
    least, length = margin.least(here), np.full(len(here.U), _FIRST)
    visited = [here.U]
    for _ in range(_STEPS):
        on = np.flatnonzero(length > _SHORTEST)
        if not len(on):
            break
        part = here.chosen(on)
        lowest = margin.measure(part.Q).argmin(axis=1)
        slope = margin.slopes(part.Q, section.derivative(part))[np.arange(len(on)), lowest]  # (L, k)
        slope = np.where((np.abs(part.U) >= 1) & (slope * part.U < 0), 0.0, slope)
        way = slope / np.maximum(np.abs(slope).max(axis=1, keepdims=True), 1e-12)
        there = section.at(np.clip(part.U - length[on, None] * way, -1, 1), part.Q)
        lower = margin.least(there)
        good = (lower < least[on]) & (np.abs(there.Q - part.Q).max(axis=1) < _JUMP)
        length[on] = np.where(good, np.minimum(1.5 * length[on], _LONGEST), length[on] / 3)
        here, least[on[good]] = here.replaced(on[good], there.chosen(good)), lower[good]
        visited.append(there.U[good])
    return np.concatenate([*visited, here.U])
