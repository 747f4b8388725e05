"""Writing of trajectory files: CSV, or ROS 2 JointTrajectory as YAML; refusal of violating motions.

A strategy is a controller, a map from the configuration and the task velocity to joint velocities.
A leaf lock replaces its integration by Newton steps from point to point of the path.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from ..base.arguments import file_name, flag, require_type
from ..base.errors import InputError
from ..base.files import write_whole
from ..model.task import Task
from ..strategies import Strategy
from .csv_file import csv_text
from .joint_motion import JointMotion, violations_of
from .motion import Motion
from .timed_motion import TimedMotion

_LEAST_SAMPLES = 10
"""Smallest number of samples per part of a timed motion in a file."""


def write_motion(
    motion: Motion | TimedMotion, file: str | Path, *, allow_violations: bool = False
) -> Path:
    """Write a trajectory file: time, positions, velocities, and accelerations of a timed motion.

    Parameters
    ----------
    motion
        Motion from :func:`follow`, :func:`timed` or :func:`approach`.
    file
        File name: ``.csv``, or ``.yaml`` for ROS 2's ``trajectory_msgs/msg/JointTrajectory``.
        Units: s, rad or m, per s and per s².
    allow_violations
        True to write the file even if a joint exceeds its limits, or bodies collide.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    InputError
        If a timed motion has fewer than ten samples per cycle or between two rests, the motion
        violates a limit, bodies collide, the file name has another ending, or the file cannot be
        written.

    Examples
    --------
    >>> file = rp.write_motion(rp.timed(motion, rp.Limits(acceleration=5.0)), "motion.csv")
    >>> file.read_text().splitlines()[0].startswith("time,")
    True
    """
    if not isinstance(motion, TimedMotion):
        require_type(motion, Motion, "motion", "a motion, such as rp.follow or rp.timed returns")
    else:
        refuse_coarse(motion)
    path = Path(file_name(file, "file"))
    if path.suffix not in (".csv", ".yaml", ".yml"):
        raise InputError(f"{str(path)!r} must end in .csv or .yaml")
    followed = motion.motion if isinstance(motion, TimedMotion) else motion
    if followed is not None and not flag(allow_violations, "allow_violations"):
        remedy = "choose another start or path, or write it anyway with allow_violations=True"
        refuse_violations(followed, remedy)
        if isinstance(motion, TimedMotion):
            refuse_timed_violations(motion, followed.task, remedy)
    return write_whole(path, csv_text(motion) if path.suffix == ".csv" else yaml_text(motion))


def refuse_violations(motion: JointMotion, remedy: str) -> None:
    """Raise InputError if a motion that is to be written has a limit violation or a collision.

    ``remedy`` ends the message.

    Raises
    ------
    InputError
        If a limit is violated or bodies collide; the message names the joint or the links, and the
        time.
    """
    found = violations_of(motion)
    if found:
        raise InputError(f"{'; '.join(map(str, found))}: no trajectory was written; {remedy}")


def refuse_coarse(motion: TimedMotion) -> None:
    """Raise InputError if a timed motion has fewer than ten samples in its shortest part.

    The shortest part is a cycle or, in a motion from pose to pose, the shortest motion from one
    rest to the next.
    """
    part, what = motion._shortest_part
    count = (len(motion.t) - 1) * part / max(motion.duration, 1e-300)
    if count < _LEAST_SAMPLES:
        rate = np.ceil(_LEAST_SAMPLES / part)
        raise InputError(
            f"{count:.2g} samples per {what} are too few to describe the path between the samples",
            remedy=f"use a rate of at least {rate:g} samples per second",
        )


def refuse_timed_violations(motion: TimedMotion, task: Task, remedy: str) -> None:
    """Raise InputError if a sample of a timed motion exceeds a joint limit, or bodies collide.

    A timed motion is a smooth curve through the samples of ``motion.motion``, the motion that was
    timed. That motion is straight between the samples, so the timed motion can collide where that
    motion does not. ``remedy`` ends the message. A timed motion with the same samples as its
    ``motion`` is not checked again.
    """
    if motion._is_its_motion:
        return
    found = violations_of(JointMotion(task, motion.t, motion.q, motion.qdot, 1, len(motion.q) - 1))
    if found:
        names = " and ".join(found[0].names)
        verb = "exceeds its limits" if len(found[0].names) == 1 else "collide"
        moment = found[0].moment * (motion.t[-1] - motion.t[0])
        raise InputError(
            f"{names} {verb} at {moment:.3g} s of the timed motion, between two points of the "
            "path: no trajectory was written",
            remedy=f"use more steps, {remedy}",
        )


def commanded(motion: Motion, strategy: Strategy) -> Motion:
    """Return a motion whose velocities are those that a strategy commands at its samples.

    The motion must go along its path at constant ds/dt, as :func:`.follow` returns it; a retimed
    one does not. In a motion with a leaf lock, these velocities replace the mean velocities of the
    steps. So a file has the commands of the controller itself.
    """
    period = (motion.t[-1] - motion.t[0]) / motion.cycles
    ends = (motion.t - motion.t[0]) / period % 1.0
    task = motion.task
    Qdot = [
        strategy.velocity(
            q, task.task_velocity(q, motion.path.twist(min(float(s), 1.0 - 1e-12))) / period
        )
        for q, s in zip(motion.q, ends, strict=True)
    ]
    return replace(motion, qdot=np.array(Qdot))


def yaml_text(motion: Motion | TimedMotion) -> str:
    """Format a motion as ROS 2 ``trajectory_msgs/msg/JointTrajectory``, for ``ros2 topic pub``.

    Each sample has positions and velocities of the robot's joints and, if the motion is timed,
    accelerations.
    """
    if isinstance(motion, TimedMotion):
        names, t = motion.joints, motion.t
        rows = {"positions": motion.q, "velocities": motion.qdot, "accelerations": motion.qddot}
    else:
        names = motion.task.joint_names
        t = motion.t - motion.t[0]
        rows = {"positions": motion.q, "velocities": motion.qdot}
    joints = f"joint_names: [{', '.join(map(_quoted, names))}]"
    lines = ["header:", "  stamp: {sec: 0, nanosec: 0}", "  frame_id: ''", joints, "points:"]
    for moment, *values in zip(t, *rows.values(), strict=True):
        nanoseconds = round(float(moment) * 1e9)
        said = [
            f"  {what}: [{', '.join(f'{v:.12f}' for v in row)}]"
            for what, row in zip(rows, values, strict=True)
        ]
        said.append(
            f"  time_from_start: {{sec: {nanoseconds // 10**9}, nanosec: {nanoseconds % 10**9}}}"
        )
        lines += ["-" + said[0][1:], *said[1:]]
    return "\n".join(lines) + "\n"


def _quoted(name: str) -> str:
    """Quote a name for YAML, with line breaks and other control characters as escapes.

    A joint name such as ``yes`` or ``1`` would otherwise not be read as text.
    """
    if name.isprintable():
        return "'" + name.replace("'", "''") + "'"
    plain = (c if c.isprintable() and c not in '"\\' else f"\\U{ord(c):08x}" for c in name)
    return '"' + "".join(plain) + '"'
