"""Bounds of a cell's function over boxes of poses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array, read_only
from .leaf_margin_bounds import Bounds


@dataclass(frozen=True, eq=False)
@read_only
class CellBounds:
    """Bounds for K boxes of poses.

    Attributes
    ----------
    leaf : Bounds
        Lower bound of ``σ_min(Nᵀ n̂_ref)``.
    limit_margin, center_limit : (K,) arrays
        A lower bound on the box, −inf where F was not shown to exist, and the value at the centre.
    found : (K,) array of bool
        Whether there is a solution at the centre.
    """

    leaf: Bounds
    limit_margin: Array
    center_limit: Array
    found: NDArray[np.bool_]

    def __repr__(self) -> str:
        return f"<CellBounds of {len(self.limit_margin)} boxes>"
