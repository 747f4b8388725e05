"""Figures of a function over slices through the middle of its cell."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ..arguments import Array
from .judgement import speeds
from .result import CellDesign


@dataclass(frozen=True)
class Slice:
    """Two coordinates of a cell varied, the others in the middle.

    Attributes
    ----------
    axes : (int, int)
        Which coordinates, counted from 0.
    u : (C,) array
        The values of each.
    limit_margin, extra_speed : (C, C) arrays
        Rows: the second coordinate. NaN where there are no joints.
    """

    axes: tuple[int, int]
    u: Array
    limit_margin: Array
    extra_speed: Array


def slices(design: CellDesign, count: int = 33) -> list[Slice]:
    """Evaluate the slices of every two positions of the cell; or of its first two coordinates."""
    cell, chart = design.cell, design.function.chart
    places = [i for i, unit in enumerate(cell.units) if unit == "m"]
    pairs = list(combinations(places if len(places) > 1 else range(cell.k), 2))[:3]
    u = np.linspace(-1, 1, count)
    made = []
    for first, second in pairs:
        U = np.zeros((count * count, cell.k))
        U[:, second], U[:, first] = (grid.ravel() for grid in np.meshgrid(u, u, indexing="ij"))
        points = chart.solve(U, np.zeros((len(U), cell.task.r)))
        found = speeds(design.desired, chart, points)
        margin = np.where(points.found, cell.task.limit_margin(points.Q).min(axis=1), np.nan)
        extra = np.sqrt(found.own / found.wanted) - 1
        made.append(Slice((first, second), u, margin.reshape(count, count), extra.reshape(count, count)))
    return made
