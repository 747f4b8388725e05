"""The joints along a curve of poses, ``q(s) = F(x(s))``, as a piecewise polynomial."""

from __future__ import annotations

from collections.abc import Sequence
from math import factorial
from typing import TYPE_CHECKING

import numpy as np

from ...arguments import Array
from .lines import Curve, Function, tool_of

if TYPE_CHECKING:
    from scipy.interpolate import PPoly

_NODES = (1 - np.cos(np.pi * np.arange(6) / 5)) / 2
"""Points of an interval, from 0 to 1, at which a polynomial of degree 5 is equal to F."""

_TO_POWERS = np.linalg.inv(np.vander(_NODES, increasing=True))
"""Matrix from the values at the nodes to the coefficients of the powers."""

_INTERVALS = (16, 32, 64, 128, 256)
"""Numbers of intervals that are tried in turn."""

_EXACT = 2e-13
"""Maximum difference between a polynomial and F, rad or m."""

_INSIDE = np.linspace(0.0, 1.0, 2001)
"""Points at which poses are tested to lie in the cell."""


def joints_along(F: Function, at: Curve) -> PPoly | None:
    """Fit ``q(a) = F(x(a))``, a from 0 to 1, to 2e-13.

    Returns None if the curve of poses leaves the cell, or F does not exist or is not smooth along
    it.
    """
    from scipy.interpolate import PPoly  # slow to import

    X = at(_INSIDE) @ np.linalg.inv(tool_of(F))
    if not F.cell._contains(*F.cell.coordinates(X[:, :3, 3], X[:, :3, :3])).all():
        return None
    for count in _INTERVALS:
        a = (np.arange(count)[:, None] + _NODES[:-1]).ravel() / count
        a = np.append(a, 1.0)
        Q = F.batch(at(a), missing="nan")
        if np.isnan(Q).any():
            return None
        rows = 5 * np.arange(count)[:, None] + np.arange(6)
        begin = Q[rows[:, 0]]
        C = np.einsum("ij,Kjn->iKn", _TO_POWERS, Q[rows] - begin[:, None])
        C[0] = begin
        C *= float(count) ** np.arange(6)[:, None, None]
        curve = PPoly(C[::-1], np.arange(count + 1) / count)
        between = (a[1:] + a[:-1]) / 2
        off = np.abs(curve(between) - F.batch(at(between), missing="nan")).max()
        if off < _EXACT:
            return curve
    return None


def cut(curve: PPoly, begin: float, end: float) -> PPoly:
    """Return the part of a curve between two points."""
    from scipy.interpolate import PPoly

    x = curve.x[(curve.x > begin) & (curve.x < end)]
    x = np.concatenate([[begin], x, [end]])
    C = [curve(x[:-1], k) / factorial(k) for k in range(len(curve.c))]
    return PPoly(np.array(C[::-1]), x)


def joined(curves: Sequence[PPoly], lengths: Sequence[float]) -> tuple[PPoly, Array]:
    """Join curves q(a) to one, q(s), on which each has a length, m; return also s at their ends.

    s is scaled such that it grows as the joints move, on average.
    """
    from scipy.interpolate import PPoly

    steps = np.concatenate([np.diff(curve.c[-1], axis=0) for curve in curves])
    scale = float(np.linalg.norm(steps, axis=1).sum()) / sum(lengths)
    s = np.concatenate([[0.0], np.cumsum(lengths)]) * scale
    C, x = [], []
    for curve, begin, end in zip(curves, s, s[1:], strict=False):
        stretch = (end - begin) / (curve.x[-1] - curve.x[0])
        C.append(curve.c / stretch ** np.arange(len(curve.c))[::-1, None, None])
        x.append(begin + stretch * (curve.x[:-1] - curve.x[0]))
    return PPoly(np.concatenate(C, axis=1), np.append(np.concatenate(x), s[-1])), s
