"""Figures of a function over a cell: slices through its middle, by limit margin and by extra joint speed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from .motions import INK, VERMILLION

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ...section import CellDesign
    from ...section.slices import Slice

_WHAT = {"limit_margin": ("limit margin", "viridis", 1.0), "extra_speed": ("extra joint speed, %", "magma_r", 100.0)}


def slice_of_cell(ax: Axes, design: CellDesign, cut: Slice, what: str = "limit_margin") -> Axes:
    """Draw ``limit_margin`` or ``extra_speed`` over one slice; what is not covered stays grey."""
    label, colours, scale = _WHAT[what]
    label = f"{label}, {design.task.unit}" if what == "limit_margin" else label
    values = scale * getattr(cut, what)
    values = np.ma.array(values, mask=~np.isfinite(values))
    centre, widths = _centre(design), design.cell.widths[design.cell.widths > 0]
    (i, j), u = cut.axes, cut.u
    ax.set_facecolor("#dddddd")
    mesh = ax.pcolormesh(centre[i] + widths[i] * u, centre[j] + widths[j] * u, values, cmap=colours, shading="gouraud")
    ax.figure.colorbar(mesh, ax=ax, shrink=0.85)
    ax.set_title(label, color=INK, fontsize=10, loc="left")
    ax.plot(centre[i], centre[j], "+", color=VERMILLION, ms=10, mew=2)
    ax.set_xlabel(f"{design.cell.names[i]} ({design.cell.units[i]})")
    ax.set_ylabel(f"{design.cell.names[j]} ({design.cell.units[j]})")
    ax.set_aspect("equal" if design.cell.units[i] == design.cell.units[j] else "auto")
    return ax


def cell_figure(design: CellDesign, cuts: Sequence[Slice]) -> Figure:
    """Draw every slice twice: by limit margin above, by extra joint speed below."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(4.6 * len(cuts), 7.4), layout="constrained")
    for row, what in zip(figure.subplots(2, len(cuts), squeeze=False), _WHAT, strict=True):
        for ax, cut in zip(row, cuts, strict=True):
            slice_of_cell(ax, design, cut, what)
    figure.suptitle(
        f"{design.task.robot.name}, {design.task.frame}, {design.task.kind}: one function for {design.cell.size()}; "
        f"{100 * design.extra_speed:.3g} % more joint speed than the desired control",
        fontsize=10,
        x=0.01,
        ha="left",
    )
    return figure


def _centre(design: CellDesign) -> np.ndarray:
    """The middle in the cell's coordinates, m; 0 for rotations."""
    cell = design.cell
    every = np.zeros(len(cell.widths))
    every[: len(cell.half_width)] = cell.placement.translation[cell.task.rows[: len(cell.half_width)]]
    return every[cell.widths > 0]
