"""Figure of a relabelled recording: its joints before and after, and the level of the leaf.

A session is one run of the recorder, such as a demonstration. A leaf is the set of configurations
F(x; c) that the function of a cell, a box of poses, gives at one level c.
"""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ...base.arguments import Array
from ...model.task import Task
from ...show.palette import BLUE, INK, VERMILLION
from ...show.plots.figure_layout import arrange, axis_label, quiet, titled
from .recording import Recording
from .relabel import Relabeled

_POINTS = 1500
_COLUMNS = 2

_BORDERS = 40
"""Number of borders between sessions from which on none is drawn."""

_TOP, _BOTTOM, _GAP = 0.26, 0.57, 0.13
"""Space above the panels, below them, and between two rows, inches."""


def joints_figure(relabeled: Relabeled) -> Figure:
    """Draw each joint over the frames, recorded and relabelled, and the level c of the leaf.

    The level says where along the self-motion the elbow is; after relabelling, it is constant.
    Dashed lines are joint limits that lie within a panel, and thin lines separate the sessions.
    """
    recording, task = relabeled.recording, relabeled.recording.task
    order, borders = _by_session(recording)
    title = f"{task.robot.name}, {task.frame}: joints of the frames"

    panels = task.n + (relabeled.recorded_leaves is not None)
    rows = -(-panels // _COLUMNS)
    figure = titled(10.0, 0.8 + 1.35 * rows, title, layout=None)
    grid = figure.subplots(rows, _COLUMNS, sharex=True, squeeze=False)
    axes = list(grid.ravel())
    for ax in axes[panels:]:
        ax.set_visible(False)
    before = recording.joints
    for joint, ax in zip(range(task.n), axes, strict=False):
        old = None if before is None else before[order, joint]
        _series(ax, old, relabeled.joints[order, joint], borders)
        _limits(ax, task, joint)
        ax.set_ylabel(axis_label(task, joint), fontsize=8)
    if relabeled.recorded_leaves is not None:
        new = np.where(relabeled.found, relabeled.leaf[0], np.nan)[order]
        _series(axes[panels - 1], relabeled.recorded_leaves[order, 0], new, borders)
        axes[panels - 1].set_ylabel("leaf c (elbow)", fontsize=8)
    for ax in axes[max(0, panels - _COLUMNS) : panels]:
        ax.set_xlabel("frames, by session", fontsize=9)
        ax.set_xticks([])
    lines = axes[0].get_legend_handles_labels()
    arrange(figure, grid, top=_TOP, bottom=_BOTTOM, gap=_GAP)
    figure.legend(*lines, loc="outside lower center", ncols=2, markerscale=5, frameon=False)
    return figure


def _by_session(recording: Recording) -> tuple[NDArray[np.intp], Array]:
    """Choose the frames that are drawn, session by session, and where the sessions change.

    Returns the indices of at most ``_POINTS`` frames, ordered by session, and the borders between
    sessions, as positions in that list: 9.5 is between the tenth and the eleventh frame.
    """
    order = np.argsort(recording.session, kind="stable")
    order = order[np.linspace(0, len(order) - 1, min(_POINTS, len(order))).astype(int)]
    return order, np.flatnonzero(np.diff(recording.session[order])).astype(float) + 0.5


def _limits(ax: Axes, task: Task, joint: int) -> None:
    """Draw the limits of a joint that lie within its panel."""
    low, high = ax.get_ylim()
    for limit in (task.lower[joint], task.upper[joint]):
        if low < limit < high:
            ax.axhline(limit, color=INK, lw=0.9, ls="--")


def _series(ax: Axes, old: Array | None, new: Array, borders: Array) -> None:
    frames = np.arange(len(new))
    if old is not None:
        ax.plot(frames, old, ".", color=VERMILLION, ms=2, label="recorded")
    ax.plot(frames, new, ".", color=BLUE, ms=2, label="relabelled")
    if len(borders) < _BORDERS:  # one line with gaps is drawn sooner than many
        x, y = np.repeat(borders, 3), np.tile([0.0, 1.0, np.nan], len(borders))
        ax.plot(x, y, color="#bbbbbb", lw=0.6, zorder=0, transform=ax.get_xaxis_transform())
    ax.tick_params(labelsize=8)
    quiet(ax)
