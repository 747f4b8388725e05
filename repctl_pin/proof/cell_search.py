"""Branch and bound over a cell: halve a box of poses until the function's margins are enclosed well
enough."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter

import numpy as np

from ..arguments import Array, read_only
from ..inverse_function.chart import Chart
from .cells import CellProof

_BATCH = 1024
_SMALLEST = 1e-4
"""Half-width, as a share of the cell's, at which a box counts as undecided."""


@dataclass(frozen=True, eq=False)
@read_only
class CellOutcome:
    """Result of branch and bound over a cell.

    Attributes
    ----------
    leaf_margin, limit_margin, sigma_min : float
        Lower bounds on the whole cell.
    boxes : int
        Boxes evaluated.
    worst, half : (k,) arrays
        Centre and half-widths, in the cell's coordinates, of the box that stopped it, or where the
        leaf margin's bound is least.
    reason : str
        Why it stopped before its goal; empty if it did not.
    near : (n,) array
        F is the only solution within this of q_ref.
    """

    leaf_margin: float
    limit_margin: float
    sigma_min: float
    boxes: int
    worst: Array
    half: Array
    reason: str
    near: Array

    def __repr__(self) -> str:
        margin = f"leaf margin > {self.leaf_margin:.3g}"
        return f"<CellOutcome: {margin} in {self.boxes} boxes {self.reason}>"


def bound_cell(
    chart: Chart, leaf: float, limit: float, seconds: float, report: Callable[[str, float], None]
) -> CellOutcome:
    """Prove that F exists on a whole cell, and that its margins are above two goals.

    Parameters
    ----------
    chart
        Chart of the function.
    leaf, limit
        The leaf margin and the limit margin to prove; −inf for none.
    seconds
        Time after which it is given up.
    report
        Progress callback; gets the proved fraction of the cell.
    """
    problem, end = CellProof(chart), perf_counter() + seconds
    k = chart.cell.k
    low, high = -np.ones((1, k)), np.ones((1, k))
    least, limit_bound, sigma, boxes = np.inf, np.inf, np.inf, 0
    at, reason = (np.zeros(k), np.ones(k)), ""
    while len(low) and not reason:
        take = slice(max(0, len(low) - _BATCH), None)
        Uc, half = (low[take] + high[take]) / 2, (high[take] - low[take]) / 2
        found = problem.bounds(Uc, half * (1 + 1e-12))
        boxes += len(Uc)
        done = (found.leaf.leaf_margin > max(leaf, 0.0)) & (found.limit_margin > limit)
        if done.any():
            where = int(np.argmin(np.where(done, found.leaf.leaf_margin, np.inf)))
            if found.leaf.leaf_margin[where] < least:
                least, at = float(found.leaf.leaf_margin[where]), (Uc[where], half[where])
            limit_bound = min(limit_bound, float(found.limit_margin[done].min()))
            sigma = min(sigma, float(found.leaf.sigma_min[done].min()))
        low, high = low[: take.start], high[: take.start]
        Uc, half, split = Uc[~done], half[~done], found.leaf.split[~done]
        margin = np.where(found.found, found.leaf.center, -np.inf)[~done]
        reason, at = _hopeless(margin, found.center_limit[~done], Uc, half, leaf, limit, at)
        rows = np.arange(len(Uc))
        lower, upper = Uc - half, Uc + half
        first, second = upper.copy(), lower.copy()
        first[rows, split] = second[rows, split] = Uc[rows, split]
        low, high = np.concatenate([low, lower, second]), np.concatenate([high, first, upper])
        report("proving", 1 - float(np.prod((high - low) / 2, axis=1).sum()))
        if not reason and len(low) and perf_counter() > end:
            reason, at = (
                f"stopped after {seconds:g} s",
                ((low[-1] + high[-1]) / 2, (high[-1] - low[-1]) / 2),
            )
    if reason:
        least, limit_bound, sigma = 0.0, -np.inf, 0.0
    return CellOutcome(least, limit_bound, sigma, boxes, *at, reason, problem.near)


def _hopeless(
    margin: Array,
    limit_bound: Array,
    Uc: Array,
    half: Array,
    leaf: float,
    limit: float,
    at: tuple[Array, Array],
) -> tuple[str, tuple[Array, Array]]:
    """Say why no halving can help, and where: a margin at a centre, or a box that is too small."""
    for values, goal, name in ((margin, leaf, "leaf"), (limit_bound, limit, "limit")):
        bad = values < goal
        if bad.any():
            which = int(np.argmin(values))
            if values[which] == -np.inf:
                return "no configuration exists on this leaf at that pose", (Uc[which], half[which])
            return f"the {name} margin there is {values[which]:.4g}", (Uc[which], half[which])
    small = half.max(axis=1) < _SMALLEST if len(half) else np.zeros(0, bool)
    if small.any():
        return "a box too small to halve is undecided", (
            Uc[int(np.argmax(small))],
            half[int(np.argmax(small))],
        )
    return "", at
