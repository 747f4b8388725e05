"""Branch and bound over a cell, to prove that its function F exists and keeps its margins.

The cell is a box of poses with k coordinates u from −1 to 1. F gives one configuration for each
pose. Boxes of poses are halved until their bounds suffice. c is a continuous function of u near F,
and d* a distance from c within which F is the only solution. Several d* are tried, in the order of
:attr:`.CellProof.distances`, the largest first. The values of F are a leaf of r potentials; the
leaf margin, from 0 to 1, is the distance from an algorithmic singularity, at which the controller
that stays on this leaf fails. The limit margin is the distance from the joint limits, rad or m.

``CellBounds`` are proved bounds on the margins of a function F on K boxes of poses.
"""

from __future__ import annotations

from collections.abc import Callable
from time import thread_time

import numpy as np
from numpy.typing import NDArray

from ...base.arguments import Array
from ...base.certificate import Proof
from ..cells.evaluate.margins import leaf_margins
from .boxes import halved
from .cell_bounds import CellBounds, CellProof

_BATCH = 1024
_TRIALS = 48
"""Number of boxes that are evaluated to choose the size of the initial boxes."""
_MOST = 400_000
"""Maximum number of initial boxes."""
_SMALLEST = 1e-4
"""Half-width, relative to that of the cell, below which an undecided box stops the search."""


def bound_cell(
    problem: CellProof,
    name: str,
    leaf: float,
    limit: float,
    seconds: float,
    report: Callable[[str, float], None],
) -> Proof:
    """Prove that F exists on a whole cell, and that both margins exceed their goals.

    Parameters
    ----------
    problem
        Bounds for F on boxes of poses.
    name
        Name of the robot, task and cell, with which the description of the proof begins.
    leaf, limit
        Leaf margin and limit margin to prove. The leaf margin to prove is at least 0; −inf as
        ``limit`` stands for no limit margin.
    seconds
        Processor time, s, after which the search stops.
    report
        Progress callback (step, fraction); the fraction is the proved share of the cell, 0 to 1.

    Returns
    -------
    Proof
        The proof, without the fingerprint that identifies its design. If the search stopped before
        its goal, the bounds are 0 and −inf.
    """
    end = thread_time() + seconds
    search = _CellSearch(problem, max(leaf, 0.0), limit)
    while len(search.low) and not search.reason:
        if thread_time() > end:
            search.stop(-1, search.low, search.high, f"stopped after {seconds:g} s")
        else:
            search.advance()
            report("proving", 1 - search.volume())
    return search.proof(name)


