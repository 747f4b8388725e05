"""The turn between two tool axes, which is all that a task of kind ``axis`` asks of the orientation."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def axis_turn(R: Array, goal: Array) -> Array:
    """Measure the turn (2,) about the tool's own x and y that takes its z axis to a goal's by the shortest way, rad.

    Parameters
    ----------
    R, goal : (3, 3) arrays
        The tool's orientation, and the goal's.
    """
    z, aim = R[:, 2], goal[:, 2]
    turn = np.cross(z, aim)
    sine = float(np.linalg.norm(turn))
    angle = np.arctan2(sine, z @ aim)
    if sine < 1e-12:  # parallel: nothing to turn; opposite: any way round will do
        turn, sine = (np.zeros(3), 1.0) if z @ aim > 0 else (R[:, 0], 1.0)
    return (R.T @ turn)[:2] * (angle / sine)
