"""Tables of a chart for the native library: the struct Chart of chart.h."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...arguments import Array
from ...native import CHART, filled_struct
from .cell import EDGE, TURNED
from .chart import Chart
from .sector import Sector

_FOURS = 4
"""Number of monomials that chart.c adds at a time."""


def chart_tables(chart: Chart, keep_limits: bool) -> tuple[Any, list[Any]]:
    """Create the struct of a chart, and the arrays that it points to."""
    cell, monomials = chart.cell, chart.monomials
    count, both, weights = _weights(chart)
    row, column = elimination_order(chart)
    bounds = np.where(cell.widths == 0, TURNED, cell.widths * (1 + EDGE))
    lower, upper = cell.whole._course_bounds()
    removed = cell.removed if isinstance(cell, Sector) else ()
    more = (0, count - monomials.size)
    ints: dict[str, ArrayLike] = {
        "moved": cell.moved,
        "coordinate": [one.coordinate for one in removed],
        "joint": [one.joint for one in removed],
        "parent": np.pad(monomials.parent, more),
        "factor": np.pad(monomials.variable, more),
        "row": np.argsort(row),
        "column": np.argsort(column),
    }
    reals: dict[str, ArrayLike] = {
        "p": cell.placement.translation,
        "R": cell.placement.rotation,
        "sign": [one.sign for one in removed],
        "center": cell._offset,
        "scale": 1 / cell.widths[cell.moved],
        "lower": lower,
        "upper": upper,
        "weights": weights,
    }
    scalars = {
        "k": cell.k,
        "removed": len(removed),
        "keep_limits": int(keep_limits),
        "terms": count,
        "both": both,
    }
    if isinstance(cell, Sector):
        bounds[list(cell.free)] = np.inf
        basis, (radius, height) = cell.directions, cell.middle
        reals |= {
            "origin": cell.axis[0],
            "basis": basis,
            "turn": basis @ cell.placement.rotation,
        }
        scalars |= {"sector": 1, "radius": radius, "height": height}
        scalars["spin"] = cell.spin_middle
    return filled_struct(CHART, ints, reals | {"bounds": bounds}, scalars)


def _weights(chart: Chart) -> tuple[int, int, Array]:
    """Arrange the coefficients of q_ref and n_ref for chart.c.

    Returns the number of monomials, a multiple of 4; the number of those in which n_ref has
    coefficients; and the coefficients. Each row belongs to a monomial: first those of q_ref, then,
    in the first rows, those of n_refᵀ. Rows have an even length, padded with zeros.
    """
    C = np.moveaxis(chart.coefficients, 2, 1)  # (N, 1 + r, n)
    C = np.pad(C, ((0, -len(C) % _FOURS), (0, 0), (0, 0)))
    n = C.shape[2]
    used = np.flatnonzero(C[:, 1:].any(axis=(1, 2)))
    both = -(-(used.max(initial=0) + 1) // _FOURS) * _FOURS
    q_ref = np.pad(C[:, 0], ((0, 0), (0, n % 2)))
    n_ref = C[:both, 1:].reshape(both, -1)
    n_ref = np.pad(n_ref, ((0, 0), (0, n_ref.shape[1] % 2)))
    first = np.concatenate([q_ref[:both], n_ref], axis=1)
    return len(C), both, np.concatenate([first.ravel(), q_ref[both:].ravel()])


def elimination_order(chart: Chart) -> tuple[list[int], list[int]]:
    """Order rows and columns of J_V by complete pivoting in the middle of the cell.

    Returns the indices of the rows, and of the columns, in their new order, in which the C code
    eliminates without exchanges.
    """
    q, V = chart.coefficients[0, :, 0], chart.coefficients[0, :, 1:]
    A = np.concatenate([chart.cell.task.jacobian(q), V.T])
    n = len(A)
    rows, columns = list(range(n)), list(range(n))
    for k in range(n):
        i, j = np.unravel_index(int(np.argmax(np.abs(A[k:, k:]))), (n - k, n - k))
        for order, B, at in ((rows, A, k + int(i)), (columns, A.T, k + int(j))):
            order[k], order[at] = order[at], order[k]
            B[[k, at]] = B[[at, k]]
        if A[k, k] == 0.0:
            break
        A[k + 1 :] -= np.outer(A[k + 1 :, k] / A[k, k], A[k])
    return rows, columns
