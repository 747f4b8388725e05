"""Figures, drawn with matplotlib."""

from ...errors import needed

needed("matplotlib", by="a figure")
