"""Outline of what an arm reaches: closed lines around the nodes of a table that floods reach.

A table is a grid of radius and height around the arm; a node is a pair of indices (radius, height).
A line runs halfway between a node that is reached and a neighbour that is not, so corners are cut.
I and J are the numbers of radii and heights, P that of points of a line.
"""

from __future__ import annotations

import numpy as np
from contourpy import contour_generator
from numpy.typing import NDArray

from ....base.arguments import Array
from .flood import SPACING, Table


def outlines(table: Table, reached: NDArray[np.bool_]) -> list[Array]:
    """Trace closed lines around the nodes ``reached`` (I, J): a list of points (P, 2) each.

    The points are radius and height, m. Lines around nodes are anticlockwise, those around holes
    clockwise. The last point of a line is not a repetition of the first.
    """
    around = np.pad(reached, 1).astype(float)  # so that lines close at the edge of the table
    first = np.array([table.radii[0], table.heights[0]]) - SPACING
    lines = contour_generator(z=around.T).lines(0.5)
    return [first + SPACING * _straightened(np.asarray(line)[:-1]) for line in lines]


def _straightened(line: Array) -> Array:
    """Leave out points of a closed line (P, 2) that are on the line through their neighbours."""
    before, after = line - np.roll(line, 1, axis=0), np.roll(line, -1, axis=0) - line
    turns = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    return np.asarray(line[np.abs(turns) > 1e-9])
