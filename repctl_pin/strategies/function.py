"""Any function (q, ẋ) → q̇ as a strategy: somebody else's control loop, to be audited."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from ..arguments import Array, vector
from ..arguments import function as wanted_function
from ..errors import InputError
from ..robot.task import Task, own_task


class FunctionStrategy:
    """``q̇ = function(q, ẋ)``: what pink, Drake or a loop of your own would command.

    Parameters
    ----------
    task
        The task it controls; q is in the order of its joints.
    function
        q (n,), ẋ (m,) → q̇ (n,).
    """

    def __init__(self, task: Task, function: Callable[[Array, Array], ArrayLike]) -> None:
        self.task = own_task(task)
        self.function = wanted_function(function, "a strategy", "a function (q, ẋ) → q̇, or have a velocity(q, ẋ)", 2)

    def velocity(self, q: ArrayLike, xdot: ArrayLike) -> Array:
        """Ask the function for q̇ (n,).

        Raises
        ------
        InputError
            If it gives anything but n finite numbers.
        """
        q, xdot = vector(q, self.task.n, "q"), vector(xdot, self.task.m, "ẋ", "m/s and rad/s")
        try:
            qdot = np.asarray(self.function(q, xdot), float)
        except (TypeError, ValueError) as error:
            raise InputError(f"the strategy's function gives no q̇: {error}") from error
        if qdot.shape != (self.task.n,) or not np.isfinite(qdot).all():
            raise InputError(f"the strategy's function must give {self.task.n} finite numbers; it gave {qdot}")
        return qdot
