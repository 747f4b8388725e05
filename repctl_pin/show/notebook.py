"""Results inside a notebook's cell."""

from __future__ import annotations

import base64
import html
from dataclasses import dataclass

from matplotlib.figure import Figure

from ..arguments import as_int
from ..errors import InputError
from ..studies import Study
from .plots.motions import drawn, drift_figure, joints_figure, png
from .study_files import study_page
from .text import captions
from .text.table import study_table

DPI = 96
"""Pixels of the page to an inch of a figure."""

_TABLE = (
    "margin: 16px 24px; overflow-x: auto; font: 12px/1.4 ui-monospace, Menlo, Consolas, monospace"
)


@dataclass(frozen=True)
class Inline:
    """What a notebook shows in its cell. Make it with :func:`inline`.

    Attributes
    ----------
    html : str
        For a notebook; it holds all it needs.
    text : str
        Where only text is shown.
    """

    html: str
    text: str

    def _repr_html_(self) -> str:
        return self.html

    def __repr__(self) -> str:
        return self.text


def inline(shown: Study | Figure | str, *, height: int = 640) -> Inline:
    """Show in a notebook's cell what ``repctl study`` would print and write; no file is written.

    Parameters
    ----------
    shown
        A study: its animation, its table and its figures. Or a figure, or a page's HTML.
    height
        Of the animation or page, pixels.

    Returns
    -------
    Inline
        What the notebook shows.

    Raises
    ------
    InputError
        If it is none of these.

    Examples
    --------
    >>> from repctl_pin.show.notebook import inline
    >>> inline(rp.animation({"ours": motion}).page)  # in a notebook: the page in its cell
    <page of 0.4 MB>
    """
    height = as_int(height, "height", 1)
    if isinstance(shown, str):
        return Inline(frame(shown, height), f"<page of {len(shown) / 1e6:.1f} MB>")
    if isinstance(shown, Figure):
        return Inline(_picture(shown, "Figure"), repr(shown))
    if not isinstance(shown, Study):
        raise InputError(
            f"a cell shows a study, a figure or a page's HTML; got {type(shown).__name__}"
        )
    text = study_table(shown)
    parts = (
        frame(study_page(shown), height),
        f'<pre style="{_TABLE}">{html.escape(text)}</pre>',
        _picture(drift_figure(drawn(shown), ""), captions.drift_words(shown)),
        _picture(joints_figure(drawn(shown), ""), captions.joints_words(shown)),
    )
    return Inline("\n".join(parts), text)


def frame(page: str, height: int = 640) -> str:
    """Write a page inside the cell: its script runs, but cannot reach the notebook."""
    return (
        f'<iframe srcdoc="{html.escape(page, quote=True)}" sandbox="allow-scripts" title="Animation" '
        f'style="display: block; width: 100%; height: {int(height)}px; border: 0"></iframe>'
    )


def _picture(figure: Figure, text: str) -> str:
    """A figure inside the cell, sharp on any screen, with the words for who cannot see it."""
    data = base64.b64encode(png(figure, 2 * DPI)).decode("ascii")
    width = round(figure.get_figwidth() * DPI)
    return (
        f'<img src="data:image/png;base64,{data}" width="{width}" style="max-width: 100%; height: auto" '
        f'alt="{html.escape(text, quote=True)}">'
    )
