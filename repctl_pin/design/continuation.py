"""Continuation in the degree of the potentials, to an optimum without algorithmic singularities.

At an algorithmic singularity the repeatable inverse fails though J has full rank: det(Nᵀ V) = 0. N
spans the null space of J, and V are the gradients of the r potentials h. A basis of
potentials has gradients D, one column per potential; a candidate design has coefficients A, and V =
D A. Its cost is the mean squared distance from the desired inverse G_d over the nodes, which are
configurations in the region Ω. A candidate is regular if a search finds no algorithmic singularity
in Ω. The independent potentials are those that remain when linearly dependent ones are left out of
the basis; they are in the order of rising degree.

A descent evaluates det(Nᵀ V) at the nodes alone, and potentials of high degree vary between them.
So Ω is searched for singularities after each descent. A configuration with det(Nᵀ V) = 0 is added
to the cost as a barrier point, and the descent is repeated from its starting point. If no regular
candidate of the full degree is found, the degree is raised from 1 step by step, and each fit starts
from the optimum of the degree below.

``BarrierCost`` is the cost over the nodes of a fit and over barrier points, configurations that
repel singularities. ``FitProblem`` holds the arguments of a fit: desired inverse, potentials,
region Ω and options. ``LeafMargin`` is the signed distance from an algorithmic singularity, as a
function of q. ``Descent`` is the result of a descent: coefficients A, cost, gradient norm, steps,
and whether it converged. ``Start`` is a starting point of a descent: coefficients A, their cost,
and two matrices of the penalty that keeps V near the null space of J. ``Lowest`` is the smallest
value of a measure that a search found, and its configuration; 0 or less is a singularity.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..base.arguments import Array, read_only
from ..base.fit_options import FitOptions
from ..base.progress import Report, silent
from ..potentials.basis import PotentialBasis
from ..potentials.polynomial import Polynomial
from ..regions import Region
from ..strategies.strategy import Inverse
from . import criterion
from .batches import BarrierCost
from .criterion import named
from .gauss_newton import Descent, Start, descend, start
from .independence import Independent
from .singularity_search import LeafMargin, Lowest, SingularRegionError, refuse_singular, search

_PENALTY, _MOST_PENALTY = 1e-2, 1e-1
_ROUNDS = 6
_RESTART = 0.3
_COARSE_TOLERANCE = 1e-4


@dataclass(frozen=True, eq=False)
@read_only
class FitProblem:
    """Arguments of a fit of potentials over one region Ω; see :func:`nearest_repeatable`.

    A fit in a smaller region, or of another degree, takes a changed copy.

    Attributes
    ----------
    desired, potentials, region
        G_d, the basis of the potentials, and Ω.
    options
        Numbers of nodes, random seed, and when to stop.
    warm : (N_first, r) array, optional
        Coefficients of a design of lower degree, for the first N_first potentials of the basis; one
        of the starting points of the fit. By default none.
    report
        Progress callback (step: str, fraction: float), with the finished fraction, 0 to 1.
    """

    desired: Inverse
    potentials: PotentialBasis
    region: Region
    options: FitOptions
    warm: Array | None = None
    report: Report = silent


class Continuation:
    """Sequence of descents for one fit, from low degrees to high ones.

    Coefficients A (N', r) refer to the first N' of the independent potentials. The coarse nodes are
    few, so that most descents are cheap; only the last ones use all nodes.

    Parameters
    ----------
    problem
        Arguments of the fit.
    chosen
        The independent potentials over Ω, and coordinates in which their gradients are
        orthonormal.
    coarse
        The cost over the coarse nodes and over barrier points.
    """

    def __init__(self, problem: FitProblem, chosen: Independent, coarse: BarrierCost) -> None:
        self.problem = problem
        self.chosen = chosen
        self.coarse = coarse
        self.tolerance = max(problem.options.tolerance, _COARSE_TOLERANCE)
        self.moments = coarse.total(criterion.linear)
        self._starts: dict[int, Start] = {}

    def margin(self, A: Array) -> LeafMargin:
        """Make the function that measures the signed leaf margin of the candidate A (N', r).

        It maps configurations (K, n) to ±σ_min(Nᵀ V̂) (K,), with V̂ the orthonormalised V. The
        absolute value is the distance from an algorithmic singularity, and the sign is positive
        where det(Nᵀ V) has the same sign as at the centre of Ω. So a search for the minimum finds
        singularities.
        """
        potentials = self.problem.potentials.weighted(self.chosen.spread(A))
        return LeafMargin(self.problem.desired.task, potentials, self.problem.region.center)

    def regular(self) -> Iterator[Descent]:
        """Yield regular optima on the coarse nodes, in falling order of the number of potentials.

        The first optimum uses all independent potentials; if no regular one is found, it is left
        out. If the fit was given the coefficients of a design of lower degree, ``problem.warm``,
        this design is the last result; it is not searched for singularities again. If not, the
        degree is raised from 1 step by step, and the regular optima of these degrees follow, that
        of the highest degree first.
        """
        whole = len(self.chosen.kept)
        warm = self.problem.warm
        kept = self.chosen.kept
        below = None if warm is None else warm[kept[kept < len(warm)]]
        best = self.fit_degree(whole, below)
        if best is not None:
            yield best
        if below is not None:
            cost, sides = self.coarse.batches.total(criterion.cost, below)
            yield Descent(below, cost, 0.0, False, 0, sides)
            return
        ladder: list[Descent] = []
        for size in self._sizes():
            found = self.fit_degree(size, ladder[-1].A if ladder else None)
            if found is not None:
                ladder.append(found)
        yield from reversed(ladder)

    def fit_degree(self, size: int, below: Array | None) -> Descent | None:
        """Minimise the cost with the first ``size`` independent potentials on the coarse nodes.

        There are two starting points: a linear least-squares solution that brings V near the null
        space of J, and ``below``, the coefficients (·, r) of an optimum with fewer potentials, if
        given. The one of lower cost is tried first, and the other one only if the first leads to no
        regular optimum. If the options ask for restarts, more descents follow, from random changes
        of the starting point that led to the optimum, and the best optimum is returned. Return None
        if neither starting point leads to a regular optimum.
        """
        begin = self._start(size)
        starts = (
            [begin.A]
            if below is None
            else [begin.A, np.pad(below, ((0, size - len(below)), (0, 0)))]
        )
        costs = [self.coarse.total(criterion.cost, A) for A in starts]
        for i in sorted(range(len(starts)), key=lambda i: costs[i][0]):
            if costs[i][1].uniform:
                found = self.descend(self.coarse, starts[i], _PENALTY, self.tolerance)
                if found is not None:
                    return min([found, *self._again(starts[i])], key=lambda one: one.cost)
        return None

    def descend(
        self, batches: BarrierCost, A: Array, penalty: float, tolerance: float
    ) -> Descent | None:
        """Descend from coefficients A (N', r) to a regular optimum of the cost.

        ``batches`` is the cost: a sum over nodes and barrier points. After each descent, Ω is
        searched for configurations at which the optimum is singular. They become barrier points,
        and the descent is repeated from A. Return None if A itself is singular at one of these
        points, if det(Nᵀ V) of an optimum has both signs at the nodes, or if six descents end in
        singular optima. ``penalty`` is the relative weight of the penalty that keeps V near the
        null space of J; it is raised for repeated descents. A descent ends when a step lowers the
        cost by less than the fraction ``tolerance``.
        """
        basis = self.chosen.basis[: len(A), : len(A)]
        begin = self._start(len(A))
        for _ in range(_ROUNDS):
            found = descend(
                batches, basis, begin, A, penalty=penalty, tolerance=tolerance, report=self.reported
            )
            penalty = min(10 * penalty, _MOST_PENALTY)
            lowest = self._lowest(found.A)
            if found.sides.uniform and lowest.value > 0:
                return found
            bad = lowest.ends[lowest.values <= 0]
            if not found.sides.uniform or (self.margin(A)(bad) <= 0).any():
                return None
            batches.guard(bad)
        return None

    def refusal(self, Q: Array, error: SingularRegionError | None) -> SingularRegionError:
        """Make the error that no regular candidate was found.

        The message names a configuration at which the initial design is singular. If none is found,
        the message names the configuration of the given ``error``. Without an ``error``, the
        message says that the nodes Q (K, n) are too few.
        """
        begin = self._start(len(self.chosen.kept))
        measure = self.margin(begin.A)
        bad = Q[measure(Q) <= 0]
        if not len(bad):
            lowest = self._lowest(begin.A)
            bad = lowest.ends[lowest.values <= 0]
        if not len(bad) and error is not None:
            bad = error.at[None]
        if not len(bad):
            return self._between_nodes(Q)
        problem = self.problem
        return refuse_singular(
            "Ω contains an algorithmic singularity",
            problem.desired.task,
            measure,
            problem.region,
            bad,
        )

    def _between_nodes(self, Q: Array) -> SingularRegionError:
        """Make the error that the nodes Q (K, n) are too few to determine the potentials.

        This is so if the initial design is regular, but every descent ends in a singularity between
        the nodes. In the message, the nodes are called samples, after the option ``samples``.
        """
        task = self.problem.desired.task
        kept = self.chosen.kept
        at = self.coarse.guards[-1][0] if self.coarse.guards else self.problem.region.center
        return SingularRegionError(
            f"{len(Q)} samples do not determine {len(kept)} potentials: each fit has an "
            f"algorithmic singularity between the samples, such as near {named(task, at)}",
            at,
            None,
            "give more samples, a lower degree or fewer potentials",
        )

    def reported(self, step: int, cost: float) -> None:
        """Call the progress callback with the text "step 3", for ``step`` = 3, and the fraction 1.

        A descent calls this method after each of its steps; ``cost`` is not used.
        """
        self.problem.report(f"step {step}", 1.0)

    def _again(self, A: Array) -> Iterator[Descent]:
        """Yield the regular optima that descents from random perturbations of A (N', r) reach.

        They can have a lower cost than the local minimum reached from A. There are
        ``options.restarts`` perturbations, by default none; those with a singularity at a node are
        skipped.
        """
        basis = self.chosen.basis[: len(A), : len(A)]
        for attempt in range(self.problem.options.restarts):
            noise = np.random.default_rng([self.problem.options.seed, attempt]).normal(size=A.shape)
            away = A + _RESTART * basis @ noise / np.sqrt(len(noise))
            found = None
            _, sides = self.coarse.total(criterion.cost, away)
            if sides.uniform:
                found = self.descend(self.coarse, away, _PENALTY, self.tolerance)
            if found is not None:
                yield found

    def _start(self, size: int) -> Start:
        """Find the initial design, by linear least squares, with the first ``size`` potentials."""
        if size not in self._starts:
            self._starts[size] = start(
                self.coarse.batches, self.chosen.basis[:size, :size], self.moments
            )
        return self._starts[size]

    def _lowest(self, A: Array) -> Lowest:
        region = self.problem.region
        return search(self.margin(A), region, region.random(1024, self.problem.options.seed + 7919))

    def _sizes(self) -> list[int]:
        """List the numbers of independent potentials of degree at most 1, 2, …, in rising order.

        The continuation makes one fit for each number. Numbers below r are left out, because r
        potentials are needed. If the basis is not polynomial, the only number is that of all
        independent potentials.
        """
        potentials = self.problem.potentials
        if not isinstance(potentials, Polynomial):
            return [len(self.chosen.kept)]
        degrees = potentials.exponents[self.chosen.kept].sum(axis=1)  # they rise
        ends = np.searchsorted(degrees, np.unique(degrees), side="right")
        return [int(size) for size in ends if size >= self.problem.desired.task.r]
