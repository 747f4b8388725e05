"""Layout and style of figures: titles, places of the axes, legends, labels; figures as PNG."""

from __future__ import annotations

import io
import textwrap
from typing import Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from ...model.task import Task


def plain(text: str) -> str:
    """Escape a name for matplotlib, which would read text between two $ as a formula."""
    return text.replace("$", r"\$")


def png(figure: Figure, dpi: float = 150, **options: Any) -> bytes:
    """Draw a figure as the bytes of a PNG file; ``options`` are those of ``Figure.savefig``.

    The layout is computed first, so that matplotlib does not draw twice.
    """
    layout = figure.get_layout_engine()
    if layout is not None and "bbox_inches" not in options:
        figure.set_dpi(dpi)
        layout.execute(figure)
        figure.set_layout_engine(None)  # savefig would draw everything twice, first for the layout
    file = io.BytesIO()
    fast = {"compress_level": 4}  # 1 % larger, in two thirds of the time
    figure.savefig(file, format="png", dpi=dpi, pil_kwargs=fast, **options)
    return file.getvalue()


def titled(
    width: float, height: float, title: str, layout: Literal["constrained"] | None = "constrained"
) -> Figure:
    """Make an empty figure of a width and height in inches, with a title at its left.

    ``layout`` is that of matplotlib's ``Figure``; None if the caller places the axes.
    """
    figure = Figure(figsize=(width, height), layout=layout)
    place = {} if layout else {"y": 1 - _PAD / height}  # the layout moves it up
    if layout:  # which makes room for more lines
        title = textwrap.fill(title, int(_LETTERS * width))
    figure.suptitle(plain(title), fontsize=10, x=0.01, ha="left", **place)
    return figure


_LETTERS = 12
"""Letters of a title per inch."""

_PAD = 0.045
"""Space between the contents of a figure and its edge, inches."""


def arrange(
    figure: Figure, axes: NDArray[np.object_], *, top: float, bottom: float, gap: float = 0.0
) -> None:
    """Place a grid of axes in a figure, with space for tick labels and for texts beside the axes.

    The tick labels are to the left of each column. The texts, such as labels at the ends of lines,
    are to the right of the last column. Labels and texts are measured once. matplotlib's
    constrained layout measures each four times, which takes longer than all drawing.

    Parameters
    ----------
    figure : Figure
    axes : (rows, columns) array of Axes
    top, bottom
        Space above the first row, and below the last row, inches.
    gap
        Space between two rows, inches.
    """
    (rows, columns), (width, height) = axes.shape, figure.get_size_inches()
    high = (height - top - bottom - (rows - 1) * gap) / rows
    # the tick labels depend on the height
    figure.subplots_adjust(top=1 - top / height, bottom=bottom / height, hspace=gap / high)
    renderer = FigureCanvasAgg(figure).get_renderer()

    def left_of(ax: Axes) -> float:
        box = ax.yaxis.get_tightbbox(renderer)
        return 0.0 if box is None else float(ax.bbox.x0 - box.x0) / figure.dpi

    lefts = [_PAD + max(map(left_of, column)) for column in axes.T]
    beyond = [
        (note.get_window_extent(renderer).x1 - ax.bbox.x1) / figure.dpi
        for ax in axes[:, -1]
        for note in ax.texts
    ]
    right = _PAD + max([0.0, *beyond])
    wide = max((width - sum(lefts) - right) / columns, 0.2 * width / columns)
    figure.subplots_adjust(
        left=lefts[0] / width,
        right=(sum(lefts) + columns * wide) / width,
        wspace=max(lefts[1:], default=0.0) / wide,
    )


def legend_below(figure: Figure, ax: Axes) -> Figure:
    """Add a legend of the axes below the figure, in one row; return the figure.

    All axes of the figure have the same lines, so one legend serves for all.
    """
    handles, labels = ax.get_legend_handles_labels()
    figure.legend(
        handles, labels, loc="outside lower center", ncols=len(labels), frameon=False, fontsize=9
    )
    return figure


def axis_label(task: Task, joint: int) -> str:
    """Make the label of an axis: a joint's name and its unit, as ``joint4 (rad)``.

    ``joint`` is the joint's index, from 0.
    """
    return f"{plain(task.joint_names[joint])} ({'rad' if task.revolute[joint] else 'm'})"


def quiet(ax: Axes, *, whole: bool = False) -> Axes:
    """Style axes with a light grid and no box at the top and right; return the axes.

    ``whole`` puts ticks of the x axis at integers only, as for a number of cycles.
    """
    if whole:
        ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    ax.spines[["top", "right"]].set_visible(False)
    ax.grid(True, color="#dddddd", lw=0.6)
    ax.set_axisbelow(True)
    return ax
