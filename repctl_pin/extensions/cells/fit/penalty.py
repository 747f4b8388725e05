"""Penalty method for margins: the weight of the penalties is raised until the margins are met.

A cell is a box of poses. A margin is a distance from joint limits, between bodies, or σ_min of J,
at the configurations of a candidate function, which gives one configuration for each pose of the
cell. The required margin must be met at every pose at which the arm can meet it. Coefficients a (N,
r) are those of s(u), the position of the function along the self-motion, in N monomials of the
coordinates u (k,) of a pose. A leaf is the set of configurations with one value of s; nearby leaves
have slightly different values of s. Nodes are the poses at which the cost is evaluated. A chart
consists of polynomials of u that approximate a configuration, from which s is measured, and the
null space. The label is s, with r components. K and L are numbers of poses.

``Monomials`` are all monomials ``u^α`` up to a degree in the coordinates u, the constant 1 first.
``CandidateFunction`` is a candidate for F: a chart, and the coefficients a of the label ``s(u) =
Σ_t a_t T_t(u)``, with monomials T_t. ``Chart`` is coordinates (u, s) of configurations: u gives the
pose, the label s (r,) the position along its self-motion. ``ActiveConstraint`` is one kind of
margin, with the poses at which it is checked and those at which it is penalised. ``Descent`` is the
result of a minimisation: coefficients a, the cost with its configurations, and the number of steps.
``Inverse`` is a matrix function G(q) (n, m) with J G = I, evaluated at q (n,) or Q (K, n).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ....base.arguments import Array
from ....strategies.strategy import Inverse
from ..chart.chart import Chart, Points
from ..chart.monomials import Monomials
from ..evaluate.margins import CandidateFunction, Margin, searched
from ..geometry.kinematics import joined, rows_of
from .cost import Cost, Descent, Penalty, descend

_WEIGHTS = (1e2, 1e5)
"""Smallest first, and last weight of the penalties; a round multiplies the weight by 10."""

_LOW = 2
"""Degree of the first fit with penalties: with a higher degree, few penalised poses would cause
large variations of the function between them."""

_FAR = 2
"""If the margin is above this multiple of the required one at all checked poses, there is no search
for smaller ones."""

_NEARLY = 0.1
"""Fraction of the attainable margin, and of the required one, by which a margin may fall short."""

_MORE, _SPARE = 6, 0.9
"""Number of rounds beside those with penalties, if joint speed exceeds its limit at a node; and
share of the limit up to which a node is not too fast."""

_STIFFER, _STIFFEST = 3.0, 1e4
"""Largest factor of a node's weight per round, and largest weight."""

_GRID = 0.05
"""Spacing in u of the grid to which poses found by a search are rounded, to avoid clusters."""


def padded(a: Array, terms: Monomials) -> Array:
    """Extend coefficients a (M, …) with zeros to the N ≥ M monomials ``terms``: (N, …)."""
    return np.pad(a, ((0, terms.size - len(a)), *[(0, 0)] * (a.ndim - 1)))


