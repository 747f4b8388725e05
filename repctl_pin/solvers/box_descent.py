"""Minimisation of a function over a box, by descents from S starting points at once.

A point has n coordinates. Each descent has its own step length, which adapts to its success.

``StepLengths`` are the parameters of the adaptive step lengths.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import inf

import numpy as np
from numpy.typing import NDArray

from ..base.arguments import Array

_Rows = NDArray[np.intp]


@dataclass(frozen=True)
class StepLengths:
    """Parameters of the adaptive step lengths in :func:`descend_in_box`.

    The function ``trial`` of the problem defines the unit of the lengths.

    Attributes
    ----------
    first : float
        Initial step length.
    longest : float
        Maximum step length.
    shortest : float
        Step length at or below which the search from a starting point ends.
    longer : float
        Factor of the step length after an accepted step, which lowered the function.
    shorter : float
        Divisor of the step length after a step that was rejected.
    steps : int
        Maximum number of steps from each starting point.
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
    trial: Callable[[_Rows, Array], Array],
    evaluate: Callable[[_Rows, Array], tuple[Array, NDArray[np.bool_]]],
    lengths: StepLengths,
    *,
    enough: float = -inf,
    accepted: Callable[[_Rows, NDArray[np.bool_]], None] | None = None,
) -> None:
    """Minimise a function over a box from several starting points at once.

    The arrays ``x`` and ``value`` are overwritten by the final points and the function's values
    there. L is the number of points that are still searched.

    Parameters
    ----------
    x : (S, n) array
        Starting points in the box.
    value : (S,) array
        Values of the function at x.
    trial : function (rows (L,), lengths (L,)) → (L, n)
        Trial points in the box: from each of L rows of x, given by their indices, one step of the
        given length down the slope of the function.
    evaluate : function (rows (L,), points (L, n)) → values (L,), allowed (L,)
        Values of the function at trial points, and True where a point may be accepted.
    lengths
        Parameters of the step lengths.
    enough
        The search from all points ends when one value is at or below ``enough``.
    accepted : function (rows (L,), better (L,)), optional
        Called after each step with the indices of the rows that were tried, and a mask: True where
        the trial point was accepted.
    """
    length = np.full(len(x), lengths.first)
    for _ in range(lengths.steps):
        rows = np.flatnonzero(length > lengths.shortest)
        if not len(rows) or value.min() <= enough:
            return
        points = trial(rows, length[rows])
        found, allowed = evaluate(rows, points)
        better = (found < value[rows]) & allowed
        still = (points == x[rows]).all(axis=1)  # at an edge of the box; so is a shorter step
        moved = rows[better]
        x[moved], value[moved] = points[better], found[better]
        longer = np.minimum(lengths.longer * length[rows], lengths.longest)
        length[rows] = np.where(better, longer, length[rows] / lengths.shorter)
        length[rows[still]] = 0.0
        if accepted is not None:
            accepted(rows, better)
