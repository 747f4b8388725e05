"""Sectors whose range of radius depends on the height: poses, F and V in their enclosures, proofs of
what holds, and certificates that hold for one profile only."""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np
import pytest
from inside import cell_bounds
from kernels import at, kernels
from mutants import BENT
from sectors import sector_of

import repctl_pin as rp

SIDES: dict[str, dict[str, Any]] = {
    "a radius by height": {},
    "an axis task by height": {},
    "position": {"radius": ([0.3, 0.0, 0.1, -0.02, 0.03], [0.5, 0.1, -0.05])},
    "another axis": {"radius": ([0.4, 0, 0, 0, 0, 0, 0, 0, -0.1], [0.5, 0, 0.05, 0, 0, 0, 0.1])},
}
"""Sectors with bent sides, of degree 2 to 8, and of four kinds."""


def bent(name: str, *, reduced: bool = False) -> rp.Sector:
    sector = sector_of(name, **SIDES[name])
    assert sector.profile.degree > 1
    return sector.without(sector.symmetries) if reduced else sector


class Poses:
    """Taylor models in C of a sector's pose and its twists, on boxes of its coordinates."""

    def __init__(self, sector: rp.Sector, library: ctypes.CDLL) -> None:
        q = np.zeros(sector.task.n)
        chart = cell_bounds.Chart(*flat(sector, q))
        self.cell, self.library = sector, library
        self.problem = cell_bounds.CellProof(chart)