class ActiveConstraint:
    """One kind of margin, the poses at which it is checked, and those at which it is penalised.

    Attributes
    ----------
    margin : Margin
        The kind of margin, with its required value.
    U : (K, k) array
        Poses at which the margin is checked; a search adds poses with smaller margins.
    edge : (L, k) array
        Poses at which the margin is penalised.
    asked : (L,) array
        Margin that the penalty asks for at each pose of ``edge``: the required margin or, if
        smaller, a value slightly below the largest margin on nearby leaves.
    """

    def __init__(self, margin: Margin, U: Array) -> None:
        self.margin, self.U = margin, U
        self.edge, self.asked = U[:0], np.zeros(0)

    def short(self, candidate: CandidateFunction) -> bool:
        """Test whether the margin of a candidate function is too small at some pose.

        At a pose, the margin is too small if it is below the margin asked for by more than a
        tolerance; :attr:`asked` describes the margin asked for. A search for smaller margins starts
        at the checked poses with the smallest margins. The poses that the search finds are added to
        the checked poses :attr:`U`. If the result is True, the poses at which the margin is
        farthest below the margin asked for are added to the penalised poses :attr:`edge`.
        """
        margin = self.margin
        at = candidate.at(self.U)
        near = margin.least(at)
        if near.min(initial=np.inf) > _FAR * margin.required:
            return False
        starts = margin, self.U[np.argsort(near)[: margin.starts]]
        found = searched(candidate, starts, shortest=_GRID / 2)
        new = _without(_GRID * np.round(found / _GRID), self.U)
        self.U = np.concatenate([self.U, new])
        more = candidate.at(new)
        near = np.concatenate([near, margin.least(more)])
        worst = np.argsort(near)[: 4 * margin.violators]
        worst = worst[near[worst] < margin.required]
        at = rows_of(joined([at, more]), worst)
        asked, short = self._shortage(candidate.chart, at, near[worst])
        edge = self.U[worst[: len(short)]]
        if not self._too_short(short, asked).any():
            return False
        chosen = np.argsort(-short)[: margin.violators]
        chosen = chosen[short[chosen] > 0]
        self.edge, first = np.unique(
            np.concatenate([self.edge, edge[chosen]]), axis=0, return_index=True
        )
        self.asked = np.concatenate([self.asked, asked[chosen]])[first]
        return True

    def _shortage(self, chart: Chart, at: Points, near: Array) -> tuple[Array, Array]:
        """Evaluate margins asked for, and shortages, at as many of the K points ``at`` as needed.

        A shortage is the margin asked for minus the actual margin. ``near`` (K,) are the actual
        margins at the points, in rising order. Return two arrays (L,), for the first L points: the
        margins asked for, and the shortages.

        Each margin asked for is found by a slow search, so L is chosen small. But the other points
        cannot change the result of :meth:`short`: if no shortage among the first L is too large,
        none of the K is. Otherwise, the ``margin.violators`` largest shortages of all K points are
        among the first L.
        """
        margin, count = self.margin, self.margin.violators
        most = margin.required - near  # no more than the required margin is asked for

        def extended(asked: Array, last: int) -> tuple[Array, Array]:
            more = self._asked(chart, rows_of(at, slice(len(asked), last)))
            asked = np.concatenate([asked, more])
            return asked, asked - near[: len(asked)]

        asked, short = extended(np.zeros(0), count)
        if not self._too_short(short, asked).any():
            asked, short = extended(asked, int((most > _NEARLY * margin.required).sum()))
        if self._too_short(short, asked).any():
            asked, short = extended(asked, int((most > np.sort(short)[-count:].min()).sum()))
        return asked, short

    def _asked(self, chart: Chart, at: Points) -> Array:
        """Evaluate the margin that the penalty asks for at points ``at``: (K,)."""
        margin = self.margin
        most = margin.attainable(chart, at, enough=margin.required / (1 - _NEARLY))
        return np.minimum(margin.required, most - _NEARLY * np.abs(most))

    def _too_short(self, short: Array, asked: Array) -> NDArray[np.bool_]:
        """Test which shortages ``short`` (K,) are too large, relative to ``asked``: (K,).

        A shortage is small enough up to a bound: ``margin.slack`` times the margin ``asked`` (K,),
        or 10 % of the required margin, whichever is larger.
        """
        margin = self.margin
        return short > np.maximum(margin.slack * asked, _NEARLY * margin.required)

    def penalty(self, candidate: CandidateFunction) -> Penalty:
        """Make the term of the cost that penalises margins of a function below :attr:`asked`.

        It contains the poses :attr:`edge`, except those at which the function ``candidate`` has no
        configuration.
        """
        there = candidate.at(self.edge).found
        return Penalty(self.margin, self.edge[there], self.asked[there])


