"""Audit of a recorded joint motion: how the configurations at the visits of one hand pose differ.

Drift is here a steady change of the configuration at the pose from visit to visit. A visit is a
time at which the hand is at the pose; every visit but the first is a return. The hand is the frame
that the task controls; if the task controls several frames, all must be at their poses. The noise
of the log is the scatter of a joint reading, estimated from differences of successive rows.
Differences at the pose are within the noise if the noise, and the errors of interpolating the log,
can explain them. The most displaced point of a link is the point of its drawn body that, at some
visit, is farthest from its position at the first visit. Levels are positions along the self-motion,
such as the position of the elbow, that were commanded together with the pose. Letters: N visits, n
joints, L links, T rows of the log.

``Trend`` is robust lines through columns of values over time: their slopes, and the half-widths of
the slopes' confidence intervals. ``JointLog`` is recorded joint positions q (T, n) and their times
t (T,). ``Visits`` are the visits of the hand at one pose: their times and configurations.
``LinkPoints`` is the most displaced point of each link of an arm.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...base.arguments import Array, flag, list_of_names, positive, read_only
from ...base.errors import InputError
from ...model.length import elbow, joint_scale
from ...model.robot import Robot
from ...model.task import Task
from ...motion.body_displacement import LinkPoints
from ...motion.motion import CLOSED
from ...studies.task_choice import choose_task
from .joint_log import JointLog, joint_log, read_joint_log
from .log_checks import unit_notes
from .verdict import DRIFTS, LATER, NO_RETURN, REPEATS, Trend, Verdict, trend, verdict
from .visits import Visits, find_visits

_FEWEST = 3
"""Minimum number of visits of a pose for differences to be measured."""

_MOST_ROWS = 200_000
_CLOCKS = ((3600.0, "hour"), (60.0, "minute"), (1.0, "second"))


@dataclass(frozen=True, eq=False)
@read_only
class Audit:
    """Result of :func:`audit`; True if the arm repeats.

    Attributes
    ----------
    task : Task
        Task that controls the hand.
    log : JointLog
        The log, in rad and m.
    visits : Visits
        Visits of the hand pose that was visited most often.
    points : (N, L, 3) array
        Positions in the root frame, m, of one point of each link: the point of its drawn body that,
        at some visit, is farthest from its position at the first visit. The first index is the
        visit, the second the link.
    links : tuple of str
        Names of the L links.
    found : Verdict or None
        Verdict on the configurations at the visits; None with fewer than two returns.
    part : int
        Index, among ``links``, of the link whose point is displaced most from the first visit.
    rate : float
        Speed at which the point of that link drifts, m/s; 0 with fewer than two returns.
    error : float
        Half-width of the 95 % confidence interval of ``rate``, m/s.
    difference : float
        Largest distance of that point between any two visits, m.
    notes : tuple of str
        Remarks on the log.

    Examples
    --------
    >>> t, q = np.arange(101) * 0.1, motion.q  # a log of the arm
    >>> found = rp.audit((t, q), motion.task)
    >>> bool(found), found.verdict, found.returns
    (False, 'inconclusive', 2)
    """

    task: Task
    log: JointLog
    visits: Visits
    points: Array
    links: tuple[str, ...] = ()
    found: Verdict | None = None
    part: int = 0
    rate: float = 0.0
    error: float = 0.0
    difference: float = 0.0
    notes: tuple[str, ...] = ()

    def __bool__(self) -> bool:
        return self.repeats

    @property
    def verdict(self) -> str:
        """Verdict in one word or two.

        - ``repeats``: the largest difference between two visits is within the noise, and no slope
          is significant.
        - ``drifts``: the joints change steadily.
        - ``drifts later``: the joints are the same at first, and change steadily later.
        - ``jumps``: each visit is in one of a few configurations.
        - ``scatters``: the configurations differ, without a steady change.
        - ``inconclusive``: there are two to four returns, or the noise could hide a difference.
        - ``no return``: there are fewer than two returns.
        """
        return NO_RETURN if self.found is None else self.found.kind

    @property
    def repeats(self) -> bool:
        """True if the verdict is ``repeats``.

        It is False for all other verdicts, also for ``inconclusive`` and ``no return``.
        """
        return self.verdict == REPEATS

    @property
    def drifts(self) -> bool:
        """True if some joint changes steadily, from the first visit or from a later one on."""
        return self.verdict in (DRIFTS, LATER)

    @property
    def joints(self) -> Trend | None:
        """Drift rates of the joints, rad/s or m/s, and half-widths of their confidence intervals.

        The result is None for fewer than two returns.
        """
        return None if self.found is None else self.found.trend

    @property
    def differences(self) -> Array:
        """Largest difference of each joint between any two visits: (n,), rad or m."""
        return np.ptp(self.visits.q, axis=0)

    @property
    def returns(self) -> int:
        """Number of times that the hand came back to the pose; the first visit is not a return."""
        return len(self.visits.t) - 1

    @property
    def begins(self) -> float | None:
        """Time from the start of the log, s, at which a drift begins after equal visits.

        The drift begins after the last of the equal visits, and the result is the time of that
        visit. It is None unless the verdict is ``drifts later``.
        """
        if self.found is None or self.verdict != LATER:
            return None
        return float(self.visits.t[self.found.begins - 1] - self.log.t[0])

    @property
    def elbow(self) -> int:
        """Index, in q, of the elbow joint, found at the first visit of the hand pose.

        The elbow is the joint, among those in the middle of the arm, that moves most in
        self-motions: motions in which the hand rests.
        """
        return elbow(self.task, self.visits.q[0])

    @property
    def along(self) -> Array:
        """Signed displacement, since the first visit, of the point of link ``part``: (N,), m.

        It is the component in the direction from the point's position at the first visit to its
        position at the last, positive in this direction.
        """
        place = self.points[:, self.part] - self.points[0, self.part]
        way = place[-1]
        size = float(np.linalg.norm(way))
        return place @ way / size if size > 0 else np.zeros(len(place))

    @property
    def clock(self) -> tuple[float, str]:
        """Unit of time in which rates are written, as a pair: its duration, s, and its name.

        The unit is an hour, a minute or a second: the longest that is at most twice as long as the
        log.
        """
        span = float(self.log.t[-1] - self.log.t[0])
        return next(one for one in _CLOCKS if span >= one[0] / 2 or one[0] == 1)

    @property
    def leaves_range(self) -> tuple[float, str] | None:
        """Time, s, until a joint is predicted to leave its range, and the name of the joint.

        The time begins at the end of the log. The prediction assumes that the drift continues at
        its mean rate in the log. If the drift grows, a joint leaves its range sooner. None if the
        arm does not drift, or if the time is more than 100 times the duration of the log.
        """
        if self.joints is None or not self.drifts:
            return None
        last = self.log.q[self.log.t >= self.visits.t[-2]]
        lower, upper, rate = self.task.lower, self.task.upper, self.joints.rate
        margin = np.where(rate > 0, upper - last.max(axis=0), last.min(axis=0) - lower)
        with np.errstate(divide="ignore", invalid="ignore"):
            left = np.where(np.abs(rate) > self.joints.error, margin / np.abs(rate), np.inf)
        joint = int(np.argmin(left))
        if not 0 <= left[joint] < 100 * (self.log.t[-1] - self.log.t[0]):
            return None
        return float(left[joint]), self.task.joint_names[joint]

    def summary(self) -> str:
        """Summarise in one line whether the arm repeats, and how it differs if not."""
        name = self.log.name
        level = " and level" if self.log.levels.shape[1] else ""
        times = f"{self.returns} returns to one hand pose{level}"
        if self.found is None:
            return f"{name}: no hand pose{level} is visited often enough for a verdict"
        seconds, unit = self.clock
        error = f"{100 * self.error * seconds:.2g} cm per {unit}"
        name_of = self.links[self.part]
        if self.drifts:
            rate = f"{100 * self.rate * seconds:.3g} ± {error}"
            late = "" if self.verdict == DRIFTS else f" after {self.begins:.4g} s"
            return f"{name}: {name_of} drifts {rate}{late} in {times}"
        off = f"{name_of} differs by up to {100 * self.difference:.3g} cm in {times}"
        if self.repeats:
            return f"{name}: repeats, no drift above {error}; {off}, within the noise"
        return f"{name}: {self.verdict}; {off}"

    def as_dict(self) -> dict[str, Any]:
        """Convert the result to plain Python types, in s, m and rad, for JSON."""
        found: dict[str, Any] = {
            **self.task.as_dict(),
            "log": self.log.name,
            "rows": len(self.log.t),
            "seconds": float(self.log.t[-1] - self.log.t[0]),
            "verdict": self.verdict,
            "repeats": self.repeats,
            "drifts": self.drifts,
            "returns": max(self.returns, 0),
            "tolerance": self.visits.tolerance,
            "noise": self.visits.noise,
            "notes": self.notes,
        }
        if self.found is None:
            return found
        return found | {
            "times": self.visits.t,
            "configurations": self.visits.q,
            "groups": self.found.groups,
            "within_noise": self.found.within,
            "joint_differences": self.differences,
            "joint_rate": self.found.trend.rate,
            "joint_rate_error": self.found.trend.error,
            "part": self.links[self.part],
            "difference": self.difference,
            "rate": self.rate,
            "rate_error": self.error,
            "begins": self.begins,
            "leaves_range": self.leaves_range,
        }

    def __repr__(self) -> str:
        return f"<Audit of {self.task.robot.name} {self.task.frame}: {self.summary()}>"


def audit(
    log: Any,
    robot: str | Path | Robot | Task,
    *,
    frame: str | Sequence[Any] | None = None,
    kind: str | None = None,
    degrees: bool = False,
    tolerance: float | None = None,
    levels: Sequence[str] = (),
) -> Audit:
    """Measure how far an arm drifts between returns to one end-effector pose, from a joint log.

    Drift is a steady change of the joints at one pose, as under J⁺. The pose that the end effector
    visits most often is found among the poses f(q), equation (1), of the log. The arm repeats if
    the largest difference of its configurations at this pose is within the noise. A joint's drift
    is the median of the slopes between all pairs of visits (Theil and Sen), so an outlier, a gap or
    a pause does not change it. The confidence interval is that of a straight-line fit. The scatter
    about the line is estimated robustly from the visits, and is at least the noise of the log.
    Logs of more than 200,000 rows are thinned to at most this number for the search for visits.

    Parameters
    ----------
    log
        File (``.csv``, ``.npz`` or ``.parquet``) with a column ``time``, s, and one column per
        joint; a data set of LeRobot (its folder) or robomimic (``.hdf5``); or a pair of times (T,),
        s, and joint positions (T, n), rad or m. A third array (T, k) may have k commanded levels,
        as explained at ``levels``.
    robot
        Catalogue name, path to a URDF, a loaded robot or a task.
    frame, kind : str, optional
        Frame of the end effector and kind of task. By default, the end of the arm, and the first of
        the kinds pose, position, xy, xz and yz for which the arm is redundant. With several frames,
        as :meth:`Robot.task` takes them, the default kind is pose, and all frames must be at their
        poses at once.
    degrees
        True if revolute joints are in degrees.
    tolerance : float, optional
        Distance within which the end effector counts as being at the pose, m; by default derived
        from the noise of the log.
    levels : sequence of str, optional
        Names of columns with levels: positions along the self-motion, such as an elbow angle, rad,
        or the elbow's position, m, that were commanded together with the pose. If given, a return
        is a return to the same pose and the same levels. So a change of the joints is not taken for
        drift where the elbow was moved on purpose.

    Returns
    -------
    Audit
        Visits, rates and their confidence.

    Raises
    ------
    InputError
        If the log cannot be read, or its values do not fit the joints: they look like degrees, or
        violate limits as if the joints were in another order.

    References
    ----------
    P. K. Sen, Estimates of the regression coefficient based on Kendall's tau, J. Am. Stat. Assoc.
    63 (1968).

    Examples
    --------
    >>> motion = rp.follow(control, path, q0, cycles=6, steps=100)  # J⁺
    >>> found = rp.audit((motion.t, motion.q), task)
    >>> found.verdict, found.returns, bool(found.rate > 1e-4)  # m/s
    ('drifts', 6, True)
    """
    degrees = flag(degrees, "degrees")
    if tolerance is not None:
        tolerance = positive(tolerance, "tolerance", "m")
    task = _task(robot, frame, kind)
    units = np.where(task.revolute & degrees, np.pi / 180, 1.0)
    levels = list_of_names(levels, "levels", "names of columns")
    if isinstance(log, tuple) and len(log) in (2, 3):
        if levels:
            raise InputError(
                "names columns, but the log is arrays",
                argument="levels",
                remedy="give the levels as a third array, log=(t, q, c)",
            )
        given = joint_log(log[0], log[1], units, *log[2:])
    else:
        given = read_joint_log(log, task, units, levels)
    notes = _notes(task, given, levels)
    endless = np.isinf(task.upper)
    given = replace(given, q=np.where(endless, np.unwrap(given.q, axis=0), given.q))
    every = -(-len(given.t) // _MOST_ROWS)
    t, q, c = given.t[::every], given.q[::every], given.levels[::every]
    visits = find_visits(task, t, q, tolerance, c)
    if len(visits.t) < _FEWEST:
        return Audit(task, given, visits, np.empty((0, 0, 3)), notes=notes)
    # full turns of a joint without limits do not count
    same = np.where(endless, np.unwrap(visits.q, axis=0), visits.q)
    return _measured(task, given, replace(visits, q=same), notes)


def _notes(task: Task, log: JointLog, levels: Sequence[str]) -> tuple[str, ...]:
    """Write the notes on a log: how it was read, the effect of levels, and rows left out.

    The results of the plausibility checks of units and limits are among the notes. ``levels`` are
    the names of the log's columns of levels, to be written in a note; empty for a log of arrays.
    """
    notes = [log.read] if log.read else []
    if log.levels.shape[1]:
        named = f" in {', '.join(levels)}" if levels else ""
        notes.append(f"a return is to the same hand pose and the same commanded levels{named}")
    notes += unit_notes(task, log)
    if log.dropped:
        notes.append(
            f"{log.dropped} rows were left out: a number is missing, or the time is that before"
        )
    return tuple(notes)


def _task(robot: Any, frame: Any, kind: str | None) -> Task:
    """Make the task of an audit from a robot, a frame and a kind; a given task is returned as is.

    ``robot`` is a name, a URDF, a Robot or a Task. InputError is raised if a task is given together
    with a frame or a kind, even if they are the task's own.
    """
    if isinstance(robot, Task):
        if frame is not None or kind is not None:
            name = "frame" if frame is not None else "kind"
            raise InputError(
                f": the given task already has a {name}", argument=name, remedy=f"omit {name}="
            )
        return robot
    return choose_task(robot if isinstance(robot, Robot) else Robot.load(robot), frame, kind)


def _measured(task: Task, log: JointLog, visits: Visits, notes: tuple[str, ...]) -> Audit:
    """Compare the configurations at the visits, measure the links, and return the audit.

    The verdict is on the joints. To express it in metres, the most displaced point of the most
    displaced link is found. For this point, the speed of the drift and the largest distance between
    two visits are computed. ``notes`` are remarks on the log.
    """
    scale = joint_scale(task, visits.q[0])
    found = verdict(visits.t, visits.q, visits.deviation, visits.bias, scale)
    bodies = LinkPoints.of(task, visits.q)
    points = bodies.at(visits.q)
    part = int(np.argmax(np.linalg.norm(points - points[0], axis=2).max(axis=0)))
    place = points[:, part]
    later = replace(visits, t=visits.t[found.begins :], q=visits.q[found.begins :])
    rate = trend(later.t, place[found.begins :]).rate
    floor = np.maximum(visits.noise, CLOSED * scale)
    farthest = max(float(np.linalg.norm(place - one, axis=1).max()) for one in place)
    return Audit(
        task,
        log,
        visits,
        points,
        bodies.links,
        found,
        part,
        float(np.linalg.norm(rate)),
        _error_of(bodies, later, part, floor),
        farthest,
        notes,
    )


def _error_of(bodies: LinkPoints, visits: Visits, part: int, floor: Array) -> float:
    """Compute the half-width of the 95 % interval of the drift of a link's point, m/s.

    ``part`` is the index of the link. ``floor`` (n,) is a lower bound on the scatter of each joint,
    rad or m; the scatter of the point is at least the scatter that this bound causes. So the
    interval is not too narrow after a few equal visits.
    """
    q, step = visits.q[0], 1e-6
    around = np.vstack([q, q + step * np.eye(len(q))])
    here, *moved = bodies.at(around)[:, part]
    joint = (np.array(moved) - here) / step  # (n, 3)
    noise = np.sqrt(np.sum((joint * floor[:, None]) ** 2, axis=0))
    points = bodies.at(visits.q)[:, part]
    return float(np.linalg.norm(trend(visits.t, points, noise).error))
