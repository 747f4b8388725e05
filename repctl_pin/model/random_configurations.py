"""Random configurations within the joint limits."""

from __future__ import annotations

import numpy as np

from ..arguments import Array
from .task import Task


def random_configurations(task: Task, count: int, rng: np.random.Generator) -> Array:
    """Draw configurations (count, n), uniform between the joint limits.

    A side of a joint without a limit is taken π rad (m) from the reference configuration.
    """
    low = np.where(np.isfinite(task.lower), task.lower, task.reference - np.pi)
    high = np.where(np.isfinite(task.upper), task.upper, task.reference + np.pi)
    return low + (high - low) * rng.random((count, task.n))
