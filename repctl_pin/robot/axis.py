"""The turn between two tool axes, which is all that a task of kind ``axis`` asks of the orientation."""

from __future__ import annotations

from math import atan2, hypot, pi

import numpy as np

from ..arguments import Array


def axis_turn(R: Array, goal: Array) -> Array:
    """Measure the turn (2,) about the tool's own x and y that takes its z axis to a goal's by the shortest way, rad.

    Parameters
    ----------
    R, goal : (3, 3) arrays
        The tool's orientation, and the goal's.
    """
    x, y, z = R.T.dot(goal[:, 2]).tolist()  # the goal's axis as the tool sees it
    sine = hypot(x, y)
    if sine < 1e-12:  # parallel: nothing to turn; opposite: any way round will do
        return np.array([0.0 if z > 0 else pi, 0.0])
    ratio = atan2(sine, z) / sine
    return np.array([-y * ratio, x * ratio])
