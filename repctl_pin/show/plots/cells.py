"""Figures of a function over a cell: slices through its centre, by limit margin and by extra joint
speed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...inverse_function import CellDesign
from ...inverse_function.cell_design import Slice
from ..palette import INK, VERMILLION
from .motions import titled

_WHAT = {
    "limit_margin": ("limit margin", "viridis", 1.0),
    "extra_speed": ("extra joint speed, %", "magma_r", 100.0),
}


def slice_of_cell(
    ax: Axes,
    design: CellDesign,
    cut: Slice,
    what: str = "limit_margin",
    ends: tuple[float, float] | None = None,
) -> Axes:
    """Draw ``limit_margin`` or ``extra_speed`` over one slice, coloured from ``ends``; uncovered
    poses are grey."""
    _, colours, scale = _WHAT[what]
    values = scale * getattr(cut, what)
    values = np.ma.array(values, mask=~np.isfinite(values))
    centre, widths = _centre(design), design.cell.widths[design.cell.widths > 0]
    (i, j), u = cut.axes, cut.u
    low, high = (None, None) if ends is None else ends
    ax.set_facecolor("#dddddd")
    ax.pcolormesh(centre[i] + widths[i] * u, centre[j] + widths[j] * u, values,
                  cmap=colours, shading="gouraud", vmin=low, vmax=high)  # fmt: skip
    ax.plot(centre[i], centre[j], "+", color=VERMILLION, ms=10, mew=2)
    ax.locator_params(nbins=4)
    ax.set_xlabel(f"{design.cell.names[i]} ({design.cell.units[i]})")
    ax.set_ylabel(f"{design.cell.names[j]} ({design.cell.units[j]})")
    ax.set_aspect("equal" if design.cell.units[i] == design.cell.units[j] else "auto")
    return ax


def cell_figure(design: CellDesign, cuts: Sequence[Slice]) -> Figure:
    """Draw every slice twice: by limit margin above, by extra joint speed below, each row with one
    colour scale."""
    shapes = [design.cell.widths[design.cell.widths > 0][list(cut.axes)] for cut in cuts]
    shares = [min(max(w / h, 0.5), 2.0) if h else 1.0 for w, h in shapes]
    task = design.task
    title = f"{task.robot.name}, {task.frame}, {task.kind}: one function for {design.cell.size()}"
    figure = titled(2.0 + 2.7 * sum(shares), 6.7, title)
    grid = figure.subplots(2, len(cuts), squeeze=False, width_ratios=shares)
    for row, (what, (label, _, scale)) in zip(grid, _WHAT.items(), strict=True):
        every = scale * np.concatenate([getattr(cut, what).ravel() for cut in cuts])
        ends = (
            (float(np.nanmin(every)), float(np.nanmax(every)))
            if np.isfinite(every).any()
            else (0.0, 1.0)
        )
        for ax, cut, share in zip(row, cuts, shares, strict=True):
            slice_of_cell(ax, design, cut, what, ends).locator_params(
                "x", nbins=round(2 + 2 * share)
            )
        label = f"{label}, {design.task.unit}" if what == "limit_margin" else label
        figure.colorbar(row[0].collections[0], ax=list(row), shrink=0.9, aspect=30).set_label(
            label, color=INK
        )
    return figure


def _centre(design: CellDesign) -> np.ndarray:
    """Return the cell's centre along its axes of non-zero width: m, and 0 for rotations."""
    cell = design.cell
    every = np.zeros(len(cell.widths))
    every[: len(cell.half_width)] = cell.placement.translation[
        cell.task.rows[: len(cell.half_width)]
    ]
    return every[cell.widths > 0]
