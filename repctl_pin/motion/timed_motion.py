"""Motion from rest to rest over time, within limits, as :func:`timed` returns it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..base.arguments import Array, as_int, read_only
from ..base.errors import InputError
from .joint_motion import JointMotion


@dataclass(frozen=True, eq=False)
@read_only
class TimedMotion:
    """Positions of a robot's joints over time, from rest to rest, at even time steps.

    A robot can execute it directly; a motion of :func:`follow`, in contrast, starts at the speed of
    its path.

    Attributes
    ----------
    joints : tuple of str
        Names of the joints.
    t : (T,) array
        Times of the T samples, s, from 0. The first samples lie shortly before the motion and the
        last ones shortly after it, at rest.
    q, qdot, qddot : (T, n) arrays
        Positions, rad or m, velocities and accelerations, per s and s². Velocities are central
        differences over ±h, and accelerations over ±2 h, because the q̈ of a time-optimal motion
        jumps. h is 1 ms, or the time between two samples if that is shorter.
    starts : (cycles + 1,) array
        Times at which the cycles begin and the last one ends, s.
    length, speed : (K,) arrays
        Phase-plane profile: length of the joint path from the start, rad or m, and its rate, per s,
        at K points. If the cycles between the first and the last are equal, only one of them is
        included.
    velocity, acceleration, jerk : (n,) arrays
        Limits of the joints, rad/s, rad/s² and rad/s³ (m for prismatic joints); jerk is None if it
        is not limited.
    stops : int
        Number of times that the arm rests within a cycle, not counting its start: at corners of the
        joint path, and during pauses.
    motion : Motion, optional
        The motion that was timed; None in a result of :func:`approach`.
    trajectory
        The timed motion as a function of time: object whose method ``derivatives`` gives q and its
        first three derivatives, exactly, at any times. :class:`Run`, which executes a timed motion
        at a speed that the user may change, requires it.

    Examples
    --------
    >>> timed = rp.timed(motion, rp.Limits(acceleration=5.0))
    >>> timed.q.shape == timed.qdot.shape == (len(timed.t), 3)
    True
    >>> bool(np.abs(timed.qdot[[0, -1]]).max() < 0.02)  # rad/s: from rest to rest
    True
    """

    joints: tuple[str, ...]
    t: Array
    q: Array
    qdot: Array
    qddot: Array
    starts: Array
    length: Array
    speed: Array
    velocity: Array
    acceleration: Array
    stops: int
    motion: JointMotion | None = None
    jerk: Array | None = None
    trajectory: Any = field(default=None, repr=False, compare=False)

    def __repr__(self) -> str:
        many = f"{len(self.joints)} joint{'s' if len(self.joints) > 1 else ''}"
        samples = f"{len(self.t):,} samples"
        return f"<TimedMotion of {many}: {self.duration:.4g} s from rest to rest, {samples}>"

    @property
    def duration(self) -> float:
        """Time from the beginning of the first cycle to the end of the last one, s."""
        return float(self.starts[-1] - self.starts[0])

    @property
    def cycle_time(self) -> float:
        """Duration of the second cycle, s, which is a steady cycle.

        With fewer than three cycles, the result is the mean duration of a cycle. The first and the
        last cycle take longer, because they begin or end at rest.
        """
        times = np.diff(self.starts)
        return float(times[1] if len(times) > 2 else times.mean())

    @property
    def _is_its_motion(self) -> bool:
        """True if ``motion`` has the same samples as this motion, and so the same violations."""
        return False

    @property
    def _shortest_part(self) -> tuple[float, str]:
        """Duration, s, of the shortest part that a file must resolve, and the part's name.

        Here, the part is a cycle. In the subclass for motions between poses, it is the shortest
        motion from one rest to the next. The name, such as "cycle", is used in messages.
        """
        return self.cycle_time, "cycle"

    def cycle(self, k: int) -> tuple[Array, Array, Array, Array]:
        """Return the samples of cycle k, counted from 0: (t, q, q̇, q̈).

        The first index of all four arrays is the sample. t is the time from the cycle's start, s.
        """
        if as_int(k, "k") >= len(self.starts) - 1:
            raise InputError(
                f"there is no cycle {k}; this motion has {len(self.starts) - 1} cycles, "
                "counted from 0"
            )
        rows = (self.t >= self.starts[k] - 1e-9) & (self.t < self.starts[k + 1] - 1e-9)
        return (self.t[rows] - self.starts[k], self.q[rows], self.qdot[rows], self.qddot[rows])
