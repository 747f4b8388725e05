"""C code of cell functions q = F(x; c), and of their inverses: files of the native library."""

from __future__ import annotations

from ....strategies.repeatable import Bounded, RepeatableInverse
from ...cells.cell import Cell
from ...cells.cell_potentials import CellPotentials
from ...cells.function import InverseFunction
from .text import filled, pasted


def function_code(function: InverseFunction, name: str) -> str:
    """Write the C code of an inverse kinematic function F, after that of its inverse."""
    parts = {
        "library": pasted("function.h", "function.c", "function_lanes.c"),
        "keep": int(function.keep_limits),
    }
    return filled("function.c", name, parts)


def native_files(
    inverse: RepeatableInverse, region: Bounded | None
) -> tuple[list[str], list[str]]:
    """Name the headers and sources of the library for an inverse or a region with a cell."""
    if isinstance(inverse.potentials, CellPotentials) or isinstance(region, Cell):
        return ["chart.h"], ["chart.c"]
    return [], []
