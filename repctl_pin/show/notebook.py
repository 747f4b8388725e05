"""Display of results in a notebook."""

from __future__ import annotations

import base64
import html
from dataclasses import dataclass

from matplotlib.figure import Figure

from ..base.arguments import as_int
from ..base.errors import InputError
from ..studies.study_result import Study
from .plots.drift import drift_figure
from .plots.figure_layout import png
from .plots.joints import joints_figure
from .plots.motions import drawn
from .study_files import study_page
from .text import captions
from .text.table import study_table

_DPI = 96
"""Pixels of the page per inch of a figure."""

_TABLE = (
    "margin: 16px 24px; overflow-x: auto; white-space: pre; "
    "font: 12px/1.4 ui-monospace, Menlo, Consolas, monospace"
)


@dataclass(frozen=True)
class _Inline:
    """Display of a study, a figure or a page in a notebook cell, made by :func:`inline`.

    Attributes
    ----------
    html : str
        Self-contained HTML.
    text : str
        Text for programs that show no HTML.
    """

    html: str
    text: str

    def _repr_html_(self) -> str:
        return self.html

    def __repr__(self) -> str:
        return self.text


def inline(shown: Study | Figure | str, *, height: int = 640) -> _Inline:
    """Display a study (animation, table, figures), a figure or a page in a notebook cell.

    Parameters
    ----------
    shown
        Study, matplotlib figure, or HTML of a page.
    height
        Height of the animation or page, pixels.

    Returns
    -------
    _Inline
        Object that a notebook cell shows if it is the last value of the cell; no file is written.

    Raises
    ------
    InputError
        If ``shown`` is none of these.

    Examples
    --------
    >>> from repctl_pin.show.notebook import inline
    >>> inline(rp.animation({"ours": motion}).page)  # in a notebook: the page in its cell
    <page of 0.4 MB>
    """
    height = as_int(height, "height", 1)
    if isinstance(shown, str):
        return _Inline(frame(shown, height), f"<page of {len(shown) / 1e6:.1f} MB>")
    if isinstance(shown, Figure):
        return _Inline(_picture(shown, "Figure"), repr(shown))
    if not isinstance(shown, Study):
        raise InputError(
            f"must be a study, a matplotlib figure or the HTML of a page; "
            f"got {type(shown).__name__}",
            argument="shown",
        )
    page = frame(study_page(shown), height)
    return _Inline(f"{page}\n{table_and_figures(shown)}", study_table(shown))


def table_and_figures(study: Study) -> str:
    """Make the table and two figures of a study as HTML.

    A notebook shows this HTML below the study's animation.
    """
    parts = (
        f'<pre style="{_TABLE}">{html.escape(study_table(study))}</pre>',
        _picture(drift_figure(drawn(study), ""), captions.drift_words(study)),
        _picture(joints_figure(drawn(study), ""), captions.joints_words(study)),
    )
    return "\n".join(parts)


def frame(page: str, height: int = 640) -> str:
    """Make the HTML of an inline frame, ``height`` pixels high, that shows a page given as HTML.

    The page's script runs in a sandbox and cannot access the notebook.
    """
    return (
        f'<iframe srcdoc="{html.escape(page, quote=True)}" sandbox="allow-scripts" '
        'title="Animation" '
        f'style="display: block; width: 100%; height: {int(height)}px; border: 0"></iframe>'
    )


def _picture(figure: Figure, text: str) -> str:
    """Make the HTML of an image that shows a figure, at twice the resolution of the page.

    ``text`` is the alternative text, for readers who cannot see the figure.
    """
    data = base64.b64encode(png(figure, 2 * _DPI)).decode("ascii")
    width = round(figure.get_figwidth() * _DPI)
    return (
        f'<img src="data:image/png;base64,{data}" width="{width}" '
        f'style="max-width: 100%; height: auto" alt="{html.escape(text, quote=True)}">'
    )
