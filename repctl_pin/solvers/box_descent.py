"""Descent in a box from many starts at once, each with a step length of its own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import inf

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array

Rows = NDArray[np.intp]


@dataclass(frozen=True)
class StepLengths:
    """Rules of the step lengths.

    Attributes
    ----------
    first, longest, shortest : float
        Bounds; a start whose length is below ``shortest`` has ended.
    longer, shorter : float
        Factor after a step that helped, divisor after one that did not.
    steps : int
        Maximum number of steps.
    """

    first: float
    longest: float
    shortest: float
    longer: float
    shorter: float
    steps: int


def descend_in_box(
    x: Array,
    value: Array,
    trial: Callable[[Rows, Array], Array],
    evaluate: Callable[[Rows, Array], tuple[Array, NDArray[np.bool_]]],
    lengths: StepLengths,
    *,
    enough: float = -inf,
    accepted: Callable[[Rows, NDArray[np.bool_]], None] | None = None,
) -> None:
    """Minimise a function over a box from several starts at once; x and value are overwritten.

    Parameters
    ----------
    x : (S, n) array
        The starts, in the box.
    value : (S,) array
        The function there.
    trial : function (rows (L,), lengths (L,)) → (L, n)
        Points of the box, such steps down the slope from some of the rows of x.
    evaluate : function (rows (L,), points (L, n)) → values (L,), allowed (L,)
        The function at trial points, and whether a step may end there.
    lengths
        How the step lengths change.
    enough
        The search ends where a value is at most this.
    accepted : function (rows (L,), better (L,)), optional
        Called after each step, with the rows that were tried and which of them moved.
    """
    length = np.full(len(x), lengths.first)
    for _ in range(lengths.steps):
        rows = np.flatnonzero(length > lengths.shortest)
        if not len(rows) or value.min() <= enough:
            return
        points = trial(rows, length[rows])
        found, allowed = evaluate(rows, points)
        better = (found < value[rows]) & allowed
        moved = rows[better]
        x[moved], value[moved] = points[better], found[better]
        longer = np.minimum(lengths.longer * length[rows], lengths.longest)
        length[rows] = np.where(better, longer, length[rows] / lengths.shorter)
        if accepted is not None:
            accepted(rows, better)
