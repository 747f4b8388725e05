"""Prediction of the cycle in which a drifting joint reaches its limit.

``JointMotion`` is a joint motion over several cycles: q, q̇ (T + 1, n) at times t, without the path
of the frame.
"""

from __future__ import annotations

import numpy as np

from .joint_motion import JointMotion

_MOST_CYCLES = 100
"""Maximum number of further cycles for which it is predicted that a joint leaves its range."""


def leaves_range(motion: JointMotion) -> tuple[int, str] | None:
    """Predict the cycle in which a drifting joint first exceeds its limits.

    Every further cycle is assumed to add the joint displacement of the last cycle.

    Parameters
    ----------
    motion
        The motion so far.

    Returns
    -------
    (int, str) or None
        The cycle, counted from 1, and the joint's name. None if the motion closes, if a joint
        exceeds its limits already, or if none does within another 100 cycles.
    """
    if motion.first_violation is not None or motion.closes:
        return None
    task = motion.task
    last = motion.q[-motion.steps - 1 :]
    step = last[-1] - last[0]  # (n,), per cycle
    margin = np.where(step > 0, task.upper - last.max(axis=0), last.min(axis=0) - task.lower)
    with np.errstate(divide="ignore", invalid="ignore"):
        left = np.where(step != 0, margin / np.abs(step), np.inf)
    joint = int(np.argmin(left))
    if not left[joint] < _MOST_CYCLES:
        return None
    return motion.cycles + int(left[joint]) + 1, task.joint_names[joint]
