"""Plausibility checks of a joint log: units, times, and order of the joints.

A log in degrees, or with its columns in another order, would give a wrong verdict without an error.
Letters: T rows of the log, n joints.

``JointLog`` is recorded joint positions q (T, n) and their times t (T,).
"""

from __future__ import annotations

import numpy as np

from ...base.arguments import Array
from ...base.errors import InputError
from ...model.task import Task
from .joint_log import JointLog

_SLIGHT = 0.01
"""Distance beyond a joint limit that is not mentioned, rad or m."""

_WRONG = 0.3
"""Distance beyond a joint limit from which the values are not those of the arm, rad or m."""

_TOO_FAST = 5.0
"""Ratio of joint speed and speed limit from which times are mentioned."""


def unit_notes(task: Task, log: JointLog) -> list[str]:
    """Check the units, times and joint order of a log; return notes, each a sentence.

    Values that look like degrees, or do not fit this arm, raise an InputError, because a verdict on
    them would be wrong. Slight violations of joint limits, and speeds far above the limits, only
    give a note.
    """
    lower, upper, q = task.lower, task.upper, log.q
    beyond = _beyond(task, q)
    if (beyond <= _SLIGHT).all() and _speed_ratio(task, log.t, q) < _TOO_FAST:
        return []
    # the joint that is farthest beyond its limits
    worst = int(np.argmax(beyond))
    value = float(q[np.argmax(np.abs(q[:, worst])), worst])
    found = (
        f"{log.name}: {task.joint_names[worst]} reaches {value:.4g}, but its limits are "
        f"{lower[worst]:.3g} and {upper[worst]:.3g}"
    )
    if beyond[worst] <= _SLIGHT:
        found = f"{log.name}: the joints are far faster than their speed limits"
    # degrees?
    turned = q * np.where(task.revolute, np.pi / 180, 1.0)
    within = (_beyond(task, turned) <= _WRONG).all()
    if np.abs(q[:, task.revolute]).max(initial=0.0) > 2 * np.pi and within:
        raise InputError(f"{found}: the values look like degrees", remedy="pass degrees=True")
    if beyond[worst] <= _SLIGHT:
        return [f"{found}; check the times"]
    if beyond[worst] < _WRONG:
        return [f"{found} (rad or m)"]
    _refuse_another_order(task, log, found)
    raise InputError(
        f"{found}: the values are not those of this arm",
        remedy="check the order of the joints, and their units",
    )


def _refuse_another_order(task: Task, log: JointLog, found: str) -> None:
    """Raise InputError if the joints of a log fit their limits in reversed or alphabetical order.

    Logs whose joints were found by name are not tested. ``found`` is the first part of the message:
    the joint that exceeds its limits, and by how much.
    """
    orders = {
        "reversed": np.arange(task.n)[::-1],
        "alphabetical": np.argsort(np.argsort(task.joint_names)),  # as ROS sorts them
    }
    for name, order in orders.items():
        if not log.by_name and (_beyond(task, log.q[:, order]) <= _WRONG).all():
            raise InputError(
                f"{found}: the joints seem to be in {name} order",
                remedy="name the columns after the joints",
            )


def _speed_ratio(task: Task, t: Array, q: Array) -> float:
    """Compute the largest ratio of a joint's speed to its speed limit.

    Outliers do not count: for each joint, the 99th percentile of the speed over time is used. ``t``
    (T,) are times, s, and q (T, n) joint positions, rad or m. A ratio far above 1 is a sign of a
    wrong unit of time.
    """
    speeds = np.abs(np.diff(q, axis=0)) / np.diff(t)[:, None]
    return float(np.max(np.quantile(speeds, 0.99, axis=0) / task.velocity_limit))


def _beyond(task: Task, q: Array) -> Array:
    """Compute the largest excess of each joint beyond its limits: (n,), rad or m; 0 if none."""
    return np.maximum(-task.limit_margin(q).min(axis=0), 0.0)
