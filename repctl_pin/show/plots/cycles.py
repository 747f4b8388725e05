"""Figures of cycles: joint speed, joint-limit margin and body distance.

The joint-limit margin is the distance of a joint from its nearer limit.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...motion import Motion
from ...motion.timed_motion import TimedMotion
from ..palette import BLUE, INK
from .figure_layout import legend_below, quiet, titled


def _speed_over_cycle(ax: Axes, motions: Sequence[tuple[str, Motion, str]]) -> Axes:
    """Draw the joint speed ‖q̇‖ over the first cycle, and as dashed lines over the last.

    Parameters
    ----------
    ax
        Axes to draw on.
    motions
        Label, motion and colour of each.
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
    ax.set_ylabel(
        f"joint speed ‖q̇‖ ({motions[0][1].task.unit}/s)".replace("rad and m/s", "rad/s and m/s")
    )
    return quiet(ax)


def margin_over_cycles(ax: Axes, motions: Sequence[tuple[str, Motion, str]]) -> Axes:
    """Draw the smallest joint-limit margin in each cycle; below 0 a limit is violated.

    The margin of a joint is its distance, rad or m, from the nearer limit.

    Parameters
    ----------
    ax
        Axes to draw on.
    motions
        Label, motion and colour of each. Motions of joints without limits are not drawn.
    """
    lines = [
        (label, colour, _least_in_cycles(motion.limit_margin.min(axis=1), motion))
        for label, motion, colour in motions
    ]
    lines = [line for line in lines if np.isfinite(line[2]).all() and line[2].max() < 1e6]
    if not lines:
        ax.text(0.5, 0.5, "no joint limits", transform=ax.transAxes, ha="center", color=INK)
    _least_over_cycles(ax, lines, motions[0][1].cycles)
    ax.set_ylabel(f"minimum joint-limit margin ({motions[0][1].task.unit})")
    return quiet(ax, whole=True)


def _bodies_over_cycles(ax: Axes, motions: Sequence[tuple[str, Motion, str]]) -> Axes:
    """Draw the minimum body distance in each cycle; below 0 two bodies collide.

    Parameters
    ----------
    ax
        Axes to draw on.
    motions
        Label, motion and colour of each.
    """
    lines = [
        (label, colour, _least_in_cycles(m.clearance.distances, m)) for label, m, colour in motions
    ]
    _least_over_cycles(ax, lines, motions[0][1].cycles)
    ax.set_ylabel("minimum body distance (m)")
    return quiet(ax, whole=True)


def _least_over_cycles(ax: Axes, lines: Sequence[tuple[str, str, np.ndarray]], cycles: int) -> None:
    """Draw the minimum of a quantity in each cycle; the range below 0, a violation, is grey.

    Each of ``lines`` is a label, a colour and an array (cycles,), such as the minimum body
    distance, m.
    """
    ax.set_xlim(0.5, cycles + 0.5)
    ax.set_xlabel("cycle")
    if not lines:
        return
    for (label, colour, least), marker in zip(lines, "osD^vPX" * len(lines), strict=False):
        ax.plot(
            np.arange(1, cycles + 1), least, marker=marker, ms=4, lw=1.4, color=colour, label=label
        )
    low, high = ax.get_ylim()
    ax.set_ylim(min(low, 0.0), high + 0.04 * (high - min(low, 0.0)))
    ax.axhspan(min(low, 0.0), 0, color="#f0f0f0", zorder=0)
    ax.axhline(0, color=INK, lw=0.9)


def _least_in_cycles(values: np.ndarray, motion: Motion) -> np.ndarray:
    """Find the minimum of values in each cycle of a motion, both ends included: (cycles,).

    ``values`` (cycles · K + 1,) are given at equal steps over the whole motion, K per cycle.
    """
    steps = (len(values) - 1) // motion.cycles
    return np.array([values[k * steps : (k + 1) * steps + 1].min() for k in range(motion.cycles)])


def cycle_figure(motions: Sequence[tuple[str, Motion, str]]) -> Figure:
    """Draw the figure of joint speed, limit margins and, if there are bodies, body distance.

    ``motions`` lists the label, motion and colour of each controller.
    """
    bodies = np.isfinite(motions[0][1].clearance.distance)
    figure = titled(12 if bodies else 10, 4.0, "")
    left, right, *third = figure.subplots(1, 3 if bodies else 2)
    for ax in third:
        _bodies_over_cycles(ax, motions).set_title("body distance", fontsize=9, loc="left")
    _speed_over_cycle(left, motions)
    dashed = ", the last dashed" if motions[0][1].cycles > 1 else ""
    left.set_title(f"speed over the first cycle{dashed}", fontsize=9, loc="left")
    margin_over_cycles(right, motions)
    right.set_title("joint-limit margin", fontsize=9, loc="left")
    return legend_below(figure, left)


def phase_figure(timed: TimedMotion) -> Figure:
    """Draw the figure of joint speed ‖q̇‖ against the length of the joint path, from rest to rest.

    The figure shows where along the path the joints are slow or stop. If the cycles between the
    first and the last are equal, only one of them is drawn.
    """
    figure = Figure(figsize=(6, 3.4), layout="constrained")
    ax = figure.add_subplot()
    ax.plot(timed.length, timed.speed, color=BLUE)
    ax.set_xlabel("length of the joint path")
    ax.set_ylabel("joint speed ‖q̇‖ (per s)")
    ax.set_xlim(0, timed.length[-1])
    ax.set_ylim(0, None)
    quiet(ax)
    return figure
