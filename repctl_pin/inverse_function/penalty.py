"""Margin penalties in the cost: the weight of a violated margin is raised until the margin is met
wherever the arm can meet it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ..arguments import Array
from ..strategies.strategy import Batched
from .chart import Chart
from .cost import Cost, Descent, Penalty, descend
from .margins import CandidateFunction, Margin, searched
from .monomials import Monomials

_WEIGHTS = (1e2, 1e5)
"""First and last weight of the penalties; it is raised tenfold in each round."""

_LOW = 2
"""Degree of the first fit with penalties: with many terms a few poses would cause large bends."""

_FAR = 2
"""Multiple of the required margin above which no smaller margins are searched for."""

_NEARLY = 0.1
"""Share of the best attainable margin, and of the required one, that is not asked for."""

_GRID = 0.05
"""Grid in u to which the poses found by a search are rounded, so that they do not cluster."""


def padded(a: Array, terms: Monomials) -> Array:
    """Pad coefficients a (M, …) of a lower degree with zeros: monomials are ordered by degree."""
    return np.pad(a, ((0, terms.size - len(a)), *[(0, 0)] * (a.ndim - 1)))


class ActiveConstraint:
    """One margin, the poses at which it is checked, and those where it is penalised.

    Attributes
    ----------
    edge : (L, k) array
        Poses where it is penalised.
    asked : (L,) array
        Margin asked for there: the required one, or slightly less than the best one that any leaf
        nearby has.
    """

    def __init__(self, margin: Margin, U: Array) -> None:
        self.margin, self.U = margin, U
        self.edge, self.asked = U[:0], np.zeros(0)

    def short(self, candidate: CandidateFunction) -> bool:
        """Whether the margin is too small somewhere; penalise the worst of these poses.

        From poses where it is small, smaller margins are searched for. The poses found are checked
        from then on.
        """
        margin = self.margin
        near = margin.least(candidate.at(self.U))
        if near.min(initial=np.inf) > _FAR * margin.required:
            return False
        found = searched(candidate, margin, self.U[np.argsort(near)[: margin.starts]])
        new = _without(_GRID * np.round(found / _GRID), self.U)
        self.U, near = (
            np.concatenate([self.U, new]),
            np.concatenate([near, margin.least(candidate.at(new))]),
        )
        worst = np.argsort(near)[: 4 * margin.violators]
        worst = worst[near[worst] < margin.required]
        most = margin.attainable(candidate.chart, candidate.at(self.U[worst]))
        asked = np.minimum(margin.required, most - _NEARLY * np.abs(most))
        short = asked - near[worst]
        edge = self.U[worst]
        if not (short > np.maximum(margin.slack * asked, _NEARLY * margin.required)).any():
            return False
        chosen = np.argsort(-short)[: margin.violators]
        chosen = chosen[short[chosen] > 0]
        self.edge, first = np.unique(
            np.concatenate([self.edge, edge[chosen]]), axis=0, return_index=True
        )
        self.asked = np.concatenate([self.asked, asked[chosen]])[first]
        return True


class PenaltyMethod:
    """Penalty method on the worst poses found so far.

    Parameters
    ----------
    desired, chart
        G_d, and the chart in which the function is written.
    nodes : (K, k) array
        Nodes of the cost.
    constraints
        The margins.
    rounds
        Maximum number of rounds, in each of which the weight is raised or poses are added.
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
        """Minimise with penalties, if a margin is too small at the minimum without them.

        A fit of low degree comes first, then one of the final degree.
        """
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
            active = " and ".join(w.margin.name for w in self.constraints if len(w.edge))
            report(f"{active}, degree {terms.degree}", 0.5 + 0.03 * i)
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
        candidate = CandidateFunction(self.chart, terms, a)
        short = [watch.short(candidate) for watch in self.constraints]  # without short-circuit
        return any(short)


def _without(U: Array, known: Array) -> Array:
    """Take each row of U once, without those of another array."""
    once, first = np.unique(np.concatenate([known, U]), axis=0, return_index=True)
    return once[first >= len(known)]
