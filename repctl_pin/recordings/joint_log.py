"""A log of joint positions: times, and one column per joint."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arguments import Array, as_numbers, file_name, read_only
from ..errors import InputError
from .table import Column, Table, read_table

CLOCKS = ("time", "t", "times", "timestamp", "stamp", "sec", "secs", "seconds", "%time")
"""Names of a column of times; values above 1e14 are nanoseconds, as in ROS."""

TABLES = ("q", "Q", "joints", "positions", "position", "qpos", "observation.state")
"""Names of an array with the positions of all joints, one row per time."""

_NANOSECONDS = 1e14
_NUMBERED = re.compile(r"(.*?)(\d+)\W*$")
_NO_POSITION = re.compile(
    r"(?i)(vel|velocity|acc|acceleration|effort|torque|current)(s|$|[._/\d])"
)


@dataclass(frozen=True, eq=False)
@read_only
class JointLog:
    """Recorded joint positions.

    Attributes
    ----------
    name : str
        Name of the file, or ``log``.
    t : (T,) array
        Time, s, increasing.
    q : (T, n) array
        Joint positions, rad or m.
    by_name : bool
        True if the file names the joints; False if they were taken in its order.
    dropped : int
        Number of rows left out, because a number is missing or the time equals that of the previous
        row.
    """

    name: str
    t: Array
    q: Array
    by_name: bool = True
    dropped: int = 0


def read_joint_log(file: Any, joints: Sequence[str]) -> JointLog:
    """Read a log of joint positions from a ``.csv``, ``.npz`` or ``.parquet`` file.

    The file has a column of times, named ``time``, ``t`` or ``timestamp``, and a column for each
    joint. The name of the joint may be part of a longer name, such as ``panda_joint1.position``.
    Columns of one name and a number, such as ``q1`` to ``q7``, are taken in the order of the
    numbers, and an array ``q`` in that of its columns. Other columns are ignored.

    Parameters
    ----------
    file
        The file.
    joints
        Names of the joints, in the order of the result.

    Raises
    ------
    InputError
        If the file cannot be read, a joint or the times are missing, or time runs backwards; the
        message names the line.
    """
    table = read_table(file_name(file, "log"))
    columns, where = table.columns, str(table.file)
    clock = next((name for name in columns if name.lower() in CLOCKS), None)
    if clock is None:
        raise InputError(
            f"{where}: there is no column of times among {', '.join(columns)}",
            remedy="name one time, in s",
        )
    single = {
        name: c for name, c in columns.items() if c.ndim == 1 and c.dtype.kind in "fiu"
    }
    if clock not in single:
        raise InputError(
            f"{where}: the times in {clock!r} are not numbers, one per row"
        )
    names, by_name = _columns([name for name in single if name != clock], joints)
    whole = _whole(columns, len(joints))
    if names:
        q = np.stack([single[name] for name in names], axis=1)
    elif whole is not None:
        q, by_name = whole, False
    else:
        held = [j for j in joints if any(_holds(name, j) for name in single)]
        missing = next(joint for joint in joints if joint not in held)
        what = (
            f"no column is named {missing}" if held else "no column is named as a joint"
        )
        raise InputError(
            f"{where}: {what}", remedy=f"name the columns {', '.join(joints)}"
        )
    t = single[clock].astype(float)
    return _checked(where, t, q.astype(float), by_name, table)


def joint_log(t: Any, q: Any, n: int) -> JointLog:
    """Check times t (T,), s, and joint positions q (T, n), and make a log of them."""
    times, values = as_numbers(t), as_numbers(q)
    sizes = None if values is None or times is None else (times.shape, values.shape)
    if sizes is None or sizes[1] != (*sizes[0], n):
        got = "others" if sizes is None else f"shapes {sizes[0]} and {sizes[1]}"
        raise InputError(
            f"must be numbers: times (T,) and joint positions (T, {n}); got {got}",
            argument="log",
        )
    assert times is not None and values is not None
    return _checked("log", times, values, True, None)


def _columns(header: Sequence[str], joints: Sequence[str]) -> tuple[list[str], bool]:
    """Find the columns of the joints: by name, by names that contain it, or by number.

    Return their names, empty if they are not found, and whether they name the joints.
    """
    if set(joints) <= set(header):
        return list(joints), True
    positions = [name for name in header if not _NO_POSITION.search(name)]
    held = [[name for name in positions if _holds(name, joint)] for joint in joints]
    if all(held) and len({found[0] for found in held}) == len(joints):
        return [found[0] for found in held], True
    if any(held):
        return [], True
    groups: dict[str, list[tuple[int, str]]] = {}
    for name in positions:
        if found := _NUMBERED.match(name):
            groups.setdefault(found[1], []).append((int(found[2]), name))
    fitting = [sorted(group) for group in groups.values() if len(group) == len(joints)]
    return ([name for _, name in fitting[0]] if len(fitting) == 1 else []), False


def _holds(name: str, joint: str) -> bool:
    """Check whether a column's name contains a joint's name, with no letter or digit next to it."""
    return (
        re.search(rf"(?<![A-Za-z0-9]){re.escape(joint)}(?![A-Za-z0-9])", name)
        is not None
    )


def _whole(columns: Mapping[str, Column], n: int) -> Array | None:
    """Find an array of all joints, and return its first n columns; the others may be those of a
    gripper. None if there is none."""
    for name in TABLES:
        values = columns.get(name)
        if values is not None and values.ndim == 2 and values.shape[1] >= n:
            return values[:, :n] if values.dtype.kind in "fiu" else None
    return None


def _checked(
    name: str, t: Array, q: Array, by_name: bool, table: Table | None
) -> JointLog:
    """Make a log without rows that lack a number or repeat a time.

    If time runs backwards, an error is raised.
    """
    rows = np.flatnonzero(np.isfinite(t) & np.isfinite(q).all(axis=1))
    if len(rows) and abs(float(t[rows[0]])) > _NANOSECONDS:
        t = t * 1e-9
    steps = np.diff(t[rows])
    if (steps < 0).any():
        at = int(rows[int(np.argmax(steps < 0)) + 1])
        place = f"{name}, row {at}" if table is None else table.line(at)
        raise InputError(
            f"{place}: time runs backwards",
            remedy="sort the rows, or split the file",
            at=at,
        )
    rows = rows[np.append(True, steps > 0)] if len(rows) else rows
    if len(rows) < 3:
        raise InputError(
            f"{name} has {len(rows)} rows with numbers, too few for an audit",
            remedy="record more cycles",
        )
    return JointLog(name, t[rows], q[rows], by_name, len(t) - len(rows))
