"""Figure of a function over a cell: slices over two coordinates, coloured by figures of merit.

A function q = F(x) over a cell, a box of poses, gives one configuration for each pose. A slice is a
grid over two coordinates of the cell, with the others at 0. A sector is a cell in cylindrical
coordinates around an axis; its angle is that about the axis. Extra joint speed is the joint speed
relative to that of the desired inverse, such as J⁺, minus 1.

``Slice`` is a map of a function's limit margin and joint speed over two coordinates of its cell.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from math import ceil
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.transforms import BboxBase
from PIL import Image

from ....show.palette import INK, VERMILLION
from ....show.plots.figure_layout import titled
from ..cell_design_result import CellDesign, Slice
from ..geometry.cell import Cell

_NOT_COVERED = 0xDD
"""Grey level of poses that are not covered, in a figure on white paper."""

_VEIL = 0x80
"""Grey level of the veil that shows these poses on any paper."""

_WHAT = {
    "limit_margin": ("limit margin", "viridis", 1.0),
    "extra_speed": ("extra joint speed, %", "magma_r", 100.0),
    "turn": ("angle all round, °", "cividis", 180 / np.pi),
}


def _slice_of_cell(
    ax: Axes, design: CellDesign, cut: Slice, what: str, ends: tuple[float, float]
) -> None:
    """Draw one quantity over one slice of a cell as a map; poses that are not covered are grey.

    A slice is a grid over two coordinates of the cell; all others are 0. ``what`` is
    ``limit_margin``, ``extra_speed`` or ``turn``, the full width of the range of a sector's angle
    inside the limits. ``ends`` are the values at the lower and upper end of the colour scale.
    """
    _, colours, scale = _WHAT[what]
    values = scale * getattr(cut, what)
    values = np.ma.array(values, mask=~np.isfinite(values))
    cell = design.function.chart.cell
    (i, j), u = cut.axes, cut.u
    U = np.zeros((len(u) ** 2, cell.k))
    U[:, j], U[:, i] = (grid.ravel() for grid in np.meshgrid(u, u, indexing="ij"))
    x, y = cell._values(cell.spread(U))[:, cell.moved[[i, j]]].T.reshape(2, len(u), len(u))
    centre = cell.centre[cell.moved]
    low, high = ends
    around = [np.concatenate([e[0], e[:, -1], e[-1, ::-1], e[::-1, 0]]) for e in (x, y)]
    ax.fill(*around, color=str(_NOT_COVERED / 255), lw=0)
    ax.pcolormesh(x, y, values, cmap=colours, shading="gouraud", vmin=low, vmax=high)
    ax.plot(centre[i], centre[j], "+", color=VERMILLION, ms=10, mew=2)
    _name_axes(ax, cell, i, j)


def _name_axes(ax: Axes, cell: Cell, i: int, j: int) -> None:
    """Label the axes of a map with names and units of the coordinates u_i and u_j of a cell."""
    ax.locator_params(nbins=4)
    ax.set_xlabel(f"{cell.names[i]} ({cell.units[i]})")
    ax.set_ylabel(f"{cell.names[j]} ({cell.units[j]})")
    ax.set_aspect("equal" if cell.units[i] == cell.units[j] else "auto")


def cell_figure(design: CellDesign, cuts: Sequence[Slice]) -> Figure:
    """Draw the figure of slices, with a panel for each slice and quantity.

    The quantities are the limit margin, the extra joint speed and, for a sector, the width of the
    range of angles about its axis within which the joint limits are kept at each pose of the slice.
    All panels of a quantity have the same colour scale.
    """
    cell = design.function.chart.cell
    shapes = [cell.widths[cell.moved][list(cut.axes)] for cut in cuts]
    shares = [min(max(w / h, 0.5), 2.0) if h else 1.0 for w, h in shapes]
    task = design.task
    title = f"{task.robot.name}, {task.frame}, {task.kind}: slices of one function"
    drawn = [what for what in _WHAT if getattr(cuts[0], what) is not None]
    figure, grid = _panels(title, len(drawn), shares)
    for row, what in zip(grid, drawn, strict=True):
        label = _WHAT[what][0]
        ends = _scale_ends(cuts, what)
        for ax, cut, share in zip(row, cuts, shares, strict=True):
            _slice_of_cell(ax, design, cut, what, ends)
            ax.locator_params("x", nbins=round(2 + 2 * share))
        label = f"{label}, {design.task._joint_unit}" if what == "limit_margin" else label
        figure.colorbar(row[0].collections[0], ax=list(row), shrink=0.9, aspect=30).set_label(
            label, color=INK
        )
    return figure


def _panels(title: str, quantities: int, shares: Sequence[float]) -> tuple[Figure, Any]:
    """Create the figure and its axes: an array with a row per quantity, and a column per slice.

    ``shares`` are the ratios of width to height of the slices, one per slice. The figure has the
    same rows and columns as the array. A single slice is the exception: its quantities are drawn
    side by side, but the array still has one column.
    """
    if len(shares) == 1:
        figure = titled((1.8 + 2.4 * shares[0]) * quantities, 3.7, title)
        return figure, figure.subplots(1, quantities, squeeze=False).T
    figure = titled(2.0 + 2.7 * sum(shares), 0.7 + 3.0 * quantities, title)
    return figure, figure.subplots(quantities, len(shares), squeeze=False, width_ratios=shares)


def _scale_ends(cuts: Sequence[Slice], what: str) -> tuple[float, float]:
    """Return the minimum and maximum of a quantity over all slices; 0 and 1 if it has no values."""
    every = _WHAT[what][2] * np.concatenate([getattr(cut, what).ravel() for cut in cuts])
    if not np.isfinite(every).any():
        return 0.0, 1.0
    return float(np.nanmin(every)), float(np.nanmax(every))


def map_pictures(figure: Figure, picture: bytes) -> list[tuple[bytes, str, str]]:
    """Cut each map, with the colour bar of its quantity, out of a figure of slices.

    ``picture`` is the figure as the bytes of a PNG file. Each map has three parts: its PNG file, a
    CSS polygon, and a description. The polygon surrounds the text: it is the picture without map
    and colour bar, by the fill rule ``evenodd``. Corners of the polygon are fractions of the
    picture, from the left and from the top. In dark mode, a page inverts only what is inside the
    polygon, so map and colour bar keep their colours.
    """
    whole = Image.open(io.BytesIO(picture))
    scales = [_scale_of(ax) for ax in figure.axes]
    found, bar = [], None
    for ax, scale in zip(figure.axes, scales, strict=True):
        if ax in scales:
            continue
        bar = bar if scale is None else scale  # one colour bar for all maps of a quantity
        assert bar is not None
        file = io.BytesIO()
        cut, around = _beside(whole, ax, bar)
        cut.save(file, format="png", compress_level=4)
        words = f"{bar.get_ylabel()}, over {ax.get_xlabel()} and {ax.get_ylabel()}"
        found.append((file.getvalue(), around, words))
    return found


def _scale_of(ax: Axes) -> Axes | None:
    """Return the axes of the colour bar of a map; None if the map has no colour bar of its own."""
    bar = ax.collections[0].colorbar if ax.collections else None
    return None if bar is None else bar.ax


def _beside(whole: Image.Image, *axes: Axes) -> tuple[Image.Image, str]:
    """Cut axes with their labels out of the picture ``whole``, and put them side by side.

    Return the new picture, and a CSS polygon. The polygon covers the labels; it leaves out the
    rectangles inside the axes: the map and its colour bar.
    """
    tight = [_pixels(whole, ax, ax.get_tightbbox()) for ax in axes]
    top, bottom = min(box[1] for box in tight), max(box[3] for box in tight)
    gap = whole.height // 40
    width = sum(right - left + gap for left, _, right, _ in tight) - gap
    made = Image.new("RGBA", (width, bottom - top), "white")
    corners = ["0 0,0 100%,100% 100%,100% 0,0 0"]
    x = 0
    for ax, (left, _, right, _) in zip(axes, tight, strict=True):
        made.paste(whole.crop((left, top, right, bottom)), (x, 0))
        hole = np.subtract(_pixels(whole, ax, ax.get_window_extent()), [left - x, top] * 2)
        x0, y0, x1, y1 = (int(side) for side in hole)
        made.paste(_on_any_paper(made.crop((x0, y0, x1, y1))), (x0, y0))
        corners.append(_hole(*(hole / np.tile(made.size, 2))))
        x += right - left + gap
    return made, f"polygon(evenodd,{','.join(corners)})"


def _on_any_paper(drawn: Image.Image) -> Image.Image:
    """Replace white, and the grey of poses that are not covered, by a translucent mid-grey.

    White becomes fully transparent. So the picture looks as before on a white background. On a dark
    background, white areas show the background, and poses that are not covered are dark, too.
    """
    pixels = np.array(drawn.convert("RGBA"))
    level = pixels[..., 0]
    pale = (level >= _NOT_COVERED) & (pixels[..., :3] == level[..., None]).all(axis=-1)
    opacity = 255.0 * (255 - level[pale]) / (255 - _VEIL)
    pixels[pale, :3] = _VEIL
    pixels[pale, 3] = opacity.round()
    return Image.fromarray(pixels)


def _pixels(whole: Image.Image, ax: Axes, box: BboxBase | None) -> tuple[int, int, int, int]:
    """Return the left, top, right and bottom pixels of a box in the picture ``whole``.

    The picture shows the figure of the axes ``ax``; ``box`` is in Matplotlib's display coordinates.
    """
    figure = ax.get_figure(root=True)
    assert figure is not None and box is not None
    shares = np.array(box.transformed(figure.transFigure.inverted()).extents)
    x0, y0, x1, y1 = shares.clip(0, 1)
    width, height = whole.size
    left, top = int(x0 * width), int((1 - y1) * height)
    return left, top, max(ceil(x1 * width), left + 1), max(ceil((1 - y0) * height), top + 1)


def _hole(x0: float, y0: float, x1: float, y1: float) -> str:
    """Write a box as points of a CSS polygon: pairs "x% y%", separated by commas.

    The points are the corners of the box, clockwise from the top left one and back to it. A last
    point, ``0 0``, returns to the picture's top left corner, where the polygon begins. ``x0``,
    ``y0``, ``x1`` and ``y1`` are the left, top, right and bottom side of the box, as fractions of
    the picture from the left and from the top.
    """
    left, top, right, bottom = (f"{100 * side:.2f}%" for side in (x0, y0, x1, y1))
    corners = [(left, top), (right, top), (right, bottom), (left, bottom), (left, top)]
    return ",".join(f"{x} {y}" for x, y in corners) + ",0 0"
