"""The cycle that a control is for: where it starts, along what, and how fast."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .paths import TaskPath


@dataclass(frozen=True)
class Cycle:
    """One cycle of a closed motion.

    Attributes
    ----------
    start : (n,) array
        Where the joints begin and end, rad or m.
    path : TaskPath
        What the frame follows.
    period : float
        Time of the cycle, s.
    """

    start: NDArray[np.float64]
    path: TaskPath
    period: float