class _CellSearch:
    """State of branch and bound: undecided boxes, and the minimum margins over all proved boxes.

    ``low`` and ``high`` (K, k) are the corners of the undecided boxes of poses, in the cell's
    coordinates u. ``margins`` (3,) are the smallest proved leaf margin, σ_min(J) and limit margin.
    ``at`` is the box with the smallest leaf margin, or the box at which the search stopped: its
    centre and half-widths. ``level`` is the index in :attr:`.CellProof.distances` of the smallest
    d* that a box needed. ``leaf`` and ``limit`` are the goals of the proof: a leaf margin and a
    limit margin. ``reason`` says why the search stopped; it is empty while the search runs.
    """

    def __init__(self, problem: CellProof, leaf: float, limit: float) -> None:
        self.problem, self.leaf, self.limit = problem, leaf, limit
        k = problem.cell.k
        self.margins = np.array([np.inf, np.inf, np.inf])  # leaf, σ_min, limit
        self.at, self.reason, self.boxes = (np.zeros(k), np.ones(k)), "", 0
        self.level = 0
        self.low, self.high = grid(self._counts())

    def _counts(self) -> Array:
        """Choose the number of initial boxes along each of the k coordinates of the cell: (k,).

        The counts are chosen such that the joints move about equally far along each edge of a box.
        The counts grow until half of a random sample of boxes is proved without halving. If this
        requires more than 400,000 boxes, all counts are 1.
        """
        k, chart = self.problem.cell.k, self.problem.chart
        S = np.random.default_rng(0).uniform(-1, 1, (_TRIALS, k))
        points = chart.solve(S)
        moved, _ = chart.derivative(points)
        if not points.found.any():
            return np.ones(k)
        cost = np.abs(moved[points.found][:, :, :k]).sum(axis=1).mean(axis=0) + 1e-9
        cost /= cost.max()
        before, counts = np.zeros(k), np.ones(k)
        while np.prod(counts) < _MOST:
            if (counts != before).any():
                Uc = (np.floor((S + 1) / 2 * counts) + 0.5) * 2 / counts - 1
                found = self.problem.bounds(Uc, np.tile(1 / counts, (_TRIALS, 1)))
                self.boxes += _TRIALS
                if self._proved(found).mean() >= 0.5:
                    return counts
            before, cost = counts, cost * 1.12
            counts = np.maximum(np.ceil(cost), 1.0)
        return np.ones(k)

    def _proved(self, found: CellBounds) -> NDArray[np.bool_]:
        """Test on which of the K boxes leaf margin and limit margin exceed their goals: (K,)."""
        return np.asarray((found.leaf_margin > self.leaf) & (found.limit_margin > self.limit))

    def volume(self) -> float:
        """Compute the share of the cell that is undecided, from 0 to 1."""
        return float(np.prod((self.high - self.low) / 2, axis=1).sum())

    def advance(self) -> None:
        """Evaluate the newest undecided boxes of poses, and halve those that are not proved."""
        take = slice(max(0, len(self.low) - _BATCH), None)
        low, high = self.low[take], self.high[take]
        Uc, half = (low + high) / 2, (high - low) / 2
        found = self.problem.bounds(Uc, half * (1 + 1e-12) + 4e-16)
        self.boxes += len(Uc)
        done = self._proved(found)
        if done.any():
            where = int(np.argmin(np.where(done, found.leaf_margin, np.inf)))
            if found.leaf_margin[where] < self.margins[0]:
                self.at = Uc[where], half[where]
            self.level = max(self.level, int(found.level[done].max()))
            each = np.stack([found.leaf_margin, found.sigma_min, found.limit_margin])
            self.margins = np.minimum(self.margins, each[:, done].min(axis=1))
        low, high, split = low[~done], high[~done], found.split[~done]
        if len(low):
            self._stop_if_hopeless(low, high)
        low, high, _ = halved(low, high, split)
        self.low = np.concatenate([self.low[: take.start], low])
        self.high = np.concatenate([self.high[: take.start], high])

    def _stop_if_hopeless(self, low: Array, high: Array) -> None:
        """Stop the search if a box of poses cannot be proved by halving it.

        ``low`` and ``high`` (K, k) are the corners of K boxes. A box cannot be proved if, at its
        centre, F does not exist, misses a margin, or differs from c by more than the largest d*. A
        box that is too small to halve also stops the search.
        """
        problem, chart = self.problem, self.problem.chart
        points = chart.solve((low + high) / 2)
        limits = np.minimum(points.Q - problem.lower, problem.upper - points.Q)
        away = problem.away(points) - problem.near
        for short, name in (
            (
                np.where(points.found, 1.0, -1.0),
                "no configuration exists on this leaf at that pose",
            ),
            (leaf_margins(chart, points) - self.leaf, "the leaf margin there is {leaf:.4g}"),
            (limits.min(axis=1) - self.limit, "the limit margin there is {limit:.4g}"),
            (
                -away.max(axis=1),
                "F leaves the neighbourhood in which it is proved unique, by {away:.2g} (rad or m)",
            ),
            ((high - low).max(axis=1) - 2 * _SMALLEST, "a box too small to halve is undecided"),
        ):
            where = int(np.argmin(short))
            if short[where] < 0:
                least = float(short[where])
                values = {"leaf": least + self.leaf, "limit": least + self.limit, "away": -least}
                self.stop(where, low, high, name.format(**values))
                return

    def stop(self, which: int, low: Array, high: Array, reason: str) -> None:
        """Stop the search at the box with the index ``which``; record the box and the reason.

        ``low`` and ``high`` (K, k) are the corners of K boxes, in the cell's coordinates.
        """
        self.reason = reason
        self.at = (low[which] + high[which]) / 2, (high[which] - low[which]) / 2

    def proof(self, name: str) -> Proof:
        """Return the proof, with the margins proved on the whole cell.

        If the search stopped, the proof has instead the reason and the box at which it stopped, and
        the bounds 0 and −inf. ``name`` names the robot, the task and the cell.
        """
        leaf, sigma, limit = (0.0, 0.0, -np.inf) if self.reason else self.margins.tolist()
        only = f"is the only solution {self.problem.within(self.level)}"
        what = f"{name}: F exists, is smooth, and {only}"
        return Proof(what, not self.reason, leaf, limit, sigma, self.boxes, *self.at, self.reason)


def grid(counts: Array) -> tuple[Array, Array]:
    """Divide [−1, 1]^k into equal boxes; ``counts`` (k,) has their number per coordinate.

    Return the lower and upper corners of the K boxes, (K, k) each.
    """
    edges = [np.linspace(-1, 1, int(count) + 1) for count in counts]
    low = np.meshgrid(*[e[:-1] for e in edges], indexing="ij")
    high = np.meshgrid(*[e[1:] for e in edges], indexing="ij")
    return (np.stack([x.ravel() for x in low], axis=1), np.stack([x.ravel() for x in high], axis=1))
