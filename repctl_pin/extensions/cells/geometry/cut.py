"""Cuts of a cell: sides are moved inward until the poses at which a function fails lie outside."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ....base.arguments import Array


def cut_sides(
    U: Array, bad: NDArray[np.bool_], inside: float = 0.01, weights: Array | None = None
) -> tuple[Array, Array]:
    """Find a large box of coordinates without bad poses; return its low and its high corner, (k,).

    U (K, k) are K poses in k coordinates from −1 to 1, and ``bad`` (K,) is True for bad poses, at
    which a function fails. The box begins as [−1, 1]^k. Then one side at a time is moved inward, to
    ``inside`` beyond a bad pose, until no bad pose is left. Each time, the move with the smallest
    loss of volume per excluded bad pose is chosen. ``weights`` (k,), by default 1, multiply the
    losses along the coordinates: a side with a larger weight is moved less often. If no box is
    left, both corners are equal.
    """
    k = U.shape[1]
    weights = np.ones(k) if weights is None else weights
    low, high = np.full(k, -1.0), np.full(k, 1.0)
    wrong = U[bad]
    while len(wrong):
        best: tuple[float, int, float, float] = np.inf, 0, 1.0, 0.0
        for axis in range(k):
            width = high[axis] - low[axis]
            for way in (1.0, -1.0):
                end = high[axis] if way > 0 else -low[axis]
                at = np.sort(way * wrong[:, axis])[::-1]  # the outermost first
                lost = (end - at + inside) / max(width, 1e-12)
                # cost of the logarithm of the volume, per pose that is left out
                cost = -np.log(np.maximum(1e-12, 1 - lost)) / np.arange(1, len(at) + 1)
                cost = weights[axis] * cost
                one = int(np.argmin(cost))
                if cost[one] < best[0]:
                    best = float(cost[one]), axis, way, float(at[one])
        _, axis, way, at_ = best
        if way > 0:
            high[axis] = at_ - inside
        else:
            low[axis] = -at_ + inside
        if high[axis] <= low[axis]:
            return low, low
        wrong = wrong[((wrong >= low) & (wrong <= high)).all(axis=1)]
    return low, high
