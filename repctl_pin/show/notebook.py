"""A page inside a notebook's cell."""

from __future__ import annotations

import html
from dataclasses import dataclass
from typing import TYPE_CHECKING

from .study_files import study_page

if TYPE_CHECKING:
    from ..studies import Study


@dataclass(frozen=True)
class Inline:
    """A page that a notebook shows in its cell. Make it with :func:`inline`.

    Attributes
    ----------
    page : str
        The page's HTML.
    height : int
        Of the cell, pixels.
    """

    page: str
    height: int = 640

    def _repr_html_(self) -> str:
        return (
            f'<iframe srcdoc="{html.escape(self.page, quote=True)}" title="Animation" '
            f'style="width: 100%; height: {int(self.height)}px; border: 0"></iframe>'
        )

    def __repr__(self) -> str:
        return f"Inline(a page of {len(self.page) / 1e6:.1f} MB)"


def inline(shown: Study | str, *, height: int = 640) -> Inline:
    """Show a study's animation, or any page of this package, in a notebook's cell; nothing is written.

    Parameters
    ----------
    shown
        A study, or a page's HTML.
    height
        Of the cell, pixels.
    """
    return Inline(shown if isinstance(shown, str) else study_page(shown), height)
