"""The pseudoinverse J⁺ with a posture task in its null space.

J (m, n) is the Jacobian of the task, J⁺ its pseudoinverse, and ẋ (m,) the task velocity. A posture
is the configuration to which the posture task pulls the joints, without moving the frame.
"""

from __future__ import annotations

from functools import partial

from numpy.typing import ArrayLike

from ..base.arguments import Array, positive, vector
from ..base.threads import PerThread
from ..model.task import Task
from .pseudoinverse import least_speed, redundant
from .step_arguments import as_velocity_arguments
from .strategy import described


class PostureControl:
    """Pseudoinverse with null-space attraction to a posture.

    ``q̇ = J⁺ ẋ + (I − J⁺ J) K (q_p − q)``. From a start at the posture, the motion converges to a
    closed cycle. From any other start, the arm first moves to the posture: abruptly with a high
    gain, slowly with a low one.

    Parameters
    ----------
    task
        The task to control.
    posture : (n,) array
        Posture q_p, rad (m for prismatic joints).
    gain : float
        Gain K, 1/s.

    Raises
    ------
    InputError
        If the posture is not n finite numbers, or the gain is negative.

    Examples
    --------
    >>> hold = rp.PostureControl(task, q0, gain=2.0)  # 1/s
    >>> hold.velocity(q0 + 0.1, [0.0, 0.0]).round(3)  # rad/s: to the posture, with the tool at rest
    array([-0.018,  0.041, -0.041])
    """

    def __init__(self, task: Task, posture: ArrayLike, gain: float = 1.0) -> None:
        self.task, self.posture = redundant(task), vector(posture, task.n, "a posture")
        self.gain = positive(gain, "the gain of a posture", "1/s", zero=True)
        self._quick = PerThread(partial(least_speed, self.task, self.posture, self.gain))

    def __repr__(self) -> str:
        return described(self, self.task, f"gain {self.gain:g} 1/s")

    def velocity(self, q: ArrayLike, xdot: ArrayLike) -> Array:
        """Compute q̇ (n,), with attraction to the posture, for a task velocity ẋ (m,)."""
        n, m = self.task.n, self.task.m
        return self._quick.own(*as_velocity_arguments(q, xdot, n, m))
