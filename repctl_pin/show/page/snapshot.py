"""Still figure of motions: the arm as a stick figure at the start and at the end.

The figure replaces the animation on a printed page. Stations are the points (P, 3), m, for which
the view is chosen: the arm's joints and frame, and the path.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from ...model.task import Task
from ...motion import Motion, elbow
from ..palette import INK
from ..plots.figure_layout import plain
from ..text.numbers import counted
from .scene import is_planar

_START = "#9aa4ae"


def bones(task: Task, q: NDArray[np.float64]) -> NDArray[np.float64]:
    """Compute the points of a stick figure of the arm at q (n,): (n + 1, 3), m, base frame.

    The points are the origins of the joints and of the task's frame.
    """
    return np.vstack([task.joint_origins(q), task.positions(q[None])])


def still(ax: Any, motion: Motion, elbow: int, colour: str, *, flat: bool = False) -> Axes:
    """Draw the arm at the start (grey) and at the end of a motion, the path, and the elbow's trace.

    Returns the axes.

    Parameters
    ----------
    ax
        Axes to draw on, three-dimensional unless ``flat``.
    motion
        Motion to draw.
    elbow
        Index, from 0 among the task's joints, of the joint whose trace is drawn.
    colour
        Colour of the arm at the end.
    flat
        True if only x and y are drawn, as for a planar arm.
    """
    task, dims = motion.task, 2 if flat else 3
    every = np.unique(np.linspace(0, len(motion.q) - 1, 40 * motion.cycles + 1).astype(int))
    trace = np.array([task.joint_origins(q)[elbow] for q in motion.q[every]])
    path = motion.path.points(121)
    ax.plot(*path.T[:dims], color=INK, lw=1.0)
    ax.plot(*trace.T[:dims], color=colour, lw=0.9, alpha=0.75)
    for q, shade, width, order in ((motion.q[0], _START, 4.5, 2), (motion.q[-1], colour, 2.4, 3)):
        line = bones(task, q)
        ax.plot(
            *line.T[:dims],
            color=shade,
            lw=width,
            marker="o",
            ms=width + 2.2,
            solid_capstyle="round",
            zorder=order,
        )
    return ax


def still_figure(motions: Sequence[tuple[str, Motion, str]]) -> Figure:
    """Make the still figure of an animation, one panel per motion.

    ``motions`` lists the label, motion and colour of each. An arm that moves in a horizontal plane
    is drawn in two dimensions.
    """
    first = motions[0][1]
    joint = elbow(first.task, first.q[0])
    stations = np.vstack([bones(first.task, first.q[0]), first.path.points(16)])
    flat = is_planar(stations)
    figure = Figure(figsize=(5.0 * len(motions), 4.6), layout="constrained")
    axes: list[Any] = []
    for k, (label, motion, colour) in enumerate(motions, 1):
        ax: Any = figure.add_subplot(1, len(motions), k, projection=None if flat else "3d")
        still(ax, motion, joint, colour, flat=flat)
        after = counted(motion.cycles, "cycle")
        ax.set_title(f"{plain(label)}: start (grey), after {after}", fontsize=10)
        axes.append(ax)
    return viewed(figure, axes, stations, flat)


def viewed(figure: Figure, axes: list[Any], stations: NDArray[np.float64], flat: bool) -> Figure:
    """Label all axes of a figure, and give them the same view and limits; return the figure.

    ``stations`` (P, 3), m, are points of the arm and of the path, from which the view is chosen;
    ``flat`` is True for drawings of x and y only.
    """
    for ax in axes:
        ax.set_xlabel("x (m)")
        ax.set_ylabel("y (m)")
        ax.tick_params(labelsize=7)
        if not flat:
            ax.set_zlabel("z (m)")
            ax.set_proj_type("ortho")
            ax.view_init(elev=19, azim=_azimuth(stations))
    _same_room(axes, flat)
    return figure


def _same_room(axes: list[Any], flat: bool) -> None:
    """Set the same limits on all axes, with one scale for all directions.

    ``flat`` leaves out z. The range of each direction is at least a fifth of the largest range, so
    that tick labels do not overlap.
    """
    names = "xy" if flat else "xyz"
    # (d, axes, 2)
    ends = np.array([[getattr(ax, f"get_{name}lim")() for ax in axes] for name in names])
    low = ends[..., 0].min(axis=1)
    high = ends[..., 1].max(axis=1)
    # a flat motion still needs room for its numbers
    narrow = np.maximum(0.0, 0.2 * (high - low).max() - (high - low))
    low, high = low - narrow / 2, high + narrow / 2
    sizes = high - low
    for name, a, b, size in zip(names, low, high, sizes, strict=True):
        for ax in axes:
            getattr(ax, f"set_{name}lim")(a, b)
            getattr(ax, f"{name}axis").set_major_locator(
                MaxNLocator(max(1, round(min(4, 8 * size / sizes.max()))))
            )
    for ax in axes:
        if flat:
            ax.set_aspect("equal")
        else:
            ax.set_box_aspect(sizes, zoom=1.05)


def _azimuth(stations: NDArray[np.float64]) -> float:
    """Choose the azimuth of the view, degrees: 50° less than that of the direction to the path.

    ``stations`` (P, 3) are points of the arm and, last, of the path. The direction leads from the
    mean of all points to the last point.
    """
    tip = stations[-1]
    middle = stations.mean(axis=0)
    return float(np.degrees(np.arctan2(tip[1] - middle[1], tip[0] - middle[0]))) - 50.0
