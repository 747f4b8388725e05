"""Figure of orbits: the curves of motions in joint space, one joint drawn against another.

The orbit of a motion is closed if the motion is.
"""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...motion import Motion
from .figure_layout import axis_label, legend_below, quiet, titled
from .joints import liveliest_joints


def orbit(ax: Axes, motions: Sequence[tuple[str, Motion, str]], across: int, upward: int) -> Axes:
    """Draw the position of one joint against that of another over all cycles.

    The curve of a repeatable motion is closed. A disc marks the end of each motion, and a cross the
    start.

    Parameters
    ----------
    ax
        Axes to draw on.
    motions
        Label, motion and colour of each.
    across, upward
        Indices of the joints on the horizontal and the vertical axis, from 0.
    """
    task = motions[0][1].task
    for label, motion, colour in motions:
        ax.plot(motion.q[:, across], motion.q[:, upward], color=colour, lw=1.0, label=label)
        ax.plot(
            *motion.q[-1, [across, upward]], "o", color=colour, ms=5, mec="white", mew=0.8, zorder=4
        )
    ax.plot(*motions[0][1].q[0, [across, upward]], "k+", ms=9, mew=1.4, zorder=5)
    ax.set_xlabel(axis_label(task, across))
    ax.set_ylabel(axis_label(task, upward))
    ax.margins(0.06)
    return quiet(ax)


def orbits_figure(motions: Sequence[tuple[str, Motion, str]]) -> Figure:
    """Draw the figure of orbits: the three joints that drift most, pair by pair in three panels.

    ``motions`` lists the label, motion and colour of each controller. The orbit of a repeatable
    motion is one closed curve.
    """
    i, j, k = liveliest_joints(motions)
    figure = titled(10, 3.9, "")
    axes = figure.subplots(1, 3)
    for ax, (across, upward) in zip(axes, ((i, j), (i, k), (j, k)), strict=True):
        orbit(ax, motions, across, upward)
    return legend_below(figure, axes[0])
