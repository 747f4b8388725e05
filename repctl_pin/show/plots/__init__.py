"""Figures by matplotlib."""

from ...errors import needed

needed("matplotlib", by="a figure")
