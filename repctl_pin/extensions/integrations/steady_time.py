"""Time of a :class:`Servo` that never runs backwards, made from a clock that may."""

from __future__ import annotations

import numpy as np


class SteadyTime:
    """Time that never runs backwards, and advances at every tick, whatever the clock does.

    A servo computes one joint command per tick of the control loop. Its time-outs must expire even
    if the system clock is set back, or the clock of a simulation stops or restarts.

    Parameters
    ----------
    dt
        Period of the ticks, s.
    """

    def __init__(self, dt: float) -> None:
        self._dt = dt
        self._clock = self._time = self._last_tick = 0.0

    def at(self, now: float) -> float:
        """Convert a clock reading ``now``, s, to steady time, s: the sum of all forward steps.

        A reading that does not exceed the last one adds nothing.
        """
        step = now - self._clock
        if np.isfinite(step):
            self._clock = now
            self._time += max(step, 0.0)
        return self._time

    def tick(self, now: float) -> float:
        """Compute the steady time, s, of a tick at which the clock reads ``now``, s.

        Since the last tick, steady time has advanced by the forward steps of the clock. If that is
        less than half a period, as when the clock stopped, it advances by a whole period instead.
        """
        if self.at(now) - self._last_tick < self._dt / 2:
            self._time = self._last_tick + self._dt
        self._last_tick = self._time
        return self._time
