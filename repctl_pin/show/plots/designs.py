"""Figures of a design: cost against degree, where it is far from what was desired, where it is near singular."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from ...design import Design
from ...design.design_map import DesignMap
from ...design.judgement import Baseline
from ..palette import BLUE, GREEN, ORANGE
from .maps import joint_map
from .motions import quiet, titled


def cost_against_degree(
    ax: Axes, degrees: Sequence[tuple[int, float, float]], baselines: Sequence[Baseline] = ()
) -> Axes:
    """Draw the cost on held-out nodes against the degree of the potentials, beside other repeatable inverses.

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
    ax.errorbar(d, cost, yerr=2 * error, color=BLUE, marker="o", ms=5, capsize=3, lw=1.4, label="nearest repeatable")
    for baseline, colour, style in zip(baselines, (ORANGE, GREEN), ("--", "-."), strict=False):
        if baseline.judgement is None:
            ax.plot([], [], " ", label=f"{baseline.name}: singular in Ω")
        else:
            ax.axhline(baseline.judgement.cost, color=colour, ls=style, lw=1.4, label=baseline.name)
    ax.set_yscale("log")
    ax.set_xticks(d, [f"{int(v)}" for v in d])
    ax.set_xlim(d.min() - 0.4, d.max() + 0.4)
    ax.set_xlabel("degree of the potentials")
    ax.set_ylabel(r"mean $\|G_r - G_d\|^2$")
    _plain_log_ticks(ax)
    return quiet(ax)


def map_over_joints(ax: Axes, field: DesignMap, design: Design, what: str = "distance") -> Axes:
    """Draw ``distance`` (relative to ‖G_d‖) or ``leaf_margin`` over two joints, with the center marked."""
    relative = what == "distance"
    with np.errstate(invalid="ignore"):
        values = field.distance / field.reference if relative else field.leaf_margin
    label = r"distance $\|G_r - G_d\| / \|G_d\|$" if relative else "leaf margin (0: singular, 1: best)"
    mark = design.region.center[list(field.joints)]
    top = None if relative else 1.0
    return joint_map(ax, design.task, field.joints, field.x, field.y, values, label=label, top=top, mark=mark)


def design_figure(
    design: Design, field: DesignMap, degrees: Sequence[tuple[int, float, float]] = (), *, title: str = ""
) -> Figure:
    """Make the figure ``design.png``."""
    panels = 3 if degrees else 2
    figure = titled(4.3 * panels, 4.0, title)
    axes = list(figure.subplots(1, panels))
    if degrees:
        ax = cost_against_degree(axes.pop(0), degrees, design.baselines)
        ax.set_title("cost on held-out nodes, ± 2 standard errors", fontsize=10)
        ax.legend(frameon=False, fontsize=8.5, loc="upper right")
    map_over_joints(axes[0], field, design)
    map_over_joints(axes[1], field, design, "leaf_margin")
    return figure


def _plain_log_ticks(ax: Axes) -> None:
    """Numbers as people write them on a log axis that may span less than a decade."""
    low, high = ax.get_ylim()
    ax.set_ylim(low, high * (high / low) ** 0.4)  # room for the legend
    span = high / low
    ax.yaxis.set_major_locator(
        LogLocator(subs=(1, 1.5, 2, 3, 5, 7) if span < 15 else (1, 2, 5) if span < 300 else (1,))
    )
    ax.yaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
    ax.yaxis.set_minor_formatter(NullFormatter())
