"""Audit of a recorded joint motion: how far the arm creeps between visits of one hand pose.

Creep is a steady drift: the configuration at the pose changes from visit to visit. The hand is the
frame that the task controls.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import t as student

from ..arguments import Array, flag, positive, read_only
from ..errors import InputError
from ..motion.displacement import LinkPoints
from ..motion.motion import CLOSED
from ..problem.task_choice import choose_task
from ..robot.length import elbow, joint_scale
from ..robot.robot import Robot
from ..robot.task import Task
from .joint_log import JointLog, joint_log, read_joint_log
from .visits import Visits, find_visits

FEWEST = 3
"""Minimum number of visits of a pose for a log to count as repeating."""

CONFIDENCE = 0.95

_MOST_ROWS = 200_000
_MOST_VISITS = 400
_DEGREE = np.pi / 180
_SLIGHT = 0.01
_SOME = 0.3
_TOO_FAST = 5.0
_MANY = 10.0
_CLOCKS = ((3600.0, "hour"), (60.0, "minute"), (1.0, "second"))


@dataclass(frozen=True, eq=False)
@read_only
class Trend:
    """Robust lines through columns of values over time: medians of the slopes between all pairs.

    Attributes
    ----------
    rate : (k,) array
        Slope of each column, per s.
    error : (k,) array
        Half-width of the confidence interval of each slope, per s.
    scatter : (k,) array
        Robust standard deviation of each column about its line.
    """

    rate: Array
    error: Array
    scatter: Array


@dataclass(frozen=True, eq=False)
@read_only
class Audit:
    """Result of :func:`audit`; True if the hand returns to a pose and the arm does not creep.

    Attributes
    ----------
    task : Task
        Task that controls the hand.
    log : JointLog
        The log, in rad and m.
    visits : Visits
        Visits of the hand pose that was visited most often.
    joints : Trend or None
        Creep of every joint, rad/s or m/s; None if the hand does not return.
    points : (N, L, 3) array
        The point of each link's body that is displaced most, at each visit, m.
    links : tuple of str
        These L links.
    part : int
        Index of the link that is off most, see :mod:`.displacement`.
    rate : float
        Speed at which its point creeps, m/s; 0 if the hand does not return.
    error : float
        Half-width of the 95 % confidence interval of ``rate``, m/s.
    creeps : bool
        True if the creep of some joint is larger than the half-width of its confidence interval,
        which is corrected for the number of joints (Bonferroni).
    scatter : float
        Robust standard deviation of that point about its trend, m; 0 if the hand does not return.
    scatters : bool
        True if visits differ, but not steadily: a joint's scatter is over 10 times its noise, or
        10 times the tolerance of a closed cycle if that is larger.
    notes : tuple of str
        Remarks on the log.

    Examples
    --------
    >>> t, q = np.arange(101) * 0.1, motion.q  # a log of the arm
    >>> found = rp.audit((t, q), motion.task)
    >>> bool(found), found.returns
    (True, 2)
    """

    task: Task
    log: JointLog
    visits: Visits
    joints: Trend | None
    points: Array
    links: tuple[str, ...] = ()
    part: int = 0
    rate: float = 0.0
    error: float = 0.0
    creeps: bool = False
    scatter: float = 0.0
    scatters: bool = False
    notes: tuple[str, ...] = ()

    def __bool__(self) -> bool:
        return self.repeats and not self.creeps

    @property
    def repeats(self) -> bool:
        """True if the hand was at one pose at least three times."""
        return self.joints is not None

    @property
    def returns(self) -> int:
        """Number of times that the hand came back to the pose."""
        return len(self.visits.t) - 1

    @property
    def elbow(self) -> int:
        """Index of the elbow joint, found at the first visit."""
        return elbow(self.task, self.visits.q[0])

    @property
    def along(self) -> Array:
        """Displacement of the point of link ``part`` since the first visit: (N,), m.

        It is measured along the straight line to the point's position at the last visit.
        """
        place = self.points[:, self.part] - self.points[0, self.part]
        way = place[-1]
        size = float(np.linalg.norm(way))
        return place @ way / size if size > 0 else np.zeros(len(place))

    @property
    def clock(self) -> tuple[float, str]:
        """Unit of time in which rates are written: its length, s, and its name.

        It is an hour, a minute or a second: the longest unit that is at most twice as long as the
        log.
        """
        span = float(self.log.t[-1] - self.log.t[0])
        return next(one for one in _CLOCKS if span >= one[0] / 2 or one[0] == 1)

    @property
    def leaves_range(self) -> tuple[float, str] | None:
        """Predicted time after the log, s, at which a joint leaves its range, and the joint's name.

        The prediction extends the creep at the measured rate. It is None if the arm does not creep,
        or if the time is more than 100 times as long as the log.
        """
        if self.joints is None or not self.creeps:
            return None
        last = self.log.q[self.log.t >= self.visits.t[-2]]
        (lower, upper, _), rate = self.task.joint_limits, self.joints.rate
        margin = np.where(rate > 0, upper - last.max(axis=0), last.min(axis=0) - lower)
        with np.errstate(divide="ignore", invalid="ignore"):
            left = np.where(
                np.abs(rate) > self.joints.error, margin / np.abs(rate), np.inf
            )
        joint = int(np.argmin(left))
        if not 0 <= left[joint] < 100 * (self.log.t[-1] - self.log.t[0]):
            return None
        return float(left[joint]), self.task.robot_joints[joint]

    def summary(self) -> str:
        """Summarise in one line whether the arm returns, and how fast it creeps if not."""
        name, times = self.log.name, f"{self.returns} returns to one hand pose"
        if not self.repeats:
            return f"{name}: the hand does not return to a pose; nothing can be said about creep"
        seconds, unit = self.clock
        error = f"{100 * self.error * seconds:.2g} cm per {unit}"
        if not self.creeps:
            return f"{name}: no creep above {error} in {times}"
        rate = f"{100 * self.rate * seconds:.3g} ± {error}"
        return f"{name}: {self.links[self.part]} creeps {rate} in {times}"

    def as_dict(self) -> dict[str, Any]:
        """Convert the result to plain Python types, in s, m and rad, for JSON."""
        found: dict[str, Any] = {
            **self.task.as_dict(),
            "log": self.log.name,
            "rows": len(self.log.t),
            "seconds": float(self.log.t[-1] - self.log.t[0]),
            "repeats": self.repeats,
            "creeps": self.creeps,
            "returns": max(self.returns, 0),
            "tolerance": self.visits.tolerance,
            "noise": self.visits.noise,
            "notes": self.notes,
        }
        if self.joints is None:
            return found
        return found | {
            "times": self.visits.t,
            "configurations": self.visits.q,
            "joint_rate": self.joints.rate,
            "joint_rate_error": self.joints.error,
            "part": self.links[self.part],
            "rate": self.rate,
            "rate_error": self.error,
            "scatter": self.scatter,
            "leaves_range": self.leaves_range,
        }

    def __repr__(self) -> str:
        return f"<Audit of {self.task.robot.name} {self.task.frame}: {self.summary()}>"


def audit(
    log: Any,
    robot: str | Path | Robot | Task,
    *,
    frame: str | None = None,
    kind: str | None = None,
    degrees: bool = False,
    tolerance: float | None = None,
) -> Audit:
    """Measure how far an arm creeps between returns to one end-effector pose, from a joint log.

    The end-effector poses of the log, f(q) of (1), are searched for the one that is visited most
    often. A joint's creep is the median of the slopes between all pairs of visits (Theil and Sen),
    so an outlier, a gap or a pause does not change it. Its confidence interval is that of a
    straight line with the robust scatter of the visits, at least the noise of the log.

    Parameters
    ----------
    log
        File with a column ``time``, s, and one for each joint: ``.csv``, ``.npz`` or ``.parquet``;
        or a pair of times (T,), s, and joint positions (T, n), rad or m.
    robot
        Catalogue name, path to a URDF, a loaded robot or a task.
    frame, kind : str, optional
        Frame of the end effector and kind of task; by default the end of the arm, and the first
        redundant kind.
    degrees
        True if revolute joints are in degrees.
    tolerance : float, optional
        Distance within which the end effector is at the pose again, m; by default from the noise of
        the log.

    Returns
    -------
    Audit
        Visits, rates and their confidence.

    Raises
    ------
    InputError
        If the log cannot be read, or its values are not those of the joints: they look like
        degrees, or violate limits as if the joints were in another order.

    References
    ----------
    P. K. Sen, Estimates of the regression coefficient based on Kendall's tau, J. Am. Stat. Assoc.
    63 (1968).

    Examples
    --------
    >>> motion = rp.follow(control, path, q0, cycles=4, steps=100)  # J⁺
    >>> found = rp.audit((motion.t, motion.q), task)
    >>> found.creeps, found.returns, bool(found.rate > 1e-4)  # m/s
    (True, 4, True)
    """
    degrees = flag(degrees, "degrees")
    if tolerance is not None:
        tolerance = positive(tolerance, "tolerance", "m")
    task = _task(robot, frame, kind)
    if isinstance(log, tuple) and len(log) == 2:
        given = joint_log(*log, task.n)
    else:
        given = read_joint_log(log, task.robot_joints)
    units = np.where(task.revolute & degrees, _DEGREE, 1.0)
    given = replace(given, q=units * given.q)
    notes = _units(task, given)
    if given.dropped:
        notes.append(f"{given.dropped} rows without new numbers were left out")
    endless = np.isinf(task.joint_limits[1])
    given = replace(given, q=np.where(endless, np.unwrap(given.q, axis=0), given.q))
    every = -(-len(given.t) // _MOST_ROWS)
    visits = find_visits(task, given.t[::every], given.q[::every], tolerance)
    if len(visits.t) < FEWEST:
        return Audit(task, given, visits, None, np.empty((0, 0, 3)), notes=tuple(notes))
    # full turns of a joint without limits do not count
    same = np.where(endless, np.unwrap(visits.q, axis=0), visits.q)
    return _measured(task, given, replace(visits, q=same), tuple(notes))


def _task(robot: Any, frame: str | None, kind: str | None) -> Task:
    """Make the task from a robot, its frame and a kind; return a given task as it is."""
    if isinstance(robot, Task):
        if frame is not None or kind is not None:
            name = "frame" if frame is not None else "kind"
            raise InputError(
                ": a task has its own", argument=name, remedy=f"omit {name}="
            )
        if robot.coordinates is not None:
            raise InputError(
                ": a log holds the robot's own joints, not the coordinates of this task",
                argument="robot",
                remedy="pass the robot",
            )
        return robot
    return choose_task(
        robot if isinstance(robot, Robot) else Robot.load(robot), frame, kind
    )


def _units(task: Task, log: JointLog) -> list[str]:
    """Check units, times and the order of the joints; return notes.

    Values that look like degrees, or that are not those of this arm, raise an error. Slight
    violations of joint limits, and speeds far beyond the limits, are noted.
    """
    (lower, upper, _), q = task.joint_limits, log.q
    beyond = _beyond(q, lower, upper)
    if (beyond <= _SLIGHT).all() and _speed_ratio(task, log.t, q) < _TOO_FAST:
        return []
    worst = int(np.argmax(beyond))
    value = float(q[np.argmax(np.abs(q[:, worst])), worst])
    found = (
        f"{log.name}: {task.robot_joints[worst]} reaches {value:.4g}, but its limits are "
        f"{lower[worst]:.3g} and {upper[worst]:.3g}"
    )
    if beyond[worst] <= _SLIGHT:
        found = f"{log.name}: the joints are far faster than their speed limits"
    turned = q * np.where(task.revolute, _DEGREE, 1.0)
    within = (_beyond(turned, lower, upper) <= _SOME).all()
    if np.abs(q[:, task.revolute]).max(initial=0.0) > 2 * np.pi and within:
        raise InputError(
            f"{found}: the values look like degrees", remedy="pass degrees=True"
        )
    if beyond[worst] <= _SLIGHT:
        return [f"{found}; check the times"]
    if beyond[worst] < _SOME:
        return [f"{found} (rad or m)"]
    orders = {
        "reversed": np.arange(task.n)[::-1],
        "alphabetical": np.argsort(np.argsort(task.robot_joints)),  # as ROS sorts them
    }
    for name, order in orders.items():
        if not log.by_name and (_beyond(q[:, order], lower, upper) <= _SOME).all():
            raise InputError(
                f"{found}: the joints seem to be in {name} order",
                remedy="name the columns by the joints",
            )
    raise InputError(
        f"{found}: the values are not those of this arm",
        remedy="check the order of the joints, and their units",
    )


def _speed_ratio(task: Task, t: Array, q: Array) -> float:
    """Compute the 99th percentile of joint speed relative to its limit, for the worst joint."""
    speeds = np.abs(np.diff(q, axis=0)) / np.diff(t)[:, None]
    return float(np.max(np.quantile(speeds, 0.99, axis=0) / task.joint_limits[2]))


def _beyond(q: Array, lower: Array, upper: Array) -> Array:
    """Compute how far each joint exceeds its limits at most (n,), rad or m; 0 within them."""
    return np.maximum(np.max(lower - q, axis=0), np.max(q - upper, axis=0)).clip(0.0)


def _measured(
    task: Task, log: JointLog, visits: Visits, notes: tuple[str, ...]
) -> Audit:
    """Fit the creep of the joints, and of the links, to the visits; return the audit."""
    floor = np.maximum(visits.noise, CLOSED * joint_scale(task, visits.q[0]))
    joints = trend(visits.t, visits.q, floor, 1 - (1 - CONFIDENCE) / task.n)
    bodies = LinkPoints.of(task, visits.q)
    points = bodies.at(visits.q)
    through = trend(visits.t, points.reshape(len(points), -1))
    rates = np.linalg.norm(through.rate.reshape(-1, 3), axis=1)
    part = int(np.argmax(np.linalg.norm(points - points[0], axis=2).max(axis=0)))
    creeps = bool((np.abs(joints.rate) > joints.error).any())
    return Audit(
        task,
        log,
        visits,
        joints,
        points,
        bodies.links,
        part,
        float(rates[part]),
        _error_of(bodies, visits, part, floor),
        creeps,
        float(np.linalg.norm(through.scatter.reshape(-1, 3)[part])),
        not creeps and bool((joints.scatter > _MANY * floor).any()),
        notes,
    )


def _error_of(bodies: LinkPoints, visits: Visits, part: int, floor: Array) -> float:
    """Compute the half-width of the confidence interval of the speed of a link's point, m/s.

    The scatter of the point counts as at least what the joints' ``floor`` causes.
    """
    q, step = visits.q[0], 1e-6
    around = np.vstack([q, q + step * np.eye(len(q))])
    here, *moved = bodies.at(around)[:, part]
    joint = (np.array(moved) - here) / step  # (n, 3)
    noise = np.sqrt(np.sum((joint * floor[:, None]) ** 2, axis=0))
    points = bodies.at(visits.q)[:, part]
    return float(np.linalg.norm(trend(visits.t, points, noise).error))


def trend(
    t: Array, values: Array, floor: Array | float = 0.0, confidence: float = CONFIDENCE
) -> Trend:
    """Fit a line to each column of values (N, k) by the median of the slopes of all pairs.

    Parameters
    ----------
    t : (N,) array
        Times, s.
    values : (N, k) array
        Values at these times.
    floor : (k,) array or float
        Lower bound on the standard deviation of each column, for the confidence intervals.
    confidence
        Confidence level of the intervals.
    """
    rows = np.unique(np.linspace(0, len(t) - 1, min(len(t), _MOST_VISITS)).astype(int))
    i, k = np.triu_indices(len(rows), 1)
    some, times = values[rows], t[rows]
    rate = np.median((some[k] - some[i]) / (times[k] - times[i])[:, None], axis=0)
    line = values - t[:, None] * rate
    off = line - np.median(line, axis=0)
    if len(t) < 8:
        scatter = np.sqrt(np.sum(off**2, axis=0) / (len(t) - 2))
    else:
        scatter = np.median(np.abs(off), axis=0) / 0.6745
    quantile = student.ppf((1 + confidence) / 2, len(t) - 2)
    spread = np.sqrt(np.sum((t - t.mean()) ** 2))
    return Trend(rate, quantile * np.maximum(scatter, floor) / spread, scatter)
