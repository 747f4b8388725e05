"""Real-time simulation of controllers on a closed path, one of which moves through a governor."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ...arguments import Array
from ...motion.limits import Limits, presumed_acceleration
from ...motion.loop import Loop
from ...paths.task_path import TaskPath
from ...strategies import Strategy
from ...strategies.repeatable import RepeatableInverse
from .governor import BLOCKED, Governor

_RUN_UP = 0.4
"""Time before the start of the path at which the simulation begins, s; within it, the governor
reaches the speed of the path."""

_ASSUMED_SPEED = 2.0
"""Assumed speed limit, rad/s or m/s, of a joint that has none."""


class GovernedLoop(Loop):
    """Simulation of controllers on a closed path, the last of which moves through a governor.

    A :class:`Governor` follows the target with the last controller, which is a repeatable inverse,
    within the limits of speed and acceleration. The other controllers follow the placement of the
    frame that it reaches.

    Parameters
    ----------
    strategies
        Controllers, all of the same task; the last one is a repeatable inverse.
    path
        Closed path.
    q0 : (n,) array
        Start configuration of all controllers.
    period
        Period, s.
    """

    def __init__(
        self,
        strategies: Sequence[Strategy],
        path: TaskPath,
        q0: ArrayLike,
        *,
        period: float,
    ) -> None:
        task, last = strategies[0].task, strategies[-1]
        assert isinstance(last, RepeatableInverse)
        self._inverse = RepeatableInverse(task, last.potentials)
        known = np.isfinite(task.velocity_limit)
        self._speeds = np.where(known, task.velocity_limit, _ASSUMED_SPEED)
        self._accelerations = presumed_acceleration(task)[0]
        super().__init__(strategies, path, q0, period=period)

    def _begin(self, start: Array) -> None:
        """Begin at rest at a point of the path before its start, and move on to the start."""
        run_up = min(round(_RUN_UP / self.dt), self.steps // 4)
        before = self._inverse.solve(self._targets[-run_up], start)
        super()._begin(before)
        self._governor = Governor(
            self._inverse,
            self.dt,
            Limits(velocity=self._speeds, acceleration=self._accelerations),
        )
        self._governor.start(before)
        self._start, self._at = start, self.steps - run_up
        for _ in range(run_up):
            self._step(np.zeros(3))

    def _advance(self, offset: Array) -> bool:
        """Advance the target for the governor, which the other controllers follow."""
        ahead = (self._at + 1) % self.steps
        place = self._targets[ahead]
        q, status = self._governor.step(
            pin.SE3(place.rotation, place.translation + offset)
        )
        here = self.task.placement(q)
        found = [self._next(k, here) for k in range(len(self.strategies) - 1)]
        kept = [
            old if new is None else new
            for new, old in zip(found, self.q[:-1], strict=True)
        ]
        self.q, self.offset, self._at = [*kept, q], offset, ahead
        self._stopped = status in BLOCKED or any(new is None for new in found)
        return True

    def _step(self, wish: Array) -> None:
        """Take one step; ``out_of_reach`` is True if the governor stops or a controller fails."""
        super()._step(wish)
        self.out_of_reach = self._stopped
