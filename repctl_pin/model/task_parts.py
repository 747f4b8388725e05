"""Numbers of a task that saved figures and certificates depend on, for their fingerprints."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..arguments import Array
from .joint_chain import joint_chain
from .model import frame_id, frame_placements
from .several_frames import SeveralFrames
from .task import Task

_CHECKS = 4
_DIGITS = 9
"""Decimals of numbers that are computed from a URDF: fewer than rounding can change."""


def check_configurations(task: Task) -> Array:
    """Choose configurations (4, n) at which a changed robot is detected: generic ones."""
    joints = np.arange(1, task.n + 1)
    away = [0.7 * np.sin(joints * (k + 1.3)) for k in range(_CHECKS - 1)]
    return np.array([task.reference, *(task.reference + d for d in away)])


def points_at(task: Task, frames: Sequence[str], Q: ArrayLike) -> Array:
    """Compute the origins of frames of the task's chain at every row of Q: (K, F, 3), m."""
    ids = [frame_id(task.model, name) for name in frames]
    return frame_placements(task.model, ids, task._matrix(Q))[:, :, :3, 3]


def task_parts(task: Task) -> tuple[Any, ...]:
    """Return kind, joint chain and position limits of a task as plain data.

    The chain has all placements and axes from base to frame, with locked joints in place, and the
    map from q to its joints: mimic ratios, and coordinates ψ. For several frames, it is one such
    tuple per frame.
    """
    if isinstance(task, SeveralFrames):
        return tuple(task_parts(part) for part in task.parts)
    chain = joint_chain(task)
    lower, upper, _ = task.joint_limits
    numbers = (chain.R, chain.p, chain.axes, chain.S, chain.offset, lower, upper)
    return (
        str(task.kind),
        chain.revolute,
        task.coordinate_matrix,
        *(rounded(each) for each in numbers),
    )


def rounded(values: ArrayLike) -> Array:
    """Round numbers that are computed from a URDF, so that rounding errors have no effect."""
    return np.round(np.asarray(values, float), _DIGITS)
