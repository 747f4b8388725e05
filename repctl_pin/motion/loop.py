"""Stepwise real-time simulation of controllers on a closed path."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..arguments import Array
from ..errors import SingularityError
from ..paths.task_path import TaskPath
from ..strategies import RepeatableInverse, Strategy

STEP = 0.004
"""Time step, s."""
_SPEED = 0.15
"""Speed at which the target leaves the path and returns, m/s."""
_MOST = 0.1
"""Joint motion per step, rad or m, from which the target counts as out of reach."""
_FREE = 0.5
"""Time without a failed step after which the target counts as reachable again, s."""


class Loop:
    """Simulation of controllers on a closed path.

    Each step is ``q += G(q + G(q) e / 2) e``, e the error to the next target.

    A repeatable controller stays on its leaf. The target can be moved away from the path. If a
    controller cannot follow it, the target moves back as far as needed; if that fails, all
    controllers retrace their last steps.

    Parameters
    ----------
    strategies
        Controllers, all of the same task.
    path
        Closed path.
    q0 : (n,) array
        Start configuration of all controllers.
    period
        Period, s.

    Attributes
    ----------
    q : list of (n,) arrays
        Current configuration of each controller.
    offset : (3,) array
        Offset of the target from the path, m, base axes.
    out_of_reach : bool
        True while a controller could not follow the target and the target is not at its goal.
    cycle : (steps + 1, strategies, n) array
        Configurations of each controller in an undisturbed first cycle.
    """

    tick = STEP

    def __init__(
        self,
        strategies: Sequence[Strategy],
        path: TaskPath,
        q0: ArrayLike,
        *,
        period: float,
    ) -> None:
        self.strategies = tuple(strategies)
        self.task = strategies[0].task
        self.steps = max(round(period / self.tick), 8)
        self.dt = period / self.steps
        self._targets = [path.placement(k / self.steps) for k in range(self.steps)]
        start = self.task.check(q0, "the start")
        self._leaves = [
            control.leaf(start) if isinstance(control, RepeatableInverse) else None
            for control in strategies
        ]
        self._begin(start)
        first = [list(self.q)]
        for _ in range(self.steps):
            self._step(np.zeros(3))
            first.append(list(self.q))
        self.cycle = np.array(first)
        self._begin(start)

    def _begin(self, start: Array) -> None:
        self._start = start
        self.q = [start.copy() for _ in self.strategies]
        self.offset = np.zeros(3)
        self._at = 0
        self._rest = 0.0
        self._trail: deque[tuple[list[Array], Array, int]] = deque(
            maxlen=4 * self.steps
        )
        self.out_of_reach = False
        self._free = 0  # steps since the last failed step
        self._back, self._stride = (
            0,
            1,
        )  # steps left to retrace, and the number for the next failure

    @property
    def before(self) -> Array:
        """Configurations of the controllers at this point of the first cycle: (strategies, n)."""
        return self.cycle[self._at]

    @property
    def phase(self) -> float:
        """Position of the target on the path, as a fraction of a cycle."""
        return self._at / self.steps

    @property
    def path_point(self) -> Array:
        """Position of the target without its offset: (3,), m."""
        return np.array(self._targets[self._at].translation)

    def run(self, seconds: float, offset: ArrayLike = (0.0, 0.0, 0.0)) -> None:
        """Advance the simulation by a time in s, in whole steps.

        Meanwhile the target moves to an offset (3,) from the path, m.
        """
        wish = np.asarray(offset, float)
        steps, self._rest = divmod(self._rest + seconds, self.dt)
        for _ in range(int(steps)):
            self._step(wish)

    def _step(self, wish: Array) -> None:
        """Take one step, with the target moved on, held or moved back; else retrace a step."""
        if self._back:
            self._step_back()
            return
        way = wish - self.offset
        onward = self.offset + way * min(
            1.0, _SPEED * self.dt / max(float(np.linalg.norm(way)), 1e-12)
        )
        self._free += 1
        if self._free * self.dt > _FREE:
            self._stride = 1
        for offset in (onward, self.offset, 0.99 * self.offset):
            if self._advance(offset):
                self.out_of_reach &= not np.array_equal(offset, wish)
                return
            self.out_of_reach, self._free = True, 0
        self._back = self._stride
        self._stride *= 2  # retrace further after each failure
        self._step_back()

    def _step_back(self) -> None:
        """Retrace one step; if no steps are stored, restart at the start."""
        self._back -= 1
        if self._trail:
            self.q, self.offset, self._at = self._trail.pop()
        else:
            self._begin(self._start)

    def _advance(self, offset: Array) -> bool:
        """Advance to the path's next point plus an offset; False if a controller fails."""
        ahead = (self._at + 1) % self.steps
        place = self._targets[ahead]
        target = pin.SE3(place.rotation, place.translation + offset)
        found = [
            q
            for k in range(len(self.strategies))
            if (q := self._next(k, target)) is not None
        ]
        if len(found) < len(self.strategies):
            return False
        self._trail.append((self.q, self.offset, self._at))
        self.q = found
        self.offset = offset
        self._at = ahead
        return True

    def _next(self, k: int, target: pin.SE3) -> Array | None:
        """Compute the next configuration of controller k; None if the controller fails."""
        control = self.strategies[k]
        q = self.q[k]
        leaf = self._leaves[k]
        try:
            if isinstance(control, RepeatableInverse):
                new = control.step(
                    control.step(q, target, self.dt, leaf=leaf),
                    target,
                    self.dt,
                    leaf=leaf,
                )
            else:
                e = self.task.error(q, target)
                new = q + control.velocity(q + 0.5 * control.velocity(q, e), e)
        except SingularityError:
            return None
        return new if (np.abs(new - q) < _MOST).all() else None
