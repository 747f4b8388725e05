"""Controls that follow a closed path in real time, side by side, as a robot's own loop does: a step at a time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..arguments import Array
from ..errors import SingularityError
from ..strategies import OnLeaves, Strategy
from .paths import TaskPath

STEP = 0.004
"""Time of a step, s."""
SPEED = 0.15
"""How fast the target leaves the path and comes back, m/s."""
_MOST = 0.1
"""A step that moves a joint by more, rad or m, is not taken: the target is out of reach."""


class Loop:
    """Runs controls round a path, ``q += G(q + G(q) e / 2) e`` a step, e the error to the next target.

    A control that has leaves keeps to one. The target may be moved off the path; where a control cannot follow it, it
    comes back as far as needed.

    Parameters
    ----------
    strategies
        The controls, all of one task.
    path
        The closed path.
    q0 : (n,) array
        Where all begin.
    period
        Time of a cycle, s.

    Attributes
    ----------
    q : list of (n,) arrays
        Where each control has brought the joints.
    offset : (3,) array
        How far the target is off the path, m, base axes.
    cycle : (steps + 1, strategies, n) array
        What each did in an undisturbed first cycle.
    """

    def __init__(self, strategies: Sequence[Strategy], path: TaskPath, q0: ArrayLike, *, period: float) -> None:
        self.strategies, self.task = tuple(strategies), strategies[0].task
        self.steps = max(round(period / STEP), 8)
        self.dt = period / self.steps
        self._targets = [path.placement(k / self.steps) for k in range(self.steps)]
        start = self.task.check(q0, "the start")
        self._leaves = [control.leaf(start) if isinstance(control, OnLeaves) else None for control in strategies]
        self._begin(start)
        first = [list(self.q)]
        for _ in range(self.steps):
            self._step(np.zeros(3))
            first.append(list(self.q))
        self.cycle = np.array(first)
        self._begin(start)

    def _begin(self, start: Array) -> None:
        self.q = [start.copy() for _ in self.strategies]
        self.offset, self._at, self._rest = np.zeros(3), 0, 0.0

    @property
    def before(self) -> Array:
        """Where each control was at this moment of the first cycle: (strategies, n)."""
        return self.cycle[self._at]

    def run(self, seconds: float, offset: ArrayLike = (0.0, 0.0, 0.0)) -> None:
        """Let so much time pass, in whole steps, while the target goes to an offset from the path (3,), m."""
        wish = np.asarray(offset, float)
        steps, self._rest = divmod(self._rest + seconds, self.dt)
        for _ in range(int(steps)):
            self._step(wish)

    def _step(self, wish: Array) -> None:
        """Take one step: onward, or with the target where it is, or a little nearer to the path."""
        way = wish - self.offset
        onward = self.offset + way * min(1.0, SPEED * self.dt / max(float(np.linalg.norm(way)), 1e-12))
        ahead = (self._at + 1) % self.steps
        for offset in (onward, self.offset, 0.99 * self.offset):
            place = self._targets[ahead]
            target = pin.SE3(place.rotation, place.translation + offset)
            found = [self._next(k, target) for k in range(len(self.strategies))]
            if all(q is not None for q in found):
                self.q, self.offset, self._at = [q for q in found if q is not None], offset, ahead
                return
        self.offset = 0.99 * self.offset

    def _next(self, k: int, target: pin.SE3) -> Array | None:
        """Where a control goes from here; None where it cannot."""
        control, q, leaf = self.strategies[k], self.q[k], self._leaves[k]
        try:
            if isinstance(control, OnLeaves):
                new = control.step(control.step(q, target, self.dt, leaf=leaf), target, self.dt, leaf=leaf)
            else:
                e = self.task.error(q, target)
                new = q + control.velocity(q + 0.5 * control.velocity(q, e), e)
        except SingularityError:
            return None
        return new if (np.abs(new - q) < _MOST).all() else None
