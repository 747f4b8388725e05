"""Maps over two joints: values computed elsewhere, drawn here."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patheffects import withStroke
from numpy.typing import ArrayLike

from ...robot.task import Task
from ..palette import INK
from .motions import axis_label


def joint_map(
    ax: Axes,
    task: Task,
    joints: tuple[int, int],
    x: ArrayLike,
    y: ArrayLike,
    values: ArrayLike,
    *,
    label: str,
    top: float | None = None,
    mark: ArrayLike | None = None,
) -> Axes:
    """Draw values over a grid of two joints, with level lines and a bar that says what they are.

    Parameters
    ----------
    ax
        Where to draw.
    task
        Whose joints they are.
    joints
        Across and upward, counted from 0.
    x, y : (k,) and (l,) arrays
        Values of the joints, rad or m.
    values : (l, k) array
        Rows upward; nan where there is none, which stays blank.
    label
        What is drawn, and its unit.
    top
        Where the colours end; by default at the largest value. They begin at 0, and bright is large.
    mark : (2,) array, optional
        A point to mark by a cross.
    """
    x, y = np.asarray(x, float), np.asarray(y, float)
    shown = np.ma.masked_invalid(np.asarray(values, float))
    shade = ax.pcolormesh(x, y, shown, cmap="viridis", vmin=0.0, vmax=top, shading="nearest", rasterized=True)
    if shown.count() and np.ptp(shown) > 0.1 * (top or np.abs(shown).max()):  # else all lines would read alike
        lines = ax.contour(x, y, shown, levels=6, colors="white", linewidths=0.7, alpha=0.85)
        digits = max(0, 1 - int(np.floor(np.log10(np.ptp(np.array(lines.levels)) / 6))))
        for value in ax.clabel(lines, fmt=lambda v: f"{v:.{digits}f}", fontsize=7):
            value.set_path_effects([withStroke(linewidth=1.6, foreground="#00000088")])
    if mark is not None:
        ax.plot(*np.asarray(mark, float), "+", color=INK, ms=9, mew=1.5)
    ax.set_xlabel(axis_label(task, joints[0]))
    ax.set_ylabel(axis_label(task, joints[1]))
    bar = ax.figure.colorbar(shade, ax=ax, pad=0.02)
    bar.set_label(label, fontsize=9)
    bar.outline.set_visible(False)
    return ax
