"""Orbits in joint space: a motion that repeats is a loop, one that drifts is a coil."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from .motions import axis_label, plain, quiet

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ...motion import Motion


def orbit(ax: Axes, motions: Sequence[tuple[str, Motion, str]], across: int, upward: int) -> Axes:
    """Draw one joint against another over all cycles: one view along the other joints' axes.

    Where each motion ends is marked by a disc, the start by a cross.

    Parameters
    ----------
    ax
        Where to draw.
    motions
        Label, motion, colour.
    across, upward
        Joints, counted from 0.
    """
    task = motions[0][1].task
    for label, motion, colour in motions:
        ax.plot(motion.q[:, across], motion.q[:, upward], color=colour, lw=1.0, label=label)
        ax.plot(*motion.q[-1, [across, upward]], "o", color=colour, ms=5, mec="white", mew=0.8, zorder=4)
    ax.plot(*motions[0][1].q[0, [across, upward]], "k+", ms=9, mew=1.4, zorder=5)
    ax.set_xlabel(axis_label(task, across))
    ax.set_ylabel(axis_label(task, upward))
    ax.margins(0.06)
    return quiet(ax)


def liveliest_joints(motions: Sequence[tuple[str, Motion, str]], count: int = 3) -> list[int]:
    """Find the joints whose ends of cycles lie furthest from the start, in the order of the arm."""
    ends = [np.abs(motion.q[motion.steps :: motion.steps] - motion.q[0]).max(axis=0) for _, motion, _ in motions]
    order = np.argsort(-np.max(ends, axis=0), kind="stable")[:count]
    return sorted(int(joint) for joint in order)


def orbits_figure(
    motions: Sequence[tuple[str, Motion, str]], title: str, joints: tuple[int, int, int] | None = None
) -> Figure:
    """Make the figure of orbits: three joints, seen along each of their three axes.

    Parameters
    ----------
    motions
        Label, motion, colour.
    title
        Of the figure.
    joints
        Which three; by default those that drift most.
    """
    from matplotlib.figure import Figure

    i, j, k = joints or liveliest_joints(motions)
    figure = Figure(figsize=(10, 3.9), layout="constrained")
    axes = figure.subplots(1, 3)
    for ax, (across, upward) in zip(axes, ((i, j), (i, k), (j, k)), strict=True):
        orbit(ax, motions, across, upward)
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), frameon=False, fontsize=9)
    figure.suptitle(plain(title), fontsize=10, x=0.01, ha="left")
    return figure
