"""Joint limits in the cost: a price on their nearness, raised until they are kept wherever they can be."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..strategies.strategy import Batched
from .chart import Chart, attainable
from .cost import Cost
from .descend import Descent, descend
from .monomials import Monomials

Array = NDArray[np.float64]

_WEIGHTS = (1e2, 1e5)
"""Of the joint limits in the cost: the first, and the last after raising it tenfold again and again."""

_VIOLATORS = 96
"""Poses at most that a round adds to those where limits cost."""

_LOW = 2
"""The degree at which limits are first kept: of many terms a few poses would ask for wild bends."""


def padded(a: Array, terms: Monomials) -> Array:
    """Write coefficients a (M, r) of a lower degree in a higher one: monomials are ordered by degree."""
    return np.concatenate([a, np.zeros((terms.size - len(a), a.shape[1]))])


class LimitKeeper:
    """Keeps a section inside the joint limits, at the poses where they are met first.

    Parameters
    ----------
    desired, chart
        G_d, and what the section is written in.
    nodes : (K, k) array
        Of the cost.
    watched : (L, k) array
        Poses at which limits are looked at.
    room
        The margin, rad or m, that is asked for; where the arm has less on every leaf nearby, nine tenths of that.
    rounds
        At most so many times the weight is raised, or poses are added.
    """

    def __init__(self, desired: Batched, chart: Chart, nodes: Array, watched: Array, room: float, rounds: int) -> None:
        self.desired, self.chart, self.nodes, self.watched = desired, chart, nodes, watched
        self.room, self.rounds, self.weight = room, rounds, _WEIGHTS[0]
        self.edge, self.asked = watched[:0], np.zeros(0)
        self._last: Array | None = None

    def kept(self, descent: Descent, terms: Monomials, report: Callable[[str, float], None]) -> Descent:
        """Go on from where the cost alone is least, if limits are not kept there: at a low degree, then at this."""
        if not self.rounds or not self._short(terms, descent.a):
            return descent
        r, steps = descent.a.shape[1], descent.steps
        a = descent.a
        if terms.degree > _LOW:
            low = Monomials(terms.k, _LOW)
            free = descend(Cost(self.desired, self.chart, low, self.nodes, self.edge[:0]), np.zeros((low.size, r)))
            a = padded(self._rounds(free, low, report).a, terms)
        found = self._rounds(replace(descent, a=a), terms, report)
        return replace(found, steps=steps + found.steps)

    def _rounds(self, descent: Descent, terms: Monomials, report: Callable[[str, float], None]) -> Descent:
        size = 0
        for i in range(self.rounds):
            report(f"joint limits, degree {terms.degree}", 0.5 + 0.03 * i)
            if not self._short(terms, descent.a) and i:
                break
            cost = Cost(self.desired, self.chart, terms, self.nodes, self.edge, room=self.asked, weight=self.weight)
            stiffer = descend(cost, descent.a, enough=1e-3)
            if not np.isfinite(stiffer.value.cost):
                break
            descent = replace(stiffer, steps=descent.steps + stiffer.steps)
            if self.weight == _WEIGHTS[1] and stiffer.steps <= 1 and len(self.edge) == size:
                break
            self.weight, size = min(10 * self.weight, _WEIGHTS[1]), len(self.edge)
        return descent

    def _short(self, terms: Monomials, a: Array) -> bool:
        """Whether limits are too near somewhere; add the worst of these poses to the edge."""
        task = self.chart.cell.task
        points = self.chart.solve(self.watched, terms.values(self.watched) @ a, self._last)
        self._last = points.Q if points.found.all() else None
        close = np.where(points.found, task.limit_margin(points.Q).min(axis=1), np.inf)
        worst = np.argsort(close)[: 4 * _VIOLATORS]
        worst = worst[close[worst] < self.room]
        most = attainable(self.chart, points.chosen(worst))
        asked = np.minimum(self.room, 0.9 * most)
        short = np.where(most > 0, asked - close[worst], -np.inf)  # where nothing helps, nothing is asked for
        if not (short > 0.4 * asked).any():
            return False
        chosen = np.argsort(-short)[:_VIOLATORS]
        chosen = chosen[short[chosen] > 0]
        every = np.concatenate([self.edge, self.watched[worst[chosen]]])
        self.edge, first = np.unique(every, axis=0, return_index=True)
        self.asked = np.concatenate([self.asked, asked[chosen]])[first]
        return True
