"""Figures by matplotlib."""

from ...base.errors import needed

needed("matplotlib", by="a figure")
