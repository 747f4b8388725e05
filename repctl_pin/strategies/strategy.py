"""What a control strategy must offer."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import pinocchio as pin
from numpy.typing import ArrayLike

from ..arguments import Array
from ..robot.task import Task

AN_INVERSE = (
    "an inverse q̇ = G(q) ẋ, such as rp.Pseudoinverse(task) or design.inverse; "
    "rp.CustomInverse(task, function) makes one of a function q → G"
)
"""What to give where an inverse is wanted."""


@runtime_checkable
class Strategy(Protocol):
    """A rule that moves the joints when the task asks for a velocity."""

    @property
    def task(self) -> Task:
        """The task it controls."""

    def velocity(self, q: Array, xdot: Array) -> Array:
        """Choose q̇ (n,) for a task velocity ẋ (m,), rad/s or m/s."""


@runtime_checkable
class Batched(Protocol):
    """What off-line work asks of an inverse: its task, and G at many q."""

    @property
    def task(self) -> Task:
        """The task it controls."""

    def batch(self, Q: Array, J: Array | None = None) -> Array:
        """Evaluate G at every row of Q (K, n): (K, n, m); J (K, m, n) if already at hand."""


class Inverse(Strategy, Batched, Protocol):
    """A strategy of the form ``q̇ = G(q) ẋ`` (3) with ``J G = I``."""

    def __call__(self, q: Array) -> Array:
        """Evaluate G (n, m)."""


@runtime_checkable
class OnLeaves(Strategy, Protocol):
    """A strategy whose motions stay on leaves h(q) = c, and that can be brought back to one."""

    @property
    def damping(self) -> float:
        """λ that the last step with damping used."""

    def leaf(self, q: ArrayLike) -> Array:
        """Evaluate c = h(q): (r,)."""

    def step(
        self,
        q: Array,
        target: pin.SE3,
        dt: float,
        twist: Array | None = None,
        *,
        leaf: Array | None = None,
        gain: float | None = None,
        velocity_limit: ArrayLike | None = None,
        damping: float = 0.0,
    ) -> Array:
        """Take the next q (n,), feeding back the task error and c − h(q)."""
