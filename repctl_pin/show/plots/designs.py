"""Figures of a design: cost against degree, distance from the desired inverse, and leaf margin."""

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
from ..palette import BLUE, GREEN, INK, ORANGE
from .motions import axis_label, quiet, titled


def cost_against_degree(
    ax: Axes, degrees: Sequence[tuple[int, float, float]], baselines: Sequence[Baseline] = ()
) -> Axes:
    """Draw the cost on held-out nodes against the degree of the potentials, with other repeatable
    inverses.

    Parameters
    ----------
    ax
        Where to draw.
    degrees
        Degree, cost, standard error.
    baselines
        Drawn as level lines; those singular in Ω are named instead.
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
    for baseline, colour, style in zip(baselines, (ORANGE, GREEN), ("--", "-."), strict=False):
        if baseline.evaluation is None:
            ax.plot([], [], " ", label=f"{baseline.name}: singular in Ω")
        else:
            ax.axhline(
                baseline.evaluation.cost, color=colour, ls=style, lw=1.4, label=baseline.name
            )
    ax.set_yscale("log")
    ax.set_xticks(d, [f"{int(v)}" for v in d])
    ax.set_xlim(d.min() - 0.4, d.max() + 0.4)
    ax.set_xlabel("degree of the potentials")
    ax.set_ylabel(r"mean $\|G_r - G_d\|^2$")
    _plain_log_ticks(ax)
    return quiet(ax)


def joint_map(
    ax: Axes,
    design: Design,
    grid: DesignMap,
    values: NDArray[np.float64],
    label: str,
    top: float | None = None,
) -> Axes:
    """Draw values over a grid of two joints, with contour lines, a colour bar, and a cross at the
    centre of Ω.

    Parameters
    ----------
    ax
        Where to draw.
    design
        Whose Ω it is.
    grid
        The two joints, across and upward, and their values.
    values : (l, k) array
        Rows upward; nan where there is none, which stays blank.
    label
        What is drawn, and its unit.
    top
        Where the colours end; by default at the largest value. They begin at 0, and bright is
        large.
    """
    across, upward = grid.joints
    shown = np.ma.masked_invalid(values)
    shade = ax.pcolormesh(
        grid.x, grid.y, shown, cmap="viridis", vmin=0, vmax=top, shading="nearest", rasterized=True
    )
    if shown.count() and np.ptp(shown) > 0.1 * (
        top or np.abs(shown).max()
    ):  # else all lines would read alike
        lines = ax.contour(
            grid.x, grid.y, shown, levels=6, colors="white", linewidths=0.7, alpha=0.85
        )
        digits = max(0, 1 - int(np.floor(np.log10(np.ptp(np.array(lines.levels)) / 6))))
        for value in ax.clabel(lines, fmt=lambda v: f"{v:.{digits}f}", fontsize=7):
            value.set_path_effects([withStroke(linewidth=1.6, foreground="#00000088")])
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
    """Make the figure ``design.png``.

    Parameters
    ----------
    design
        The design.
    grid
        Its maps over two joints.
    degrees
        Degree, cost and standard error of designs to compare; none leaves that panel out.
    baselines
        Simpler inverses to compare in the same panel.
    title
        Title of the figure.
    """
    panels = 3 if degrees else 2
    figure = titled(4.3 * panels, 4.0, title)
    axes = list(figure.subplots(1, panels))
    if degrees:
        ax = cost_against_degree(axes.pop(0), degrees, baselines)
        ax.set_title("cost on held-out nodes, ± 2 standard errors", fontsize=10)
        ax.legend(frameon=False, fontsize=8.5, loc="upper right")
    with np.errstate(invalid="ignore"):
        distance = grid.distance / grid.reference
    joint_map(axes[0], design, grid, distance, r"distance $\|G_r - G_d\| / \|G_d\|$")
    joint_map(axes[1], design, grid, grid.leaf_margin, "leaf margin (0: singular, 1: best)", 1.0)
    return figure


def _plain_log_ticks(ax: Axes) -> None:
    """Label a log axis that may span less than a decade with plain numbers."""
    low, high = ax.get_ylim()
    ax.set_ylim(low, high * (high / low) ** 0.4)  # room for the legend
    span = high / low
    ax.yaxis.set_major_locator(
        LogLocator(subs=(1, 1.5, 2, 3, 5, 7) if span < 15 else (1, 2, 5) if span < 300 else (1,))
    )
    ax.yaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
    ax.yaxis.set_minor_formatter(NullFormatter())
