"""J⁺ with a posture held in the null space: what people do today against drift."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from ..robot.task import Task, wanted_task
from .pseudoinverse import least_norm

Array = NDArray[np.float64]


class PostureControl:
    """``q̇ = J⁺ ẋ + (I − J⁺ J) K (q_p − q)``: track, and pull towards a posture where nobody looks.

    Closes a cycle in the limit when it starts on the posture; started off it, it jumps or creeps there.

    Parameters
    ----------
    task
        The task to control.
    posture : (n,) array
        q_p, the posture to hold.
    gain : float
        K in 1/s.
    """

    def __init__(self, task: Task, posture: ArrayLike, gain: float = 1.0) -> None:
        self.task = wanted_task(task)
        self.posture = np.array(posture, dtype=float)
        self.gain = float(gain)
        if self.posture.shape != (task.n,) or not np.isfinite(self.posture).all():
            raise InputError(f"a posture is {task.n} finite numbers, one a joint")
        if not (np.isfinite(self.gain) and self.gain >= 0):
            raise InputError(f"the posture's gain must be 0 or more, not {gain!r}")

    def velocity(self, q: Array, xdot: Array) -> Array:
        """Choose q̇ (n,) for a task velocity ẋ (m,)."""
        J = self.task.jacobian(q)
        pull = self.gain * (self.posture - q)
        return pull + least_norm(J, xdot - J @ pull)
