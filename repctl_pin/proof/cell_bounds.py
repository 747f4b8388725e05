"""Bounds on the margins of a cell's inverse kinematic function F over boxes of poses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array, read_only


@dataclass(frozen=True, eq=False)
@read_only
class CellBounds:
    """Bounds on the margins of F over K boxes of poses.

    Attributes
    ----------
    leaf_margin, sigma_min, limit_margin : (K,) arrays
        Lower bounds on each box of the leaf margin ``σ_min(Nᵀ n̂_ref)``, of σ_min(J), and of the
        distance to the joint limits, rad or m; 0, 0 and −inf where F was not shown to exist.
    away : (K, n) array
        Approximate distance of F from q_ref at the centre of each box, rad or m.
    split : (K,) array of int
        Index of the coordinate along which to halve each box.
    """

    leaf_margin: Array
    sigma_min: Array
    limit_margin: Array
    away: Array
    split: NDArray[np.int32]
