"""Branch and bound on the leaf margin over a set of boxes: halve a box until its bound suffices."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from time import thread_time

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array, read_only
from .leaf_margin_bounds import Bounds, LeafMargin
from .potentials import U

_BATCH = 4096
_MOST = 4_000_000
"""Boxes that are kept for later."""

TIGHT = 0.95
"""Without a margin to prove, boxes are halved until the bound is this share of the smallest margin
seen."""

_SMALLEST = 1e-7
"""Half-width, rad or m, at which a box counts as undecided."""


@dataclass(frozen=True, eq=False)
@read_only
class Outcome:
    """Result of branch and bound.

    Attributes
    ----------
    leaf_margin, sigma_min : float
        Lower bounds on the whole set.
    boxes : int
        Boxes evaluated.
    worst, half : (n,) arrays
        Centre and half-widths of the box that stopped it, or where the bound is least.
    reason : str
        Why it stopped before its goal; empty if it did not.
    """

    leaf_margin: float
    sigma_min: float
    boxes: int
    worst: Array
    half: Array
    reason: str

    def __repr__(self) -> str:
        reason = f", {self.reason}" if self.reason else ""
        return f"<Outcome: leaf margin > {self.leaf_margin:.3g} in {self.boxes} boxes{reason}>"


def bound_leaf_margin(
    problem: LeafMargin,
    low: Array,
    high: Array,
    goal: float | None,
    seconds: float,
    report: Callable[[str, float], None],
) -> Outcome:
    """Bound the leaf margin from below on the union of boxes with corners low and high, (K, n)
    each.

    Boxes are halved at a number that both halves share, so no gap is left between them.

    Parameters
    ----------
    problem
        The leaf margin.
    low, high : (K, n) arrays
    goal
        FailureReason as soon as this margin is proved, or at a configuration with a smaller one.
        None finds the largest bound.
    seconds
        Processor time after which the bound found so far is taken, s.
    report
        Progress callback; gets the proved fraction of the volume.
    """
    search = _Search(problem, low, high, goal)
    end, whole = thread_time() + seconds, search.volume()
    while search.open() and not search.reason:
        if thread_time() > end:
            search.reason = f"stopped after {seconds:g} s"
        elif len(search.low) > _MOST:
            search.reason = f"stopped at {_MOST} undecided boxes"
        else:
            search.advance()
            report("proving", 1 - min(1.0, search.volume() / whole))
    return search.outcome()


class _Search:
    """Boxes that remain to be halved, and the minimum bound of all others."""

    def __init__(self, problem: LeafMargin, low: Array, high: Array, goal: float | None) -> None:
        self.problem, self.goal = problem, goal
        self.low, self.high = low.copy(), high.copy()
        self.bound, self.sigma = np.zeros(len(low)), np.zeros(len(low))
        self.split = np.full(len(low), -1, np.int32)  # −1: not evaluated yet
        self.decided = self.settled_sigma = self.upper = np.inf
        self.worst = ((low[0] + high[0]) / 2, (high[0] - low[0]) / 2)
        self.at_least_bound = self.worst
        self.boxes, self.reason = 0, ""

    def open(self) -> int:
        """Return the number of boxes left."""
        return len(self.low)

    def volume(self) -> float:
        """Compute the volume of the boxes left."""
        return float(np.prod(self.high - self.low, axis=1).sum())

    def advance(self) -> None:
        """Halve and evaluate some boxes: the last ones if there is a goal, those of the smallest
        bound if not."""
        if len(self.low) <= _BATCH:
            take = np.arange(len(self.low))
        elif self.goal is not None:
            take = np.arange(len(self.low) - _BATCH, len(self.low))
        else:
            take = np.argpartition(self.bound, _BATCH)[:_BATCH]
        low, high = self._halved(take)
        Q, half = _centered(low, high)
        found = self.problem.bounds(Q, half)
        self.boxes += len(Q)
        enough = self._enough(found, Q, half)
        done = (found.leaf_margin >= enough) & (found.leaf_margin > 0)
        if done.any():
            self._settle(found, done, Q, half)
        stays = np.ones(len(self.low), bool)
        stays[take] = False
        if self.goal is None:
            stays &= self._still_short(enough, stays)
        left = ~done
        self.low = np.concatenate([self.low[stays], low[left]])
        self.high = np.concatenate([self.high[stays], high[left]])
        self.bound = np.concatenate([self.bound[stays], found.leaf_margin[left]])
        self.sigma = np.concatenate([self.sigma[stays], found.sigma_min[left]])
        self.split = np.concatenate([self.split[stays], found.split[left]])
        small = left & (half.max(axis=1) < _SMALLEST)
        if small.any() and not self.reason:
            self._stop(Q, half, int(np.argmax(small)), "a box too small to halve is undecided")

    def _halved(self, take: NDArray[np.intp]) -> tuple[Array, Array]:
        """Halve boxes; those that were not evaluated yet stay whole."""
        low, high, split = self.low[take], self.high[take], self.split[take]
        whole, rows = split < 0, np.flatnonzero(split >= 0)
        columns = split[rows]
        middle = (low[rows, columns] + high[rows, columns]) / 2
        first, second = high[rows].copy(), low[rows].copy()
        first[np.arange(len(rows)), columns] = middle
        second[np.arange(len(rows)), columns] = middle
        lows = np.concatenate([low[whole], low[rows], second])
        return lows, np.concatenate([high[whole], first, high[rows]])

    def _enough(self, found: Bounds, Q: Array, half: Array) -> float:
        """The bound at which a box is done; a centre below the goal ends the search."""
        least = int(np.argmin(found.center))
        if found.center[least] < self.upper:
            self.upper = float(found.center[least])
            self.worst = Q[least], half[least]
        if self.goal is None:
            if self.upper <= 0:
                self._stop(Q, half, least, "J_V is singular there")
            return TIGHT * self.upper
        if self.upper < self.goal:
            self._stop(Q, half, least, f"the leaf margin there is {self.upper:.4g}")
        return self.goal

    def _still_short(self, enough: float, stays: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Settle waiting boxes whose bound now suffices; return a mask of all others."""
        ready = stays & (self.split >= 0) & (self.bound >= enough)
        if ready.any():
            self.decided = min(self.decided, float(self.bound[ready].min()))
            self.settled_sigma = min(self.settled_sigma, float(self.sigma[ready].min()))
        return np.asarray(~ready)

    def _settle(self, found: Bounds, done: NDArray[np.bool_], Q: Array, half: Array) -> None:
        (rows,) = np.nonzero(done)
        least = rows[np.argmin(found.leaf_margin[rows])]
        if found.leaf_margin[least] < self.decided:
            self.decided = float(found.leaf_margin[least])
            self.at_least_bound = Q[least], half[least]
        self.settled_sigma = min(self.settled_sigma, float(found.sigma_min[rows].min()))

    def _stop(self, Q: Array, half: Array, at: int, why: str) -> None:
        self.reason, self.worst = why, (Q[at], half[at])

    def outcome(self) -> Outcome:
        """Put together what was found."""
        bound, sigma = self.decided, self.settled_sigma
        worst = self.at_least_bound
        if len(self.low):
            least = int(np.argmin(self.bound))
            Q, half = _centered(self.low[least, None], self.high[least, None])
            worst = self.worst if self.reason and "stopped" not in self.reason else (Q[0], half[0])
            bound, sigma = min(bound, float(self.bound[least])), min(sigma, float(self.sigma.min()))
        return Outcome(bound, sigma, self.boxes, *worst, self.reason)


def _centered(low: Array, high: Array) -> tuple[Array, Array]:
    """Give centres and half-widths that reach to both corners whatever the rounding."""
    Q = (low + high) / 2
    size = np.maximum(np.abs(low), np.abs(high))
    return Q, (high - low) / 2 * (1 + 1e-12) + 4 * U * size
