"""Figures of a function over a cell: slices, coloured by figures of merit; and the map of a box.

A slice shows the function over two coordinates of the cell. The map shows where in the workspace a
box of poses works.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure

from ....base.arguments import Array
from ....show.palette import INK, VERMILLION
from ....show.plots.motions import titled
from ..cell_design import CellDesign, Slice
from ..geometry.cell import Cell
from .cell_map import Section

_WHAT = {
    "limit_margin": ("limit margin", "viridis", 1.0),
    "extra_speed": ("extra joint speed, %", "magma_r", 100.0),
    "turn": ("angle all round, °", "cividis", 180 / np.pi),
}


def _slice_of_cell(
    ax: Axes, design: CellDesign, cut: Slice, what: str, ends: tuple[float, float]
) -> None:
    """Draw one quantity over one slice of a cell as a map; poses that are not covered are grey.

    A slice has two coordinates of the cell. ``what`` is ``limit_margin``, ``extra_speed`` or
    ``turn``. ``ends`` are the values at the ends of the colour scale.
    """
    _, colours, scale = _WHAT[what]
    values = scale * getattr(cut, what)
    values = np.ma.array(values, mask=~np.isfinite(values))
    cell = design.function.chart.cell
    centre, widths = cell.centre[cell.moved], cell.widths[cell.moved]
    (i, j), u = cut.axes, cut.u
    low, high = ends
    ax.set_facecolor("#dddddd")
    ax.pcolormesh(centre[i] + widths[i] * u, centre[j] + widths[j] * u, values,
                  cmap=colours, shading="gouraud", vmin=low, vmax=high)  # fmt: skip
    ax.plot(centre[i], centre[j], "+", color=VERMILLION, ms=10, mew=2)
    ax.locator_params(nbins=4)
    ax.set_xlabel(f"{cell.names[i]} ({cell.units[i]})")
    ax.set_ylabel(f"{cell.names[j]} ({cell.units[j]})")
    ax.set_aspect("equal" if cell.units[i] == cell.units[j] else "auto")


def cell_figure(design: CellDesign, cuts: Sequence[Slice]) -> Figure:
    """Draw the figure of slices, with a panel for each slice and quantity.

    The quantities are the limit margin, the extra joint speed and, for a sector, how far it reaches
    around its axis. Each quantity has one colour scale.
    """
    cell = design.function.chart.cell
    shapes = [cell.widths[cell.moved][list(cut.axes)] for cut in cuts]
    shares = [min(max(w / h, 0.5), 2.0) if h else 1.0 for w, h in shapes]
    task = design.task
    title = f"{task.robot.name}, {task.frame}, {task.kind}: one function for {design.cell.size()}"
    drawn = [what for what in _WHAT if getattr(cuts[0], what) is not None]
    one = len(cuts) == 1
    if one:  # side by side
        figure = titled(1.5 + 3.6 * len(drawn), 3.7, title)
        grid = figure.subplots(1, len(drawn), squeeze=False).T
    else:
        figure = titled(2.0 + 2.7 * sum(shares), 0.7 + 3.0 * len(drawn), title)
        grid = figure.subplots(len(drawn), len(cuts), squeeze=False, width_ratios=shares)
    for row, what in zip(grid, drawn, strict=True):
        label, _, scale = _WHAT[what]
        every = scale * np.concatenate([getattr(cut, what).ravel() for cut in cuts])
        ends = (
            (float(np.nanmin(every)), float(np.nanmax(every)))
            if np.isfinite(every).any()
            else (0.0, 1.0)
        )
        for ax, cut, share in zip(row, cuts, shares, strict=True):
            _slice_of_cell(ax, design, cut, what, ends)
            ax.locator_params("x", nbins=round(2 + 2 * share))
        label = f"{label}, {design.task.unit}" if what == "limit_margin" else label
        figure.colorbar(row[0].collections[0], ax=list(row), shrink=0.9, aspect=30).set_label(
            label, color=INK
        )
    return figure


def map_figure(cell: Cell, posture: Array, factor: float, cuts: Sequence[Section]) -> Figure:
    """Draw the map of the workspace, with the arm at a posture (n,) in the middle of a cell.

    The map shows where a box of poses works, in sections parallel to axes of the base. Its boxes
    are larger than the cell by 1 / ``factor``.
    """
    task = cell.task
    edges = " × ".join(f"{2 * w / factor:.3g}" for w in cell.half_width)
    title = f"{task.robot.name}, {task.frame}: where a box of {edges} m works"
    figure = titled(1.5 + 4.4 * len(cuts), 4.6, title)
    panels = figure.subplots(1, len(cuts), squeeze=False)[0]
    every = 100 * np.concatenate([cut.extra.ravel() for cut in cuts])
    fits = np.isfinite(every).any()
    most = max(float(np.nanpercentile(every, 95)), 0.1) if fits else 1.0
    tip = task.placement(posture).translation
    arm = np.vstack([np.zeros(3), task.joint_origins(posture), tip])
    for ax, cut in zip(panels, cuts, strict=True):
        partly, whole = _draw_section(ax, cut, most)
        _draw_arm_and_box(ax, cut, arm, cell)
    bar = figure.colorbar(whole, ax=list(panels), shrink=0.85, aspect=30, extend="max")
    bar.set_label("extra joint speed where it fits, %", color=INK)
    bar = figure.colorbar(
        partly, ax=list(panels), shrink=0.85, aspect=30, boundaries=np.arange(0, 101)
    )
    bar.set_label("elsewhere, share of the size that fits, %", color=INK)
    return figure


def _draw_section(ax: Axes, cut: Section, most: float) -> tuple[QuadMesh, QuadMesh]:
    """Draw where a share of a box fits, in grey, and the extra joint speed where all of it fits.

    ``most`` is the end of the colour scale, in percent.
    """
    share = np.ma.masked_where((cut.share == 0) | (cut.share == 1), cut.share)
    partly = ax.pcolormesh(cut.a, cut.b, 100 * share, cmap="Greys", vmin=0, vmax=150)
    extra = np.ma.masked_invalid(100 * cut.extra)
    return partly, ax.pcolormesh(cut.a, cut.b, extra, cmap="viridis_r", vmin=0.0, vmax=most)


def _draw_arm_and_box(ax: Axes, cut: Section, arm: Array, cell: Cell) -> None:
    """Draw the joints of the arm (K, 3), m, and the outline of a box over a section."""
    i, j = cut.axes
    ax.plot(arm[:, i], arm[:, j], "o-", color=INK, lw=2.5, ms=4)
    corners = cell.placements(cell.corners())[0]
    low, high = corners.min(axis=0), corners.max(axis=0)
    around = [low[i], high[i], high[i], low[i], low[i]]
    beside = [low[j], low[j], high[j], high[j], low[j]]
    ax.plot(around, beside, color=VERMILLION, lw=2)
    ax.set_aspect("equal")
    ax.locator_params(nbins=6)
    ax.set_xlabel(f"{'xyz'[i]} of the middle (m)")
    ax.set_ylabel(f"{'xyz'[j]} of the middle (m)")
    still = next((k for k in (2, 1, 0) if k not in cut.axes), 2)
    at = cell.placement.translation[still]
    ax.set_title(f"at {'xyz'[still]} = {at:.2f} m", fontsize="medium")
