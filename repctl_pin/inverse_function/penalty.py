"""Margins in the cost: a price on what comes too near, raised until it is kept away wherever it can
be."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ..arguments import Array
from ..strategies.strategy import Batched
from .chart import Chart
from .cost import Cost, Descent, Penalty, descend
from .margins import Margin, Section, searched
from .monomials import Monomials

_WEIGHTS = (1e2, 1e5)
"""Of the margins in the cost: the first, and the last after raising it tenfold again and again."""

_LOW = 2
"""The degree at which margins are first kept: of many terms a few poses would ask for wild
bends."""

_FAR = 2
"""How many times the room a margin has everywhere if it is not worth a search."""

_NEARLY = 0.1
"""The part of the margin that the arm has somewhere, and of the room, that is not asked for."""

_GRID = 0.05
"""Poses that a search has found are taken from a grid in u, so that they do not crowd."""


def padded(a: Array, terms: Monomials) -> Array:
    """Write coefficients a (M, r) of a lower degree in a higher one: monomials are ordered by
    degree."""
    return np.pad(a, ((0, terms.size - len(a)), (0, 0)))


class ActiveConstraint:
    """One margin, the poses at which it is looked at, and those where it has a price.

    Attributes
    ----------
    edge : (L, k) array
        Those with a price.
    asked : (L,) array
        The margin asked for there: the room, or where the arm has less on every leaf nearby, nearly
        that.
    """

    def __init__(self, margin: Margin, U: Array) -> None:
        self.margin, self.U = margin, U
        self.edge, self.asked = U[:0], np.zeros(0)

    def short(self, section: Section) -> bool:
        """Whether the margin is too small somewhere; give the worst of these poses a price.

        Where it is small, lower ones are searched for, and looked at from then on.
        """
        margin = self.margin
        near = margin.least(section.at(self.U))
        if near.min(initial=np.inf) > _FAR * margin.room:
            return False
        found = searched(section, margin, self.U[np.argsort(near)[: margin.starts]])
        new = _without(_GRID * np.round(found / _GRID), self.U)
        self.U, near = (
            np.concatenate([self.U, new]),
            np.concatenate([near, margin.least(section.at(new))]),
        )
        worst = np.argsort(near)[: 4 * margin.violators]
        worst = worst[near[worst] < margin.room]
        most = margin.attainable(section.chart, section.at(self.U[worst]))
        asked = np.minimum(margin.room, most - _NEARLY * np.abs(most))
        short = asked - near[worst]
        edge = self.U[worst]
        if not (short > np.maximum(margin.slack * asked, _NEARLY * margin.room)).any():
            return False
        chosen = np.argsort(-short)[: margin.violators]
        chosen = chosen[short[chosen] > 0]
        self.edge, first = np.unique(
            np.concatenate([self.edge, edge[chosen]]), axis=0, return_index=True
        )
        self.asked = np.concatenate([self.asked, asked[chosen]])[first]
        return True


class PenaltyMethod:
    """Keeps a section away from what it should not meet, at the poses where it is met first.

    Parameters
    ----------
    desired, chart
        G_d, and what the section is written in.
    nodes : (K, k) array
        Of the cost.
    constraints
        The margins.
    rounds
        At most so many times the weight is raised, or poses are added.
    """

    def __init__(
        self,
        desired: Batched,
        chart: Chart,
        nodes: Array,
        constraints: Sequence[ActiveConstraint],
        rounds: int,
    ) -> None:
        self.desired, self.chart, self.nodes, self.constraints = desired, chart, nodes, constraints
        self.rounds, self.weight = rounds, _WEIGHTS[0]

    def kept(
        self, descent: Descent, terms: Monomials, report: Callable[[str, float], None]
    ) -> Descent:
        """Go on from where the cost alone is least, if a margin is short there: at a low degree,
        then at this."""
        if not self.rounds or not self._short(terms, descent.a):
            return descent
        r, steps, a = descent.a.shape[1], descent.steps, descent.a
        if terms.degree > _LOW:
            low = Monomials(terms.k, _LOW)
            free = descend(Cost(self.desired, self.chart, low, self.nodes), np.zeros((low.size, r)))
            a = padded(self._rounds(free, low, report).a, terms)
        found = self._rounds(replace(descent, a=a), terms, report)
        return replace(found, steps=steps + found.steps)

    def _rounds(
        self, descent: Descent, terms: Monomials, report: Callable[[str, float], None]
    ) -> Descent:
        size = 0
        for i in range(self.rounds):
            report(f"{' and '.join(w.margin.name for w in self.constraints if len(w.edge))}, degree {terms.degree}",
                   0.5 + 0.03 * i)  # fmt: skip
            if not self._short(terms, descent.a) and i:
                break
            kept = [Penalty(w.margin, w.edge, w.asked) for w in self.constraints]
            cost = Cost(self.desired, self.chart, terms, self.nodes, kept, weight=self.weight)
            stiffer = descend(cost, descent.a, enough=1e-3)
            if not np.isfinite(stiffer.value.cost):
                break
            descent = replace(stiffer, steps=descent.steps + stiffer.steps)
            edge = sum(len(watch.edge) for watch in self.constraints)
            if self.weight == _WEIGHTS[1] and stiffer.steps <= 1 and edge == size:
                break
            self.weight, size = min(10 * self.weight, _WEIGHTS[1]), edge
        return descent

    def _short(self, terms: Monomials, a: Array) -> bool:
        """Whether any margin is too small somewhere."""
        section = Section(self.chart, terms, a)
        return max(
            [watch.short(section) for watch in self.constraints]
        )  # every one of them is looked at


def _without(U: Array, known: Array) -> Array:
    """Take every row of U once, those of another array left out."""
    once, first = np.unique(np.concatenate([known, U]), axis=0, return_index=True)
    return once[first >= len(known)]