class PenaltyMethod:
    """Minimisation of the cost with penalties on margins, at the worst poses found so far.

    The cost is the mean distance of a function's derivative from the desired inverse G_d, over
    poses of a cell. Each round multiplies the weight of the penalties by ten, up to a maximum, and
    adds the worst poses found.

    Parameters
    ----------
    desired, chart
        G_d, and the chart in which the function is written.
    nodes : (K, k) array
        Nodes of the cost.
    constraints
        One constraint per kind of margin; a minimisation adds poses to these constraints.
    rounds
        Maximum number of rounds; with 0, nothing is penalised.
    most_extra
        Maximum joint speed at any node relative to that of G_d, minus 1 (0.05 is 5 %). Where
        penalties make a function exceed it, the weight of the node in the cost rises; up to six
        rounds are added to ``rounds`` for this.
    """

    def __init__(
        self,
        desired: Inverse,
        chart: Chart,
        nodes: Array,
        constraints: Sequence[ActiveConstraint],
        rounds: int,
        most_extra: float = np.inf,
    ) -> None:
        self.desired = desired
        self.chart = chart
        self.nodes = nodes
        self.shares, self.most = np.ones(len(nodes)), (1 + _SPARE * most_extra) ** 2 - 1
        self.constraints = constraints
        first = _WEIGHTS[1] / 10 ** max(rounds - 1, 0)
        self.rounds, self.weight = rounds, max(first, _WEIGHTS[0])

    def kept(
        self,
        descents: Sequence[Descent],
        terms: Monomials,
        report: Callable[[str, float], None],
        *,
        enough: float = 1e-3,
        guess: Array | None = None,
    ) -> Descent:
        """Minimise the cost with penalties, from the results of minimisations without penalties.

        If no margin is too small in the last result, this result is returned. Otherwise the cost is
        minimised with the monomials ``terms``; a degree above 2 is preceded by a fit of degree 2.
        The poses at which the last result is farthest below the required margins stay penalised in
        every fit.

        Parameters
        ----------
        descents
            Results without penalties, of rising degree, the last with ``terms``. A result of degree
            2 is used if its function exists at all nodes.
        terms
            The monomials.
        report
            Progress callback.
        enough
            Relative decrease of the cost in one step below which an iteration ends.
        guess : (N, r) array, optional
            Coefficients at which the fit of degree 2 begins; ignored if ``terms`` have degree 2 or
            less. By default, that fit begins at a function without penalties.
        """
        descent = descents[-1]
        if not self.rounds or not self._short(terms, descent.a):
            return descent
        a, below = descent.a, 0
        if terms.degree > _LOW:
            low = Monomials(terms.k, _LOW)
            free = next((d for d in descents if len(d.a) == low.size), None)
            cost = Cost(self.desired, self.chart, low, self.nodes)
            if free is None or not np.isfinite(cost.value(free.a).cost):
                free = descend(cost, np.zeros((low.size, descent.a.shape[1])))
            if guess is not None:
                self._short(low, free.a)
                free, self.weight = replace(free, a=guess), _WEIGHTS[1] / 100
            lower = self._rounds(free, low, report, enough)
            a, below = padded(lower.a, terms), lower.steps
        found = self._rounds(replace(descent, a=a), terms, report, enough)
        return replace(found, steps=below + found.steps)

    def _rounds(
        self,
        descent: Descent,
        terms: Monomials,
        report: Callable[[str, float], None],
        enough: float,
    ) -> Descent:
        """Minimise the cost in rounds, each with higher weights or more poses.

        ``descent`` is the result from which the first round begins, ``terms`` are its monomials.
        The rounds end when all margins are met, nothing changes, or the function does not exist.
        Each minimisation ends when a step lowers the cost by less than the fraction ``enough``.
        Return the last result; its number of steps is that of ``descent`` plus those of all rounds.
        """
        size = 0
        more = _MORE if np.isfinite(self.most) else 0
        for i in range(self.rounds + more):
            active = " and ".join(w.margin.name for w in self.constraints if len(w.edge))
            report(f"{active}, degree {terms.degree}", 0.5 + 0.03 * i)
            short, fast = self._short(terms, descent.a), self._too_fast(terms, descent)
            if not fast and (i >= self.rounds or (i and not short)):
                break
            candidate = CandidateFunction(self.chart, terms, descent.a)
            kept = [w.penalty(candidate) for w in self.constraints]
            how = {"weight": self.weight, "shares": self.shares}
            cost = Cost(self.desired, self.chart, terms, self.nodes, kept, **how)
            stiffer = descend(cost, descent.a, enough=enough)
            if not np.isfinite(stiffer.value.cost):
                break
            descent = replace(stiffer, steps=descent.steps + stiffer.steps)
            edge = sum(len(watch.edge) for watch in self.constraints)
            if self.weight == _WEIGHTS[1] and stiffer.steps <= 1 and edge == size and not fast:
                break
            self.weight, size = min(10 * self.weight, _WEIGHTS[1]), edge
        return descent

    def _too_fast(self, terms: Monomials, descent: Descent) -> bool:
        """Test whether extra joint speed exceeds its limit at a node; raise the weights there.

        ``descent`` has the coefficients of the monomials ``terms``. The weight of a node is
        multiplied by a factor of at most 3, and falls again where joint speed is far below the
        limit.
        """
        if not np.isfinite(self.most):
            return False
        excess = descent.value.excess
        if len(excess) != len(self.nodes):
            cost = Cost(self.desired, self.chart, terms, self.nodes)
            excess = cost.value(descent.a).excess
        if not len(excess):
            return False
        factor = np.clip(excess / self.most, 0.5, _STIFFER)
        self.shares = np.clip(self.shares * factor, 1.0, _STIFFEST)
        return bool(excess.max() > self.most)

    def _short(self, terms: Monomials, a: Array) -> bool:
        """Test whether any margin is too small at some pose, for the coefficients a (N, r).

        All kinds of margins are tested, even after one is too small, because each test also adds
        the worst poses to the penalised poses.
        """
        candidate = CandidateFunction(self.chart, terms, a)
        short = [watch.short(candidate) for watch in self.constraints]  # without short-circuit
        return any(short)


def _without(U: Array, known: Array) -> Array:
    """Return the distinct rows of U (L, k) that are not rows of ``known`` (K, k)."""
    once, first = np.unique(np.concatenate([known, U]), axis=0, return_index=True)
    return once[first >= len(known)]
