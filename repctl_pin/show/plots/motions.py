"""Figures of motions: drift and joint positions over the cycles."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from ...motion import Motion
from ...motion.joint_motion import violations_of
from ...motion.motion import CLOSED
from ...robot.task import Task
from ...studies import Study
from ..palette import INK, colours
from ..text.numbers import number

_BEYOND: dict[str, Any] = {
    "marker": "x",
    "color": INK,
    "ms": 9,
    "mew": 2,
    "ls": "none",
    "zorder": 5,
}
"""Cross at the first violation of a motion."""


def drawn(study: Study) -> list[tuple[str, Motion, str]]:
    """List every strategy of a study that has a motion: its label, motion and colour."""
    colour = colours(study)
    return [
        (plain(row.label), row.motion, colour[row.key])
        for row in study.rows
        if row.motion is not None
    ]


def drift_over_cycles(
    ax: Axes, motions: Sequence[tuple[str, Motion, str]], *, log: bool = False
) -> Axes:
    """Draw the joint drift after each cycle, with its last value at the end of the line.

    A cross marks the cycle in which a joint first exceeds its limits, or two bodies first collide.

    Parameters
    ----------
    ax
        Axes to draw on.
    motions
        Label, motion and colour of each.
    log
        Whether to use a log scale, without the values.
    """
    for (label, motion, colour), marker in zip(motions, "osD^vPX" * len(motions), strict=False):
        cycles = np.arange(1, motion.cycles + 1)
        ax.plot(
            cycles, np.maximum(motion.drift, 1e-17), marker=marker, ms=4, color=colour, label=label
        )
        for beyond in violations_of(motion, motion.coarse):
            ax.plot(beyond.cycle, max(motion.drift[beyond.cycle - 1], 1e-17), **_BEYOND)
    if log:
        ax.set_yscale("log")
    else:
        ax.set_ylim(0, _top(motions) or ax.get_ylim()[1])
        _end_labels(ax, motions)
    ax.set_xlabel("cycle")
    ax.set_ylabel(f"joint drift $\\|q - q_0\\|$ ({motions[0][1].task.unit})")
    return quiet(ax, whole=True)


def _top(motions: Sequence[tuple[str, Motion, str]]) -> float | None:
    """Choose the upper end of the axis if a controller that moves away in cycle 1 and stays there
    would hide all other drift."""
    drifts = [motion.drift for _, motion, _ in motions]
    rest = max((float(d.max()) for d in drifts if not _stays(d)), default=0.0)
    if not rest > CLOSED:
        return None
    kept = [float(d.max()) for d in drifts if not (_stays(d) and d[0] > 4 * rest)]
    return 1.2 * max(kept) if len(kept) < len(drifts) else None


def _stays(drift: NDArray[np.float64]) -> bool:
    """Check whether nearly all of a drift occurs in the first of several cycles."""
    return len(drift) > 1 and bool(drift[-1] < 1.1 * drift[0])


def _end_labels(ax: Axes, motions: Sequence[tuple[str, Motion, str]]) -> None:
    """Write each motion's name, last drift and first violation beside the end of its line."""
    low, high = ax.get_ylim()
    step, floor = 0.075 * (high - low), -np.inf
    for label, motion, colour in sorted(motions, key=lambda one: float(one[1].drift[-1])):
        drift = float(motion.drift[-1])
        above, floor = drift > high, max(min(drift, high), floor + step)
        value = (
            f"0 ({number(drift)}, the integrator's error)"
            if motion.closes
            else f"{number(drift)} {motion.task.unit}"
        )
        beyond = "".join(
            f"\n$\\times$ {'limit' if len(it.names) == 1 else 'touch'} in cycle {it.cycle}"
            for it in violations_of(motion, motion.coarse)
        )
        floor += 0.5 * step * beyond.count("\n")
        ax.annotate(
            f"{label}: {value}{' ↑' if above else ''}{beyond}",
            xy=(motion.cycles, drift),
            xytext=(1.055 * motion.cycles, floor),
            color=colour,
            fontsize=9,
            va="center",
            annotation_clip=False,
        )


def joint_over_cycles(ax: Axes, motions: Sequence[tuple[str, Motion, str]], joint: int) -> Axes:
    """Draw one joint against time in cycles, with nearby limits as dashed lines.

    A cross marks where it first exceeds them.
    """
    task = motions[0][1].task
    for label, motion, colour in motions:
        ax.plot(
            motion.t / motion.t[-1] * motion.cycles,
            motion.q[:, joint],
            color=colour,
            lw=1.1,
            label=label,
        )
        for beyond in violations_of(motion, motion.coarse):
            if beyond.names == task.joint_names[joint : joint + 1]:
                ax.plot(
                    beyond.moment, motion.q[round(beyond.moment * motion.steps), joint], **_BEYOND
                )
    low, high = ax.get_ylim()
    span = high - low
    for limit in (task.lower[joint], task.upper[joint]):
        if low - 0.5 * span < limit < high + 0.5 * span:
            ax.axhline(limit, color=INK, lw=0.8, ls="--")
    ax.set_title(plain(task.joint_names[joint]), fontsize=9, loc="left")
    ax.set_ylabel("rad" if task.revolute[joint] else "m")
    return quiet(ax, whole=True)


