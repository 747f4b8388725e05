"""Outline of what an arm reaches: closed lines around the nodes of a table that floods reach.

A table is a grid of radius and height around the arm; a node is a pair of indices (radius, height).
A line runs halfway between a node that is reached and a neighbour that is not, so corners are cut.
I and J are the numbers of radii and heights, P that of points of a line.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ....base.arguments import Array
from .flood import SPACING, Table

_SIDES = (((0, -1), (0, 0)), ((1, 0), (1, 0)), ((0, 1), (1, 1)), ((-1, 0), (0, 1)))
"""Neighbours of a node, anticlockwise, each with the corner of the node at which its side begins.
"""


def outlines(table: Table, reached: NDArray[np.bool_]) -> list[Array]:
    """Trace closed lines around the nodes ``reached`` (I, J): a list of points (P, 2) each.

    The points are radius and height, m. Lines around nodes are anticlockwise, those around holes
    clockwise. A line runs from the middle of one side of a node to that of the next.
    """
    open_ = _sides(reached)
    lines = []
    while open_:
        corner = next(iter(open_))
        line = []
        while corner in open_:
            after = open_[corner].pop()
            if not open_[corner]:
                del open_[corner]
            line.append((np.array(corner) + after) / 2 - 0.5)
            corner = after
        lines.append(_scaled(table, _straightened(np.array(line))))
    return lines


def _sides(reached: NDArray[np.bool_]) -> dict[tuple[int, int], list[tuple[int, int]]]:
    """List the sides between nodes that are reached and those that are not, by their first corner.

    The corner (i, j) is the one of the node (i, j) with the smaller radius and height. The value is
    the corners at which the sides end.
    """
    inside = np.pad(reached, 1)
    found: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for i, j in np.argwhere(reached).tolist():
        for k, ((di, dj), (x, y)) in enumerate(_SIDES):
            if not inside[i + 1 + di, j + 1 + dj]:
                after = _SIDES[(k + 1) % len(_SIDES)][1]
                found.setdefault((i + x, j + y), []).append((i + after[0], j + after[1]))
    return found


def _straightened(line: Array) -> Array:
    """Leave out points of a closed line (P, 2) that are on the line through their neighbours."""
    before, after = line - np.roll(line, 1, axis=0), np.roll(line, -1, axis=0) - line
    turns = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    return np.asarray(line[np.abs(turns) > 1e-9])


def _scaled(table: Table, line: Array) -> Array:
    """Return the radii and heights (P, 2), m, of points given in indices of nodes."""
    return np.array([table.radii[0], table.heights[0]]) + SPACING * line
