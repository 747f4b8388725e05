"""Descents to a regular optimum: a search of Ω keeps them clear of singularities between the nodes.

A descent sees det(Nᵀ V) at the nodes alone, and potentials of high degree have room between them. So Ω is searched
behind every descent. Where det(Nᵀ V) vanishes the point is guarded, and the descent begins again from where V is known
to be regular; and where there is no such start, the lower degrees are climbed, each from the one below.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..arguments import Array
from ..fields.field import Field
from ..fields.polynomial import Polynomial
from ..regions import Region
from ..strategies.strategy import Inverse
from . import criterion
from .batches import Guarded
from .descend import Descent, Report, Start, descend, start
from .independence import Independent
from .singularities import Lowest, Measure, SingularRegionError, refuse_singular, search, signed_leaf_margin

_PENALTY, _MOST_PENALTY = 1e-2, 1e-1
_ROUNDS = 6
_RESTART = 0.3


@dataclass
class Way:
    """What the descents of one fit have in common.

    Attributes
    ----------
    desired, fields, region, chosen
        G_d, the family of potentials, Ω, and the potentials that are of use there.
    coarse : Guarded
        Few nodes.
    seed, restarts, tolerance
        Of the search and of further descents on few nodes.
    report
        Takes the steps.
    """

    desired: Inverse
    fields: Field
    region: Region
    chosen: Independent
    coarse: Guarded
    seed: int
    restarts: int
    tolerance: float
    report: Report

    def __post_init__(self) -> None:
        self.moments = self.coarse.total(criterion.linear)
        self._starts: dict[int, Start] = {}

    def margin(self, A: Array) -> Measure:
        """Measure the leaf margin of V, positive on the side of the center."""
        leaf_margin = signed_leaf_margin(self.desired.task, self.fields.weighted(self.chosen.spread(A)))
        side = np.sign(leaf_margin(self.region.center[None]))[0]
        return lambda Q: side * leaf_margin(Q)

    def regular(self, warm: Array | None) -> Iterator[Descent]:
        """Offer optima on few nodes with no singularity that a search finds, the best first.

        That of all potentials; where it is singular, the one of lower degree that was given (``warm``); without it,
        what can be reached by climbing the degrees.
        """
        whole = len(self.chosen.kept)
        below = None if warm is None else self._kept_of(warm)
        best = self.rung(whole, below)
        if best is not None:
            yield best
        if below is not None:
            yield self._still(below)
            return
        ladder: list[Descent] = []
        for size in self._rungs():
            found = self.rung(size, ladder[-1].A if ladder else None)
            if found is not None:
                ladder.append(found)
        yield from reversed(ladder)

    def rung(self, size: int, below: Array | None) -> Descent | None:
        """Descend with the first potentials, from the linear start or from an optimum of fewer, the lower one first."""
        begin = self._start(size)
        starts = [begin.A] if below is None else [begin.A, _padded(below, size)]
        costs = [self.coarse.total(criterion.cost, A) for A in starts]
        for i in sorted(range(len(starts)), key=lambda i: costs[i][0]):
            if costs[i][1].clear:
                found = self.descend(self.coarse, starts[i], _PENALTY, self.tolerance)
                if found is not None:
                    return min([found, *self._again(starts[i])], key=lambda one: one.cost)
        return None

    def descend(self, batches: Guarded, A: Array, penalty: float, tolerance: float) -> Descent | None:
        """Descend from a regular V to a regular one; None where A is not regular itself, or no end is found to be."""
        basis, begin = self.chosen.basis[: len(A), : len(A)], self._start(len(A))
        for _ in range(_ROUNDS):
            found = descend(batches, basis, begin, A, penalty=penalty, tolerance=tolerance, report=self.report)
            penalty = max(penalty, min(10 * penalty, _MOST_PENALTY))
            lowest = self._lowest(found.A)
            if found.sides.clear and lowest.value > 0:
                return found
            bad = lowest.ends[lowest.values <= 0]
            if not found.sides.clear or (self.margin(A)(bad) <= 0).any():
                return None
            batches.guard(bad)
        return None

    def refusal(self, Q: Array, error: SingularRegionError | None) -> SingularRegionError:
        """Refuse Ω: det(Nᵀ V) has both signs at the linear start, or no descent was free of it."""
        begin = self._start(len(self.chosen.kept))
        measure = self.margin(begin.A)
        bad = Q[measure(Q) <= 0]
        if not len(bad):
            lowest = self._lowest(begin.A)
            bad = lowest.ends[lowest.values <= 0]
        if not len(bad) and error is not None:
            bad = error.at[None]
        return refuse_singular("an algorithmic singularity lies", self.desired.task, measure, self.region, bad[0], bad)

    def _again(self, A: Array) -> Iterator[Descent]:
        """Descend from random changes of a start."""
        basis = self.chosen.basis[: len(A), : len(A)]
        for attempt in range(self.restarts):
            noise = np.random.default_rng([self.seed, attempt]).normal(size=A.shape)
            away = A + _RESTART * basis @ noise / np.sqrt(len(noise))
            found = None
            if self.coarse.total(criterion.cost, away)[-1].clear:
                found = self.descend(self.coarse, away, _PENALTY, self.tolerance)
            if found is not None:
                yield found

    def _start(self, size: int) -> Start:
        """Solve the linear problem of the first potentials, once."""
        if size not in self._starts:
            self._starts[size] = start(self.coarse.batches, self.chosen.basis[:size, :size], self.moments)
        return self._starts[size]

    def _still(self, A: Array) -> Descent:
        """Take coefficients as they are."""
        cost, sides = self.coarse.batches.total(criterion.cost, A)
        return Descent(A, cost, 0.0, False, 0, sides)

    def _lowest(self, A: Array) -> Lowest:
        return search(self.margin(A), self.region, self.region.random(1024, self.seed + 7919))

    def _kept_of(self, warm: Array) -> Array:
        """Take the coefficients of the potentials that are kept, of those that there were."""
        return warm[self.chosen.kept[self.chosen.kept < len(warm)]]

    def _rungs(self) -> list[int]:
        """How many of the potentials have degree 1, 1 and 2, …; a family without degrees is one rung."""
        if not isinstance(self.fields, Polynomial):
            return [len(self.chosen.kept)]
        degrees = self.fields.exponents[self.chosen.kept].sum(axis=1)  # they rise
        ends = np.searchsorted(degrees, np.unique(degrees), side="right")
        return [int(size) for size in ends if size >= self.desired.task.r]


def _padded(A: Array, size: int) -> Array:
    return np.concatenate([A, np.zeros((size - len(A), A.shape[1]))])
