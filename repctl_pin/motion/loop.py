"""Controls that follow a closed path in real time, side by side, as a robot's own loop does: a step
at a time."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..arguments import Array
from ..errors import SingularityError
from ..paths.task_path import TaskPath
from ..strategies import OnLeaves, Strategy

STEP = 0.004
"""Time of a step, s."""
SPEED = 0.15
"""How fast the target leaves the path and comes back, m/s."""
_MOST = 0.1
"""A step that moves a joint by more, rad or m, is not taken: the target is out of reach."""
_FREE = 0.5
"""Time without a refused step after which the way on counts as free, s."""


class Loop:
    """Runs controls round a path, ``q += G(q + G(q) e / 2) e`` a step, e the error to the next
    target.

    A control that has leaves keeps to one. The target may be moved off the path. Where a control
    cannot follow it, the target comes back as far as needed; where that does not help either, all
    go back along the steps they came by.

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
    out_of_reach : bool
        Whether a control could not follow, and the target has not yet come to where it should be.
    cycle : (steps + 1, strategies, n) array
        What each did in an undisturbed first cycle.
    """

    def __init__(
        self, strategies: Sequence[Strategy], path: TaskPath, q0: ArrayLike, *, period: float
    ) -> None:
        self.strategies, self.task = tuple(strategies), strategies[0].task
        self.steps = max(round(period / STEP), 8)
        self.dt = period / self.steps
        self._targets = [path.placement(k / self.steps) for k in range(self.steps)]
        start = self.task.check(q0, "the start")
        self._leaves = [
            control.leaf(start) if isinstance(control, OnLeaves) else None for control in strategies
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
        self.offset, self._at, self._rest = np.zeros(3), 0, 0.0
        self._trail: deque[tuple[list[Array], Array, int]] = deque(maxlen=4 * self.steps)
        self.out_of_reach = False
        self._free = 0  # steps since the last refusal
        self._back, self._stride = 0, 1  # steps still to go back, and how many the next time

    @property
    def before(self) -> Array:
        """Where each control was at this moment of the first cycle: (strategies, n)."""
        return self.cycle[self._at]

    def run(self, seconds: float, offset: ArrayLike = (0.0, 0.0, 0.0)) -> None:
        """Let so much time pass, in whole steps, while the target goes to an offset from the path
        (3,), m."""
        wish = np.asarray(offset, float)
        steps, self._rest = divmod(self._rest + seconds, self.dt)
        for _ in range(int(steps)):
            self._step(wish)

    def _step(self, wish: Array) -> None:
        """Take one step: onward, or with the target where it is, or a little nearer to the path; or
        one step back."""
        if self._back:
            self._return()
            return
        way = wish - self.offset
        onward = self.offset + way * min(
            1.0, SPEED * self.dt / max(float(np.linalg.norm(way)), 1e-12)
        )
        self._free += 1
        if self._free * self.dt > _FREE:
            self._stride = 1
        for offset in (onward, self.offset, 0.99 * self.offset):
            if self._go(offset):
                self.out_of_reach &= not np.array_equal(offset, wish)
                return
            self.out_of_reach, self._free = True, 0
        self._back, self._stride = (
            self._stride,
            2 * self._stride,
        )  # ever further, until there is a way on
        self._return()

    def _return(self) -> None:
        """Go one step back along the trail; where it ends, to the start."""
        self._back -= 1
        if self._trail:
            self.q, self.offset, self._at = self._trail.pop()
        else:
            self._begin(self._start)

    def _go(self, offset: Array) -> bool:
        """Go on to the path's next point and an offset from it; False where a control cannot."""
        ahead = (self._at + 1) % self.steps
        place = self._targets[ahead]
        target = pin.SE3(place.rotation, place.translation + offset)
        found = [q for k in range(len(self.strategies)) if (q := self._next(k, target)) is not None]
        if len(found) < len(self.strategies):
            return False
        self._trail.append((self.q, self.offset, self._at))
        self.q, self.offset, self._at = found, offset, ahead
        return True

    def _next(self, k: int, target: pin.SE3) -> Array | None:
        """Where a control goes from here; None where it cannot."""
        control, q, leaf = self.strategies[k], self.q[k], self._leaves[k]
        try:
            if isinstance(control, OnLeaves):
                new = control.step(
                    control.step(q, target, self.dt, leaf=leaf), target, self.dt, leaf=leaf
                )
            else:
                e = self.task.error(q, target)
                new = q + control.velocity(q + 0.5 * control.velocity(q, e), e)
        except SingularityError:
            return None
        return new if (np.abs(new - q) < _MOST).all() else None
