"""Timed motion through poses of a cell, ``q(t) = F(x(t))``, from rest to rest, within limits.

A cell is a box of poses, and F its function, which gives one configuration q for each pose x. A
part of the motion is the lines from one rest to the next, and a segment is that part with its
times. A limit margin is the smallest distance of a joint from its limits. Letters: P poses, T
samples, n joints.

``ToolFunction`` is the inverse kinematic function of a tool, made from that of the frame that
carries it. ``JointLimits`` are maximum joint speeds and accelerations (n,) and, if given, torques
and jerks, as numbers. ``Segment`` is a smooth part of a joint path between two stops, with its
speed profile ṡ(s). ``Part`` is a part of a motion between two rests: one line, or several with
blends.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from ...base.arguments import Array, as_numbers, positive, progress_option, read_only, require_type
from ...base.errors import InputError
from ...base.progress import reporter
from ...model.chain_formulas import Placement, as_placements
from ...model.task import Task
from ...motion.joint_motion import JointMotion
from ...motion.limits import JointLimits, Limits, joint_limits
from ...motion.timed_motion import TimedMotion
from ..cells.function import InverseFunction
from ..cells.geometry.cell_arguments import stacked
from ..cells.targets import as_poses, homogeneous
from ..cells.tool_function import ToolFunction
from ..timing.speed_profile import Course, Segment, require_possible, require_samples
from .joint_curves import Part, parts_of
from .lines import Function


@dataclass(frozen=True, eq=False, kw_only=True)
@read_only
class MotionBetween(TimedMotion):
    """Motion through poses of a cell, from rest to rest: result of :func:`motion_between`.

    It is a :class:`TimedMotion`: :func:`write_motion` writes it, :class:`Run` runs it with a feed
    override. The first and the last sample are at rest, and the derivatives are exact. ``motion``
    has the configurations, with limit margins and body distances.

    Attributes
    ----------
    t : (T,) array
        Time, s, from 0.
    q, qdot, qddot : (T, n) arrays
        Positions, velocities and accelerations: rad or m, per s and per s².
    starts : (2,) array
        Times of the start and the end of the motion, s.
    length, speed : (T,) arrays
        Length of the joint path from the start to each sample, rad or m, and its rate, rad/s or
        m/s.
    velocity, acceleration, jerk : (n,) arrays
        The limits, rad/s, rad/s² and rad/s³ (m for prismatic joints); jerk is None if not limited.
    poses : (P, 4, 4) array
        The poses, homogeneous matrices with positions in m.
    lines : tuple of str
        Kinds of the P − 1 lines from each pose to the next: ``tool`` for the straight line of the
        tool, ``cell`` for the straight line in the cell's coordinates.
    times : (P,) array
        Time at each pose, s; for a blended pose, the time at the middle of the blend.
    rests : tuple of int
        Indices, from 0, of the poses at which the arm is at rest. The sample there equals F of the
        pose, to the last bit.

    Examples
    --------
    >>> F = found.function
    >>> poses = [F.cell.at(u) for u in ([0.0, 0.0], [0.9, 0.0], [0.5, -0.9])]
    >>> moved = rp.motion_between(F, poses, rp.Limits(acceleration=5.0))  # rad/s²
    >>> moved.rests, moved.lines
    ((0, 1, 2), ('tool', 'tool'))
    >>> bool((moved.q[-1] == F(poses[-1])).all())
    True
    """

    poses: Array
    lines: tuple[str, ...]
    times: Array
    rests: tuple[int, ...]

    def __repr__(self) -> str:
        return (
            f"<MotionBetween {len(self.poses)} poses: {self.duration:.4g} s, "
            f"{len(self.rests)} at rest, {len(self.t):,} samples>"
        )

    @property
    def _is_its_motion(self) -> bool:
        return True

    @property
    def _shortest_part(self) -> tuple[float, str]:
        # before its rounding to whole samples
        part = min(segment.t[-1] for segment in self.trajectory.segments)
        return float(part), "motion between two rests"

    def at(self, t: ArrayLike) -> Array:
        """Evaluate the configuration (n,) at a time, s, or the configurations (T, n) at times (T,).

        Before the start and after the end, the arm is at rest.
        """
        times = as_numbers(t)
        if times is None or times.ndim > 1 or not np.isfinite(times).all():
            raise InputError("t must be a finite number, s, or an array (T,) of finite numbers")
        q = self.trajectory.positions(np.atleast_1d(times))
        return q if times.ndim else q[0]


def motion_between(
    F: InverseFunction | ToolFunction,
    poses: Sequence[Placement] | ArrayLike,
    limits: Limits,
    *,
    blend: float = 0.0,
    rate: float = 1000.0,
    progress: bool | Callable[[str, float], None] = False,
) -> MotionBetween:
    """Time a motion through poses of a cell, as quickly as the limits allow.

    A cell is a box of poses, or a sector around the base, whose function F gives one configuration
    per pose. The joints are ``q(t) = F(x(t))``: at every pose, the configuration is that of F,
    whatever the order of the poses. Between two poses, the tool moves on a straight line and turns
    about one axis. If that line would leave the cell, the tool instead moves on a straight line in
    the cell's coordinates, which is always inside.

    Parameters
    ----------
    F
        Function of a cell or sector: ``found.function``, with ``found`` the design of a cell, or
        ``found.function.with_tool(…)``.
    poses : list of placements, or (P, 4, 4) or (P, 7) array
        Two poses or more: placements, homogeneous matrices, or rows x, y, z, qx, qy, qz, qw, with
        positions in m.
    limits
        Limits of acceleration and, if given, of speed, jerk, torque and the tool's speed.
    blend
        Radius, m, of rounded corners, as for :func:`waypoints`: a blend begins and ends where an
        arc of this radius would. At a pose that can be blended, the tool cuts the corner without a
        rest. The arm rests at the other poses; with 0, it rests at all poses.
    rate
        Samples per second, Hz. The time between two rests is a whole number of samples.
    progress
        True for a progress bar on stderr, or a callback (step: str, fraction: float).

    Returns
    -------
    MotionBetween

    Raises
    ------
    InputError
        If there are fewer than two poses, a pose equals the preceding pose, F has no configuration
        at a pose or in between, or the limits do not fit the robot. The message names the pose by
        its number, counted from 0.

    Examples
    --------
    >>> F = found.function
    >>> poses = [F.cell.at(u) for u in ([-0.9, 0.0], [0.9, 0.5])]
    >>> rp.motion_between(F, poses, rp.Limits(acceleration=5.0, jerk=100.0)).lines
    ('tool',)
    """
    progress = progress_option(progress)
    if not isinstance(F, ToolFunction):
        what = "a function of a cell, such as design.function"
        require_type(F, InverseFunction, "F", what)
    X = homogeneous(*_poses(F.task, poses))
    names = [f"pose {k}" for k in range(len(X))]
    return between(F, X, limits, names, blend=blend, rate=rate, progress=progress)


def between(
    F: Function,
    X: Array,
    limits: Limits,
    names: Sequence[str],
    *,
    blend: float,
    rate: float,
    progress: bool | Callable[[str, float], None],
) -> MotionBetween:
    """Time a motion of the arm, with the joints F(x), through poses X (P, 4, 4) of the tool.

    Error messages name the poses by the P ``names``, such as "pose 3" or "line 7" of a file. Each
    part between two rests is timed separately, and takes a whole number of samples. ``blend`` is
    the radius of rounded corners, m, and ``rate`` the samples per second.
    """
    kept = joint_limits(F.task, limits)
    blend = positive(blend, "blend", "m", zero=True)
    rate = positive(rate, "rate", "samples per second")
    ends = _configurations(F, X, names)
    require_possible(ends, kept, rate)
    lines, parts = parts_of(F, X, names, blend)
    with reporter(progress) as report:
        segments, durations = _timed_parts(parts, kept, report)
    require_samples(sum(durations) * rate, sum(durations), rate)

    rows = _rows_at_rest(durations, rate)
    t = np.arange(rows[-1] + 1) / rate
    course = Course(segments, t[rows[:-1]], np.diff(t[rows]))
    q, qdot, qddot, _ = course.derivatives(t)
    # the poses at rest are met exactly
    rests = [0, *(part.last for part in parts)]
    q[rows], qdot[rows], qddot[rows] = ends[rests], 0.0, 0.0
    return MotionBetween(
        joints=F.task.joint_names,
        t=t,
        q=q,
        qdot=qdot,
        qddot=qddot,
        starts=t[[0, -1]],
        length=_length(q),
        speed=np.linalg.norm(qdot, axis=1),
        velocity=kept.velocity,
        acceleration=kept.acceleration,
        jerk=kept.jerk,
        stops=len(rests) - 2,
        motion=JointMotion(F.task, t, q, qdot, 1, len(t) - 1),
        trajectory=course,
        poses=X,
        lines=tuple(line.kind for line in lines),
        times=_times_at_poses(parts, segments, t[rows]),
        rests=tuple(rests),
    )


def _rows_at_rest(durations: Sequence[float], rate: float) -> NDArray[np.intp]:
    """Return the indices of the samples at rest: 0, then the last sample of each part.

    ``durations`` are those of the parts, s, and ``rate`` the samples per second. Each duration is
    rounded up to a whole number of sample periods.
    """
    samples = np.maximum(1, np.ceil(np.array(durations) * rate - 1e-6)).astype(int)
    return np.concatenate([[0], np.cumsum(samples)])


def _length(q: Array) -> Array:
    """Compute the length of the joint path from its first sample to each of T samples: (T,)."""
    return np.insert(np.cumsum(np.linalg.norm(np.diff(q, axis=0), axis=1)), 0, 0.0)


def _timed_parts(
    parts: Sequence[Part], limits: JointLimits, report: Callable[[str, float], None]
) -> tuple[list[Segment], list[float]]:
    """Time each part between two rests separately; return one segment and duration, s, per part.

    The duration is longer than the segment if the motion must be slowed down to meet a limit
    between two grid points. ``report`` is the progress callback.
    """
    segments, durations = [], []
    for k, part in enumerate(parts):
        report("timing the motion", k / len(parts))
        segment, duration = part.timed(limits)
        segments.append(segment)
        durations.append(duration)
    return segments, durations


def _times_at_poses(parts: Sequence[Part], segments: Sequence[Segment], rests: Array) -> Array:
    """Compute the time at each of P poses, s: (P,).

    There is one segment per part. ``rests`` are the times of the start and of the end of each part,
    s: one more than there are parts, because a part begins when the last one ends.
    """
    passed = [np.zeros(1)]
    for part, segment, ends in zip(parts, segments, pairwise(rests), strict=True):
        share = np.interp(part.passed, segment.s, segment.t) / segment.t[-1]
        passed.append(ends[0] + share * (ends[1] - ends[0]))
    return np.concatenate(passed)


def _poses(task: Task, poses: Any) -> tuple[Array, Array]:
    """Convert poses to positions (P, 3), m, and rotation matrices (P, 3, 3).

    ``poses`` are a list of placements, homogeneous matrices (P, 4, 4), or rows x, y, z, qx, qy, qz,
    qw (P, 7). An InputError is raised for anything else.
    """
    if isinstance(poses, np.ndarray) and poses.shape[1:] in ((4, 4), (7,)):
        return as_poses(task, poses)
    what = "a list of placements, or a (P, 4, 4) or (P, 7) array"
    return stacked(task, as_placements(poses, "pose", what), "pose")


def _configurations(F: Function, X: Array, names: Sequence[str]) -> Array:
    """Evaluate F (P, n) at poses X (P, 4, 4); results equal single calls of F to the last bit.

    InputError names a pose that is not finite or has no configuration.
    """
    if len(X) < 2:
        count = "only one" if len(X) else "none"
        raise InputError(f"a motion requires at least two poses; got {count}")
    Q = []
    for name, x in zip(names, X, strict=True):
        if not np.isfinite(x).all():
            raise InputError(
                f"{name} has a number that is not finite; give a finite position, m, and rotation"
            )
        try:
            Q.append(F(pin.SE3(x)))
        except InputError as error:
            raise InputError(f"{name}: {error}") from None
    return np.array(Q)
