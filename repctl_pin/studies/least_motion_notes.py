"""Notes of a study on joint speed: its excess over the minimum, and what another start saves."""

from __future__ import annotations

import numpy as np

from ..arguments import Array, ratio_in_percent
from ..design import Design
from ..errors import InputError, SingularityError
from ..motion import LeafLock, Motion, follow, least_closed_motion
from ..paths import TaskPath

_POINTS = 32
"""Number of points per cycle of each compared motion."""

_WORTH = 0.05
"""Relative saving in joint speed above which another start is recommended."""


def least_motion_notes(design: Design, path: TaskPath, q0: Array) -> list[str]:
    """Write the notes that compare a design's motion with closed motions of minimum joint speed.

    The minimum is that from the start q0, and that from a free start nearby. The list is empty if
    the design's motion violates a limit, or no closed motion of minimum speed is found.
    """
    lock = LeafLock(4)
    try:
        own = follow(design.inverse, path, q0, cycles=1, steps=_POINTS, integrator=lock)
        if not own.closes or own.path_loss or own.first_violation:
            return []
        least = least_closed_motion(design.task, path, q0, steps=_POINTS, guess=own)
    except (InputError, SingularityError):
        return []
    above = max(own.rms_speed / least.rms_speed - 1, 0.0)
    size = ratio_in_percent(above, 2) if above > 1e-5 else "less than 0.001 %"
    notes = [f"joint speed: {size} above the minimum of closed motions from this start"]
    saved = 1 - _from_anywhere(least) / own.rms_speed
    if saved > _WORTH:
        notes.append(
            f"another elbow position needs {100 * saved:.0f} % less: --best-leaf speed"
        )
    return notes


def _from_anywhere(least: Motion) -> float:
    """Find the minimum joint speed (rms) of closed motions with a free start near a given motion.

    They keep half of its joint-limit margin. Infinite if no such motion is found, or bodies
    collide in it.
    """
    margin = float(least.limit_margin.min()) / 2
    try:
        found = least_closed_motion(
            least.task,
            least.path,
            least.q[0],
            steps=_POINTS,
            free_start=True,
            limit_margin=margin if 0 < margin < np.inf else 0.0,
            guess=least,
        )
    except (InputError, SingularityError):
        return np.inf
    return found.rms_speed if found.body_distance.min() >= 0 else np.inf
