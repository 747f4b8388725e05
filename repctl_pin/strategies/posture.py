"""J⁺ with a posture held in the null space: the usual remedy for drift."""

from __future__ import annotations

from typing import Any

from numpy.typing import ArrayLike

from ..arguments import Array, positive, vector
from ..robot.task import Task
from .pseudoinverse import least_speed, redundant


class PostureControl:
    """``q̇ = J⁺ ẋ + (I − J⁺ J) K (q_p − q)``: track, and pull towards a posture in the null space.

    Cycles close after a while if it starts on the posture. Started elsewhere it first moves there: in a jump with a
    high gain, slowly with a low one.

    Parameters
    ----------
    task
        The task to control.
    posture : (n,) array
        q_p, the posture to hold, rad (m for sliding joints).
    gain : float
        K in 1/s.

    Raises
    ------
    InputError
        If the posture has not n numbers, or the gain is negative.

    Examples
    --------
    >>> hold = rp.PostureControl(task, q0, gain=2.0)  # 1/s
    >>> hold.velocity(q0 + 0.1, [0.0, 0.0]).round(3)  # rad/s: back to the posture, the tool at rest
    array([-0.018,  0.041, -0.041])
    """

    def __init__(self, task: Task, posture: ArrayLike, gain: float = 1.0) -> None:
        self.task, self.posture = redundant(task), vector(posture, task.n, "a posture")
        self.gain = positive(gain, "the gain of a posture", "1/s", zero=True)
        self._quick = least_speed(self.task, lambda q: self.gain * (self.posture - q))

    def velocity(self, q: Array, xdot: Array) -> Array:
        """Choose q̇ (n,) for a task velocity ẋ (m,)."""
        return self._quick(q, xdot)

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.task, self.posture, self.gain)
