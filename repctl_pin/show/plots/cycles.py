"""Figures over the cycle: joint speed, and the room left to the joint limits."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..palette import INK
from .motions import plain, quiet

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ...motion import Motion


def speed_over_cycle(ax: Axes, motions: Sequence[tuple[str, Motion, str]]) -> Axes:
    """Draw the joint speed ‖q̇‖ over the first cycle, and dashed over the last.

    Parameters
    ----------
    ax
        Where to draw.
    motions
        Label, motion, colour.
    """
    for label, motion, colour in motions:
        s = (motion.t[: motion.steps] - motion.t[0]) / (motion.t[-1] - motion.t[0]) * motion.cycles
        ax.plot(s, motion.speed[: motion.steps], color=colour, lw=1.5, label=label)
        if motion.cycles > 1:
            last = slice((motion.cycles - 1) * motion.steps, motion.cycles * motion.steps)
            ax.plot(s, motion.speed[last], color=colour, lw=1.2, ls=(0, (3, 2)))
    ax.set_xlim(0, 1)
    ax.set_ylim(bottom=0)
    ax.set_xlabel("part of the cycle")
    ax.set_ylabel(f"joint speed ‖q̇‖ ({motions[0][1].task.unit}/s)".replace("rad and m/s", "rad/s and m/s"))
    return quiet(ax)


def margin_over_cycles(ax: Axes, motions: Sequence[tuple[str, Motion, str]]) -> Axes:
    """Draw the least distance of any joint to its limit in each cycle; below 0 a limit is broken.

    Parameters
    ----------
    ax
        Where to draw.
    motions
        Label, motion, colour. Joints without limits are not drawn.
    """
    drawn = False
    for (label, motion, colour), marker in zip(motions, "osD^vPX" * len(motions), strict=False):
        least = least_margins(motion)
        if np.isfinite(least).all() and least.max() < 1e6:
            ax.plot(np.arange(1, motion.cycles + 1), least, marker=marker, ms=4, lw=1.4, color=colour, label=label)
            drawn = True
    if drawn:
        low, high = ax.get_ylim()
        ax.set_ylim(min(low, 0.0), high + 0.04 * (high - min(low, 0.0)))
        ax.axhspan(min(low, 0.0), 0, color="#f0f0f0", zorder=0)
        ax.axhline(0, color=INK, lw=0.9)
    else:
        ax.text(0.5, 0.5, "no joint limits", transform=ax.transAxes, ha="center", color=INK)
    ax.set_xlim(0.5, motions[0][1].cycles + 0.5)
    ax.set_xlabel("cycle")
    ax.set_ylabel(f"least distance to a joint limit ({motions[0][1].task.unit})")
    return quiet(ax, whole=True)


def bodies_over_cycles(ax: Axes, motions: Sequence[tuple[str, Motion, str]]) -> Axes:
    """Draw the least distance between bodies in each cycle; at 0 they touch.

    Parameters
    ----------
    ax
        Where to draw.
    motions
        Label, motion, colour.
    """
    for (label, motion, colour), marker in zip(motions, "osD^vPX" * len(motions), strict=False):
        least = _least_in_cycles(motion.coarse.body_distance, motion)
        ax.plot(np.arange(1, motion.cycles + 1), least, marker=marker, ms=4, lw=1.4, color=colour, label=label)
    low, high = ax.get_ylim()
    ax.set_ylim(min(low, 0.0), high + 0.04 * (high - min(low, 0.0)))
    ax.axhspan(min(low, 0.0), 0, color="#f0f0f0", zorder=0)
    ax.axhline(0, color=INK, lw=0.9)
    ax.set_xlim(0.5, motions[0][1].cycles + 0.5)
    ax.set_xlabel("cycle")
    ax.set_ylabel("least distance between bodies (m)")
    return quiet(ax, whole=True)


def least_margins(motion: Motion) -> np.ndarray:
    """The least limit margin of any joint in each cycle: (cycles,)."""
    return _least_in_cycles(motion.limit_margin.min(axis=1), motion)


def _least_in_cycles(values: np.ndarray, motion: Motion) -> np.ndarray:
    steps = (len(values) - 1) // motion.cycles
    return np.array([values[k * steps : (k + 1) * steps + 1].min() for k in range(motion.cycles)])


def cycle_figure(motions: Sequence[tuple[str, Motion, str]], title: str) -> Figure:
    """Make the figure of speeds, limit margins, and distances between bodies where there are any, side by side."""
    from matplotlib.figure import Figure

    bodies = np.isfinite(motions[0][1].coarse.body_distance[0])
    figure = Figure(figsize=(12 if bodies else 10, 4.0), layout="constrained")
    left, right, *third = figure.subplots(1, 3 if bodies else 2)
    for ax in third:
        bodies_over_cycles(ax, motions).set_title("room between bodies", fontsize=9, loc="left")
    speed_over_cycle(left, motions)
    dashed = ", the last dashed" if motions[0][1].cycles > 1 else ""
    left.set_title(f"speed over the first cycle{dashed}", fontsize=9, loc="left")
    margin_over_cycles(right, motions)
    right.set_title("room to the joint limits", fontsize=9, loc="left")
    handles, labels = left.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), frameon=False, fontsize=9)
    figure.suptitle(plain(title), fontsize=10, x=0.01, ha="left")
    return figure
