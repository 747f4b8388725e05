"""Motion of a strategy on a closed path: drift, errors and other figures.

A strategy is a controller: a map (q, ẋ) → q̇. A repeatable one keeps the arm on a leaf, a set of
configurations with constant potentials h(q). A leaf lock replaces its integration by Newton steps
on the leaf, from point to point of the path. The damping λ of a step limits joint speeds near
singularities. The closing radius is a distance, m and rad, from a start pose or from a path: every
closed path within it is proved to end in the configuration it began in.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from ..base.arguments import Array, per_joint, positive, read_only
from ..base.certificate import ClosingRadius
from ..model.chain_formulas import Placement
from ..model.length import arm_length
from ..model.task import Task
from ..paths.task_path import TaskPath
from ..strategies import Bounded
from .joint_motion import CLOSED as CLOSED
from .joint_motion import JointMotion

ON_PATH = 1e-3
"""Maximum error with which the frame counts as on its path, arm lengths or rad."""


@dataclass(frozen=True, eq=False)
@read_only
class Motion(JointMotion):
    """Motion of a strategy on a closed path, with its drift and its errors.

    On arms with revolute and prismatic joints, norms of q weigh 1 rad and 1 m equally.

    Attributes
    ----------
    task, path
        Task, and path of its frame.
    t : (T + 1,) array
        Time, s.
    q, qdot : (T + 1, n) arrays
        Joint positions and velocities, rad or m, and per second.
    cycles, steps : int
        Number of cycles, and of steps per cycle: T = cycles · steps.
    drift : (cycles,) array
        ``‖q(after cycle k) − q(0)‖``, k = 1, 2, …, rad (m for prismatic joints).
    tracking_error : (T + 1,) array
        Distance of the frame from its point on the path, m; for a task of two coordinates, in its
        plane. For several frames, the norm of their distances.
    turning_error : (T + 1,) array
        Orientation error of the frame, rad; 0 if the task has no orientation.
    damping : float
        Maximum damping λ of the leaf lock's steps near singularities; 0 if every step was exact.
    region : Bounded, optional
        Region Ω of joint space for which the design was made, see :attr:`outside`.
    closing_radius : ClosingRadius, optional
        Closing radius of the design's certificate, ``design.proof.closes``, see
        :attr:`beyond_closing_radius`.

    Examples
    --------
    >>> motion.q.shape, motion.drift.shape
    ((101, 3), (2,))
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
    closing_radius: ClosingRadius | None = None

    def __repr__(self) -> str:
        task = self.task
        cycles = "1 cycle" if self.cycles == 1 else f"{self.cycles} cycles"
        drift = " … ".join(
            f"{value:.3g}" for value in dict.fromkeys((self.drift[0], self.drift[-1]))
        )
        return (
            f"<Motion of {task.robot.name} {task.frame}: {self.path.name}, {cycles}, drift {drift}>"
        )

    @property
    def outside(self) -> float | None:
        """Fraction of the samples outside Ω, where repeatability is not guaranteed; None without Ω.

        Ω is the region of joint space for which the design was made.
        """
        return None if self.region is None else float(np.mean(self.region.ratio(self.q) > 1 + 1e-9))

    @cached_property
    def beyond_closing_radius(self) -> float | None:
        """Fraction of the samples beyond the proved closing radius; None without such a radius.

        A sample is beyond it if the frame's pose is farther than the radius from the start pose,
        or from the path, of the proof. Paths beyond it may close too, but this is not proved.
        """
        closes = self.closing_radius
        if not closes:
            return None
        poses = map(self.task.placements, self.q)
        return float(np.mean([not closes.contains(pose) for pose in poses]))

    @cached_property
    def path_loss(self) -> tuple[float, float, float] | None:
        """Time when the frame first leaves its path, and its maximum errors; None if it does not.

        The result is (time in cycles, tracking error, m, turning error, rad); both errors are
        maxima over the motion. The frame is on its path if its errors are at most 0.001 arm lengths
        and 0.001 rad. The drift of a controller that leaves its path is meaningless.
        """
        length = arm_length(self.task, self.q[0]) or 1.0
        off = ~((self.tracking_error <= ON_PATH * length) & (self.turning_error <= ON_PATH))
        if not off.any():
            return None
        when = int(np.argmax(off)) / self.steps
        return when, float(self.tracking_error.max()), float(self.turning_error.max())

    def slowed(self, factor: float) -> Motion:
        """Return the same joint path with all times multiplied by ``factor``.

        A controller ``q̇ = G ẋ`` makes this motion if it follows the path more slowly.
        """
        factor = positive(factor, "the factor")
        return replace(self, t=self.t[0] + (self.t - self.t[0]) * factor, qdot=self.qdot / factor)

    def retimed(self, limit: ArrayLike | None = None) -> Motion:
        """Return the same joint path, slowed down wherever a joint exceeds its speed limit.

        The ratio of a step is the maximum ratio of a joint's speed to its limit: at both ends, and
        for the mean velocity of the step. A step with a ratio above 1 takes longer by this factor.
        A controller ``q̇ = G ẋ`` makes this motion if ẋ is scaled likewise.

        Parameters
        ----------
        limit : float or (n,) array, optional
            Speed limits of the robot's joints, rad/s or m/s; by default those of the robot.

        Returns
        -------
        Motion
            Motion within the limits; without ``limit``, its ``speed_ratio`` is at most 1.

        Raises
        ------
        InputError
            If a limit is not positive, or has the wrong size.
        """
        task = self.task
        own = task.velocity_limit
        most = per_joint(own if limit is None else limit, task.n, "a speed limit")
        at_ends = np.maximum((np.abs(self.qdot) / most).max(axis=1), 1.0)  # (T + 1,)
        times = np.diff(self.t)
        between = (np.abs(np.diff(self.q, axis=0)) / times[:, None] / most).max(axis=1)  # (T,)
        stretch = np.maximum(np.maximum(at_ends[1:], at_ends[:-1]), between)
        t = self.t[0] + np.concatenate([[0.0], np.cumsum(times * stretch)])
        return replace(self, t=t, qdot=self.qdot / at_ends[:, None])


def motion_along(
    path: TaskPath,
    task: Task,
    t: Array,
    q: Array,
    qdot: Array,
    targets: Sequence[Placement],
    *,
    damping: float = 0.0,
) -> Motion:
    """Create a motion along a path from its samples, and evaluate its drift and its errors.

    ``t`` (T + 1,), ``q`` and ``qdot`` (T + 1, n) are the samples of whole cycles, which have T
    steps. ``targets`` are the placements on the path at the samples of one cycle, both ends
    included; their number gives the steps per cycle. ``damping`` is the maximum damping λ that was
    used.
    """
    steps = len(targets) - 1
    cycles = (len(q) - 1) // steps
    errors = task.errors(q, [*targets[:-1]] * cycles + [targets[-1]])
    linear = task.kind.linear
    return Motion(
        task=task,
        path=path,
        t=t,
        q=q,
        qdot=qdot,
        cycles=cycles,
        steps=steps,
        drift=np.linalg.norm(q[steps::steps] - q[0], axis=1),
        tracking_error=np.linalg.norm(errors[:, linear], axis=1),
        turning_error=np.linalg.norm(errors[:, ~linear], axis=1),
        damping=damping,
    )
