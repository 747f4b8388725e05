"""Choice of the period of a cycle, such that no joint exceeds its speed limit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ..motion import Motion

_SHARE = 0.9
"""Maximum fraction of a speed limit that a cycle uses, if its period is increased."""


def choose_period(usual: float, motions: Mapping[str, Motion | None]) -> tuple[float, list[str]]:
    """Choose a period for which the first cycle of every motion is within the speed limits.

    A motion that leaves its path in the first cycle is ignored. Returns the period, s, and a list
    of notes: one if the period was increased.

    Parameters
    ----------
    usual
        Period to use, or to increase if necessary, s.
    motions
        Motions at the period ``usual``, by the name of their controller; None for a controller that
        failed.
    """
    first = {
        name: replace(motion, qdot=motion.qdot[: motion.steps + 1])
        for name, motion in motions.items()
        if motion is not None and not (motion.path_loss and motion.path_loss[0] <= 1)
    }
    name = max(first, key=lambda name: first[name].speed_ratio, default=None)
    if name is None or not 1 < first[name].speed_ratio < np.inf:
        return usual, []
    worst = first[name]
    longer = usual * worst.speed_ratio / _SHARE
    digit = 10.0 ** (np.floor(np.log10(longer)) - 1)
    period = float(f"{np.ceil(longer / digit) * digit:.2g}")
    return period, [
        f"period increased to {period:g} s; at {usual:g} s, {worst.fastest_joint} would reach "
        f"{worst.speed_ratio:.2g} times its speed limit ({name})"
    ]