def drift_figure(motions: Sequence[tuple[str, Motion, str]], title: str) -> Figure:
    """Make the figure ``drift.png``."""
    figure = Figure(figsize=(8.6, 4.4), layout="constrained")
    ax = drift_over_cycles(figure.add_subplot(), motions)
    ax.set_title(plain(title), fontsize=10, loc="left")
    corner = _free_corner(ax, motions)
    if corner is not None:
        inset = drift_over_cycles(ax.inset_axes((*corner, *_INSET)), motions, log=True)
        inset.set(xlabel="", ylabel="")
        inset.set_title("the same on a log scale", fontsize=8, loc="left")
        inset.tick_params(labelsize=7)
        for line in inset.lines:
            line.set(markersize=2, linewidth=1)
    return figure


_INSET = (0.38, 0.3)
"""Width and height of the inset, as fractions of the axes."""


def _free_corner(
    ax: Axes, motions: Sequence[tuple[str, Motion, str]]
) -> tuple[float, float] | None:
    """Find the highest place, on the left or else on the right, where the inset covers no line;
    None if there is none."""
    to_axes, shares = ax.transData + ax.transAxes.inverted(), np.linspace(0, 1, 101)
    lines = [to_axes.transform(np.c_[1 : m.cycles + 1, m.drift]).T for _, m, _ in motions]
    for left in (0.1, 0.6):
        near = (shares > left - 0.08) & (shares < left + _INSET[0])
        y = np.concatenate([np.interp(shares[near], *line) for line in lines])
        for low in np.arange(0.6, 0.1, -0.04):
            if not ((y > low - 0.08) & (y < low + _INSET[1] + 0.12)).any():
                return left, float(low)
    return None


def joints_figure(motions: Sequence[tuple[str, Motion, str]], title: str) -> Figure:
    """Make the figure ``joints.png``: every joint over all cycles."""
    n = motions[0][1].task.n
    columns = 2 if n > 3 else 1
    rows = -(-n // columns)
    figure = titled(10 if columns == 2 else 7, 1.7 * rows + 0.9, title)
    axes = figure.subplots(rows, columns, sharex=True, squeeze=False)
    for joint, ax in enumerate(axes.ravel()):
        if joint < n:
            joint_over_cycles(ax, motions, joint)
        else:
            ax.set_axis_off()
    for column in range(columns):
        last = [
            ax for joint, ax in enumerate(axes.ravel()) if joint < n and joint % columns == column
        ][-1]
        last.set_xlabel("cycle")
        last.tick_params(labelbottom=True)
    return legend_below(figure, axes[0, 0])


def plain(text: str) -> str:
    """Escape a name for matplotlib, which would read text between two $ as a formula."""
    return text.replace("$", r"\$")


def png(figure: Figure, dpi: float = 150, **options: Any) -> bytes:
    """Draw a figure as a PNG file, with the options of matplotlib's ``savefig``."""
    layout = figure.get_layout_engine()
    if layout is not None and "bbox_inches" not in options:
        figure.set_dpi(dpi)
        layout.execute(figure)
        figure.set_layout_engine(None)  # savefig would draw everything twice, first for the layout
    file = io.BytesIO()
    figure.savefig(file, format="png", dpi=dpi, **options)
    return file.getvalue()


def titled(width: float, height: float, title: str) -> Figure:
    """Make an empty figure, in inches, with a title at its left."""
    figure = Figure(figsize=(width, height), layout="constrained")
    figure.suptitle(plain(title), fontsize=10, x=0.01, ha="left")
    return figure


def legend_below(figure: Figure, ax: Axes) -> Figure:
    """Add a legend of the axes below the figure, in one row."""
    handles, labels = ax.get_legend_handles_labels()
    figure.legend(
        handles, labels, loc="outside lower center", ncols=len(labels), frameon=False, fontsize=9
    )
    return figure


def axis_label(task: Task, joint: int) -> str:
    """Write the label of an axis: a joint and its unit."""
    return f"{plain(task.joint_names[joint])} ({'rad' if task.revolute[joint] else 'm'})"


def quiet(ax: Axes, *, whole: bool = False) -> Axes:
    """Style axes with a light grid and no box; ``whole`` puts integer ticks on the x axis."""
    if whole:
        ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    ax.spines[["top", "right"]].set_visible(False)
    ax.grid(True, color="#dddddd", lw=0.6)
    ax.set_axisbelow(True)
    return ax
