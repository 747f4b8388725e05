"""Figures of a design: cost against degree, distance from the desired inverse, and leaf margin.

The desired inverse G_d, usually J⁺, is the one that the repeatable inverse G_r of the design
approximates. The cost is their mean squared distance over Ω, the region of the design. The leaf
margin is the distance from an algorithmic singularity: 1 is best, 0 is singular. Maps show values
over two joints, with the others at the centre of Ω.

``Baseline`` is a simpler repeatable inverse over the same Ω: its name, and its cost and margins, or
the error if it is singular in Ω. ``DesignMap`` is the distance from the desired inverse and the
leaf margin of a design on a grid over two joints.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from numpy.typing import NDArray

from ...design import Design
from ...design.design_map import DesignMap
from ...design.evaluation import Baseline
from ..palette import BLUE, GREY, INK
from .figure_layout import axis_label, quiet, titled


def cost_against_degree(
    ax: Axes, degrees: Sequence[tuple[int, float, float]], baselines: Sequence[Baseline] = ()
) -> Axes:
    """Draw the cost of designs against the degree of their polynomials, and that of other inverses.

    The cost is the mean squared distance from the desired inverse on held-out nodes, configurations
    that were not used in the fit. The figure shows whether a higher degree is worthwhile.

    Parameters
    ----------
    ax
        Axes to draw on.
    degrees
        Degree, cost and standard error of the cost of each design.
    baselines
        Other repeatable inverses, drawn as horizontal lines; those that are singular in Ω, the
        region of the design, are only named in the legend.
    """
    d, cost, error = (np.array(column, float) for column in zip(*degrees, strict=True))
    ax.errorbar(
        d,
        cost,
        yerr=2 * error,
        color=BLUE,
        marker="o",
        ms=5,
        capsize=3,
        lw=1.4,
        label="nearest repeatable",
    )
    for baseline, style in zip(baselines, ("--", ":"), strict=False):
        if baseline.evaluation is None:
            ax.plot([], [], " ", label=f"{baseline.name}: singular in Ω")
        else:
            ax.axhline(baseline.evaluation.cost, color=GREY, ls=style, lw=1.4, label=baseline.name)
    ax.set_yscale("log")
    ax.set_xticks(d, [f"{int(v)}" for v in d])
    ax.set_xlim(d.min() - 0.4, d.max() + 0.4)
    ax.set_xlabel("degree of the potentials")
    ax.set_ylabel(r"mean $\|G_r - G_d\|^2$")
    _plain_log_ticks(ax)
    return quiet(ax)


_VARIATION = 0.05
"""Minimum variation of a map, as a fraction of its colour scale, for the map to be drawn."""


def varies(values: NDArray[np.float64], top: float | None = None) -> bool:
    """Test whether values over two joints vary enough to be drawn as a map.

    The largest and the smallest value must differ by at least 5 % of ``top``.

    Parameters
    ----------
    values : (rows, columns) array
        Values; nan where the quantity is undefined.
    top
        Upper end of the colour scale; by default the largest absolute value.
    """
    shown = values[np.isfinite(values)]
    return shown.size > 0 and bool(np.ptp(shown) >= _VARIATION * (top or np.abs(shown).max()))


def joint_map(
    ax: Axes,
    design: Design,
    grid: DesignMap,
    values: NDArray[np.float64],
    label: str,
    top: float | None = None,
) -> Axes:
    """Draw values over a grid of two joints as colours, with contour lines and a colour bar.

    A cross marks the centre of Ω, the region of the design, where all other joints are. Bright
    means good and dark means bad in every map.

    Parameters
    ----------
    ax
        Axes to draw on.
    design
        Design whose Ω is mapped.
    grid
        Grid, with the indices of the horizontal and the vertical joint, and their positions.
    values : (k, k) array
        Values on the grid of k × k points. The row is the index of the vertical joint's position,
        the column that of the horizontal joint's. Where a value is nan, the map is blank.
    label
        Label of the colour bar, with the unit.
    top
        Upper end of the colour scale, for a quantity of which large values are good. By default,
        small values are good, and the scale ends at the largest value. The scale begins at 0.
    """
    across, upward = grid.joints
    shown = np.ma.masked_invalid(values)
    colours = "viridis_r" if top is None else "viridis"
    shade = ax.pcolormesh(
        grid.x, grid.y, shown, cmap=colours, vmin=0, vmax=top, shading="nearest", rasterized=True
    )
    if varies(values, 0.5 * top if top else None):  # else all lines would read alike
        lines = ax.contour(grid.x, grid.y, shown, levels=5, colors="white", linewidths=0.9)
        digits = max(0, 1 - int(np.floor(np.log10(np.ptp(np.array(lines.levels)) / 6))))
        for value in ax.clabel(lines, fmt=lambda v: f"{v:.{digits}f}", fontsize=8, colors="white"):
            value.set_path_effects([withStroke(linewidth=2.2, foreground=INK)])
    ax.plot(*design.region.center[[across, upward]], "+", color=INK, ms=9, mew=1.5)
    ax.set_xlabel(axis_label(design.task, across))
    ax.set_ylabel(axis_label(design.task, upward))
    bar = ax.figure.colorbar(shade, ax=ax, pad=0.02)
    bar.set_label(label, fontsize=9)
    bar.outline.set_visible(False)
    return ax


def design_figure(
    design: Design,
    grid: DesignMap,
    degrees: Sequence[tuple[int, float, float]] = (),
    baselines: Sequence[Baseline] = (),
    *,
    title: str = "",
) -> Figure:
    """Draw the figure ``design.png``: cost against degree, and maps over two joints.

    The maps show where in Ω, its region of joint space, the design is far from the desired inverse,
    and where it is nearly singular.

    Parameters
    ----------
    design
        The design.
    grid
        Maps of the design over two joints.
    degrees
        Degree, cost and standard error of designs to compare; if empty, that panel is left out.
    baselines
        Simpler inverses to compare in the same panel.
    title
        Title of the figure.
    """
    with np.errstate(invalid="ignore"):
        distance = grid.distance / grid.reference
    drawn = maps_that_vary(
        (distance, r"distance $\|G_r - G_d\| / \|G_d\|$", None),
        (grid.leaf_margin, "leaf margin (0: singular, 1: best)", 1.0),
    )
    panels = len(drawn) + bool(degrees)
    figure = titled(4.3 * max(panels, 2), 4.0, title)
    axes = list(figure.subplots(1, panels, squeeze=False)[0])
    if degrees:
        ax = cost_against_degree(axes.pop(0), degrees, baselines)
        ax.set_title("cost on held-out nodes, ± 2 standard errors", fontsize=10)
        ax.legend(frameon=False, fontsize=8.5, loc="upper right")
    for ax, (values, label, top) in zip(axes, drawn, strict=True):
        joint_map(ax, design, grid, values, label, top)
    return figure


_Map = tuple[NDArray[np.float64], str, float | None]
"""Values over two joints, their label, and their largest possible value if large values are good;
None if small values are good."""


def maps_that_vary(*maps: _Map) -> list[_Map]:
    """Select the maps that vary enough to be drawn; the first map if none does.

    A map is a tuple of its values over two joints, their label, and their largest possible value if
    large values are good, else None.
    """
    return [one for one in maps if varies(one[0], one[2])] or [maps[0]]


def _plain_log_ticks(ax: Axes) -> None:
    """Label a log axis with plain numbers, and extend it upwards to make space for the legend.

    The axis may span less than a decade; labels at powers of ten only would then be missing.
    """
    low, high = ax.get_ylim()
    ax.set_ylim(low, high * (high / low) ** 0.4)  # room for the legend
    span = high / low
    ax.yaxis.set_major_locator(
        LogLocator(subs=(1, 1.5, 2, 3, 5, 7) if span < 15 else (1, 2, 5) if span < 300 else (1,))
    )
    ax.yaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
    ax.yaxis.set_minor_formatter(NullFormatter())
