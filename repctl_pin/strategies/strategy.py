"""What a control strategy must offer."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..robot.task import Task

Array = NDArray[np.float64]


class Strategy(Protocol):
    """A rule that moves the joints when the task asks for a velocity."""

    @property
    def task(self) -> Task:
        """The task it controls."""
        ...

    def velocity(self, q: Array, xdot: Array) -> Array:
        """Choose q̇ (n,) for a task velocity ẋ (m,), rad/s or m/s."""
        ...


class Inverse(Strategy, Protocol):
    """A strategy of the form ``q̇ = G(q) ẋ`` (3) with ``J G = I``."""

    def __call__(self, q: Array) -> Array:
        """Evaluate G (n, m)."""
        ...

    def batch(self, Q: Array, J: Array | None = None) -> Array:
        """Evaluate G at every row of Q (K, n): (K, n, m); J (K, m, n) if already at hand."""
        ...
