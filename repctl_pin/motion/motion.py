"""What a strategy did on a closed path: a result that judges itself."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from ..arguments import Array, positive, read_only
from ..paths.task_path import TaskPath
from ..robot.length import arm_length
from ..strategies import Bounded
from ..strategies.control_step import speeds
from .joint_motion import CLOSED as CLOSED
from .joint_motion import JointMotion

ON_PATH = 1e-3
"""The frame is on its path while it is so near, in arm lengths or rad."""


@dataclass(frozen=True, eq=False)
@read_only
class Motion(JointMotion):
    """What a strategy did on a closed path.

    If an arm has both kinds of joints, norms over joints count a radian like a metre.

    Attributes
    ----------
    task, path
        The task, and the path it followed.
    t : (T + 1,) array
        Time, s.
    q, qdot : (T + 1, n) arrays
        Joint positions and velocities, rad or m, and per second.
    cycles, steps : int
        T = cycles · steps.
    drift : (cycles,) array
        ``‖q(after cycle k) − q(0)‖``, k = 1, 2, …, rad (m for sliding joints).
    tracking_error : (T + 1,) array
        Distance of the frame from where it should be, m, in the task's coordinates.
    turning_error : (T + 1,) array
        The same for orientation, rad; 0 if the task has none.
    damping : float
        The largest λ, in J's units, that was used near a singularity; 0 if every step was exact.
    region : Bounded, optional
        Ω, where the control was designed: see :attr:`outside`.

    Examples
    --------
    >>> motion.q.shape, motion.drift.shape
    ((201, 3), (2,))
    >>> bool(motion.tracking_error.max() < 1e-6)  # m
    True
    >>> bool(motion.limit_margin.min() > 0)  # rad
    True
    """

    path: TaskPath
    drift: Array
    tracking_error: Array
    turning_error: Array
    damping: float = 0.0
    region: Bounded | None = None

    def __repr__(self) -> str:
        task, cycles = self.task, "1 cycle" if self.cycles == 1 else f"{self.cycles} cycles"
        drift = " … ".join(
            f"{value:.3g}" for value in dict.fromkeys((self.drift[0], self.drift[-1]))
        )
        return (
            f"<Motion of {task.robot.name} {task.frame}: {self.path.name}, {cycles}, drift {drift}>"
        )

    @property
    def outside(self) -> float | None:
        """Share of the motion that lies outside Ω, where no promise is made; None without an Ω."""
        return None if self.region is None else float(np.mean(self.region.ratio(self.q) > 1 + 1e-9))

    @cached_property
    def path_loss(self) -> tuple[float, float, float] | None:
        """When the frame leaves its path (in cycles), and its largest errors, m and rad; None if it
        never does.

        It is on the path while both errors are small: a thousandth of the arm's length, and of a
        radian."""
        length = arm_length(self.task, self.q[0]) or 1.0
        off = ~((self.tracking_error <= ON_PATH * length) & (self.turning_error <= ON_PATH))
        if not off.any():
            return None
        when = int(np.argmax(off)) / self.steps
        return when, float(self.tracking_error.max()), float(self.turning_error.max())

    def slowed(self, factor: float) -> Motion:
        """Let every cycle take ``factor`` times as long: for controls ``q̇ = G ẋ``, whose joint
        path stays the same."""
        factor = positive(factor, "the factor")
        return replace(self, t=self.t[0] + (self.t - self.t[0]) * factor, qdot=self.qdot / factor)

    def retimed(self, limit: ArrayLike | None = None) -> Motion:
        """Slow the motion down wherever a joint is too fast; the joint path stays the same.

        Scaling ẋ by a positive number scales q̇ of every strategy ``q̇ = G ẋ`` alike. Each step is
        stretched by the largest share of a speed limit that it, or one of its ends, uses; steps
        below the limits keep their time.

        Parameters
        ----------
        velocity_limit : float or (n,) array, optional
            Speeds of the robot's joints, rad/s or m/s; by default the arm's own.

        Returns
        -------
        Motion
            With ``speed_ratio`` at most 1 if the limits are the arm's.

        Raises
        ------
        InputError
            If a limit is not above 0, or has the wrong size.
        """
        task = self.task
        most = speeds(task.joint_limits[2] if limit is None else limit, task.n)
        q, qdot = self.joints(self.q), self.joints(self.qdot)
        at_ends = np.maximum((np.abs(qdot) / most).max(axis=1), 1.0)  # (T + 1,)
        times = np.diff(self.t)
        between = (np.abs(np.diff(q, axis=0)) / times[:, None] / most).max(axis=1)  # (T,)
        stretch = np.maximum(np.maximum(at_ends[1:], at_ends[:-1]), between)
        t = self.t[0] + np.concatenate([[0.0], np.cumsum(times * stretch)])
        return replace(self, t=t, qdot=self.qdot / at_ends[:, None])
