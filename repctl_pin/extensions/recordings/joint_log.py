"""Reading of a log of joint positions: times, and one column per joint, found by name.

Logs come from many recorders. So names of columns, the unit of time and the order of the joints are
inferred; a log with several possible readings is refused. Levels are what was commanded beside the
pose: positions along the self-motion, such as the position of the elbow. Letters: T rows, n joints,
k levels.

``JointLog`` is recorded joint positions q (T, n) and their times t (T,). ``Table`` is the columns
of a file by name, all of one length, with one row per frame of a recording.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...base.arguments import Array, as_numbers, file_name, read_only
from ...base.data_tables import Table, read_table
from ...base.errors import InputError
from ...model.task import Task
from .data_sets.data_set import is_data_set
from .data_sets.joints import joints_of, open_data_set

_CLOCKS = ("time", "t", "times", "timestamp", "stamp", "sec", "secs", "seconds", "%time", "__time")
"""Names of a column of times; a unit may follow, as in ``time_ms``."""

_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
"""Units of time, s."""

_UNIT_NAMES = {"sec": "s", "secs": "s", "seconds": "s", "µs": "us"} | {u: u for u in _UNITS}
_EPOCH = (6.3e8, 4.1e9)
"""Times since 1970 that are recognised, s: from 1990 to 2100."""

_STEPS, _USUAL_STEPS = (1e-5, 100.0), (2e-4, 0.5)
"""Time steps of logs that are possible, and those that are usual, s."""

_TOO_FAST = 5.0
"""Joint speed, relative to its limit, above which a log's unit of time cannot be right."""

_TABLES = ("q", "Q", "joints", "positions", "position", "qpos", "observation.state")
"""Names of an array with the positions of all joints, one row per time."""

_LISTED = 4
_NUMBERED = re.compile(r"(.*?)(\d+)\W*$")
_WORD = re.compile(r"[a-z]+|[A-Z]+(?![a-z])|[A-Z][a-z]+")
_NO_POSITION = frozenset(
    """
    vel vels velocity velocities speed speeds dq qd qdot acc accel acceleration accelerations
    ddq qdd jerk effort efforts torque torques tau force current currents voltage power temp
    temperature error errors err deviation offset limit min max lower upper std
    """.split()  # noqa: SIM905
)
"""Words in the name of a column that holds no joint positions."""

_NOT_MEASURED = frozenset(
    """
    desired des command commands commanded cmd target reference ref goal setpoint planned
    action actions nominal
    """.split()  # noqa: SIM905
)
"""Words in the name of a column of positions that were not measured."""

_MEASURED = frozenset(
    """
    actual measured meas position positions pos state feedback present
    """.split()  # noqa: SIM905
)
"""Words in the name of a column of measured positions."""


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
        False if the joints of a file were taken in the order of its columns, or of numbers in their
        names, because no names of joints were found; else True, also for arrays.
    dropped : int
        Number of rows left out, because a number is missing or the time equals that of the previous
        row.
    read : str
        Description of the columns that were read; empty for arrays.
    levels : (T, k) array
        Commanded levels of the self-motion, rad or m; k is 0 without levels.
    """

    name: str
    t: Array
    q: Array
    by_name: bool = True
    dropped: int = 0
    read: str = ""
    levels: Array = field(default_factory=lambda: np.empty((0, 0)))


def read_joint_log(file: Any, task: Task, units: Array, levels: Sequence[str] = ()) -> JointLog:
    """Read a log of joint positions from a ``.csv``, ``.npz`` or ``.parquet`` file, or a data set.

    A file has a column of times, named ``time``, ``t`` or ``timestamp``, and a column for each
    joint. The name of the joint may be part of a longer name, such as ``panda_joint1.position``.
    Columns with the same name and a number, such as ``q1`` to ``q7``, are used in the order of the
    numbers. An array ``q`` is used in the order of its columns. Measured positions (actual,
    position, measured) are preferred to desired ones. Velocities, efforts and errors are ignored.

    The unit of time is the unit in the name of the column. Otherwise, it is the unit in which the
    times are dates from 1990 to 2100, or the only unit in which time steps and joint speeds are
    plausible for a robot.

    Parameters
    ----------
    file
        The file, or the folder or HDF5 file of a data set.
    task
        Task; its joints are read.
    units : (n,) array
        Unit of each position in the file, in rad or m, such as π/180.
    levels
        Names of the columns with the commanded levels, rad or m.

    Raises
    ------
    InputError
        If the file cannot be read, a level, a joint or the times are missing, several columns may
        be the joints, several units of time are possible, or time runs backwards. In the last case,
        the message names the line.
    """
    joints = task.joint_names
    path = file_name(file, "log")
    if is_data_set(path):
        return _of_data_set(path, task, units, levels)
    table = read_table(path, joints)
    where = str(table.file)
    clock = _clock_of(table)
    _require(table, levels)
    others = (clock, *levels)
    header = [name for name, width in table.widths.items() if width == 1 and name not in others]
    try:
        names, by_name = _columns(header, joints)
        whole = None if names else _whole(table, len(joints))
    except InputError as error:
        raise InputError(f"{where}: {error}") from None
    if names:
        taken = f"{names[0]} to {names[-1]}"
        if words_of(names[0], joints) & _NOT_MEASURED:
            taken += ", which are not measured"
    elif whole is not None:
        names, taken, by_name = [whole], whole, False
    else:
        raise _no_joints(where, header, joints)
    values = table.numbers([clock, *names, *levels], finite=False)
    log = _checked(where, values[:, 0], values[:, 1:], units, by_name, table)
    unit, epoch = _unit(log, clock, task.velocity_limit)
    said = f"{unit} since 1970" if epoch else unit
    read = f"read {clock} in {said}, and joints from {taken}"
    return replace(log, t=log.t * _UNITS[unit], read=read)


def _clock_of(table: Table) -> str:
    """Find the name of the column of times.

    InputError is raised if there is no such column, or it has not exactly one number per row.
    """
    clock = _clock(list(table.widths))
    if clock is None:
        raise InputError(
            f"{table.file}: there is no column of times among {', '.join(table.widths)}",
            remedy="name the column of times 'time', in s",
        )
    if table.widths[clock] != 1:
        raise InputError(
            f"{table.file}: the times in {clock!r} are not numbers, one per row; write them in s"
        )
    return clock


def _require(table: Table, levels: Sequence[str]) -> None:
    """Raise InputError if a column with levels is missing or has no numbers."""
    for name in levels:
        if not table.widths.get(name):
            known = [column for column, width in table.widths.items() if width]
            raise InputError(
                f"{table.file}: there is no column {name!r} with levels",
                remedy=f"name columns of numbers, among {', '.join(known)}",
            )


def _of_data_set(path: Path, task: Task, units: Array, levels: Sequence[str]) -> JointLog:
    """Read the joints of a data set as one log: its demonstrations in turn, without pauses.

    ``units`` (n,) is the unit of each position in the file, in rad or m, such as π/180. ``levels``
    are the names of the k columns with levels.
    """
    table, _ = open_data_set(path, task)
    _require(table, levels)
    try:
        name, places = joints_of(table, task)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    Q = table.numbers([name], finite=False)[:, places]
    if levels:
        Q = np.hstack([Q, table.numbers(list(levels), finite=False)])
    log = _checked(str(path), table.clock, Q, units, True, table)
    read = f"read joints from {name}; times are those of recorded frames, without pauses"
    return replace(log, read=read)


def _unit(log: JointLog, clock: str, fastest: Array) -> tuple[str, bool]:
    """Find the unit of the times in the column ``clock``: "s", "ms", "us" or "ns".

    Return the unit, and True if the times count from 1970. The first rule that applies decides:

    1. The name of the column ends in a unit.
    2. The times are dates from 1990 to 2100 in one unit only.
    3. Only one unit is plausible. A unit is plausible if the time step is that of a log, and no
       joint is over five times faster than its limit in ``fastest`` (n,), rad/s or m/s. If any unit
       gives a usual time step, 0.2 ms to 0.5 s, only such units count.
    4. No unit is plausible: the result is "s".

    InputError is raised if several units are plausible.
    """
    # steps of time, and the fastest joint relative to its limit
    steps = np.diff(log.t)
    step = float(np.median(steps))
    speeds = np.abs(np.diff(log.q, axis=0)) / steps[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = float(np.nanmax(np.quantile(speeds, 0.99, axis=0) / fastest))
    ratio = ratio if np.isfinite(ratio) else 0.0
    # units in which the times count from 1970
    since = {
        unit
        for unit, s in _UNITS.items()
        if _EPOCH[0] < log.t[0] * s < _EPOCH[1] and _STEPS[0] <= step * s <= _STEPS[1]
    }
    # a unit in the column's name decides
    named = _unit_of(clock)
    if named:
        return named, named in since
    if len(since) == 1:
        return since.pop(), True
    # else the unit in which the step is usual and the joints are not too fast
    possible = [
        unit
        for unit, s in _UNITS.items()
        if _STEPS[0] <= step * s <= _STEPS[1] and ratio / s <= _TOO_FAST
    ]
    usual = [u for u in possible if _USUAL_STEPS[0] <= step * _UNITS[u] <= _USUAL_STEPS[1]]
    units = usual or possible
    if not units:
        return "s", False  # the speeds are noted
    if len(units) == 1:
        return units[0], False
    raise InputError(
        f"{log.name}: the times in {clock!r} may be in {' or '.join(units)}",
        remedy=f"name the column {' or '.join(f'time_{unit}' for unit in units)}",
    )


def _unit_of(clock: str) -> str:
    """Return the unit at the end of a time column's name, such as ``time_ms``; empty if none."""
    words = re.findall(r"[a-zµ]+", clock.lower())
    return _UNIT_NAMES.get(words[-1], "") if len(words) > 1 else ""


def _clock(header: Sequence[str]) -> str | None:
    """Find the name of the column of times; None if there is none.

    If there are several, the result is the one whose name comes first in the list ``time``, ``t``,
    ``times``, ``timestamp``, …. A unit may follow the name, as in ``time_ms``.
    """
    bare = {
        name: re.sub(r"[ _.(\[]+(s|sec|secs|seconds|ms|us|µs|ns)[)\]]?$", "", name.lower())
        for name in header
    }
    found = [name for name in header if name.lower() in _CLOCKS or bare[name] in _CLOCKS]
    return min(found, key=lambda name: _CLOCKS.index(bare[name]), default=None)


def _no_joints(where: str, header: Sequence[str], joints: Sequence[str]) -> InputError:
    """Make the error for a file without columns of joint positions.

    ``where``, the name of the file, begins the message; ``header`` are the names of its columns,
    and ``joints`` those of the arm's joints. The message names the missing joint, or says that the
    columns are other quantities, such as velocities.
    """
    held = [j for j in joints if any(_holds(name, j) for name in header)]
    others = [name for name in header if words_of(name, joints) & _NO_POSITION]
    missing = next((joint for joint in joints if joint not in held), None)
    what = "no column is named as a joint"
    if held and missing is not None:
        what = f"no column is named {missing}"
    elif others:
        listed = ", ".join(others[:_LISTED]) + ", …" * (len(others) > _LISTED)
        what = f"there are no joint positions: the columns {listed} are other quantities"
    return InputError(f"{where}: {what}", remedy=f"name the columns {', '.join(joints)}")


def joint_log(t: Any, q: Any, units: Array, levels: Any = None) -> JointLog:
    """Check times t (T,), s, and joint positions q (T, n), and make a log of them.

    ``units`` (n,) are the units of q in rad or m, such as π/180 for degrees. ``levels``, (T,) or
    (T, k), are the commanded levels, rad or m.
    """
    times, values, n = as_numbers(t), as_numbers(q), len(units)
    sizes = None if values is None or times is None else (times.shape, values.shape)
    if sizes is None or sizes[1] != (*sizes[0], n):
        got = "values that are not" if sizes is None else f"shapes {sizes[0]} and {sizes[1]}"
        raise InputError(
            f"must be numbers: times (T,) and joint positions (T, {n}); got {got}", argument="log"
        )
    assert times is not None and values is not None
    if levels is not None:
        added = as_numbers(levels)
        if added is not None and added.ndim == 1:
            added = added[:, None]
        if added is None or added.ndim != 2 or len(added) != len(times):
            got = "values that are not numbers" if added is None else f"shape {added.shape}"
            raise InputError(
                ": the third array, the commanded levels, must have one row per time, "
                f"({len(times)}, k); got {got}",
                argument="log",
                remedy="give one or k levels, rad or m, for each time",
            )
        values = np.hstack([values, added])
    return _checked("log", times, values, units, True, None)


def _columns(header: Sequence[str], joints: Sequence[str]) -> tuple[list[str], bool]:
    """Find the columns of the joints: by name, by a part of the name, or by number.

    ``header`` are the names of the file's columns, ``joints`` those of the arm. Columns whose names
    differ in the joint only, such as ``j1.pos`` and ``j2.pos``, belong together.

    Returns
    -------
    Names of the columns, in the order of ``joints`` or, for numbered columns, of their numbers;
    empty if not found. Then True if the columns were searched for by the joints' names, False if by
    number.

    Raises
    ------
    InputError
        If several columns may be the joints.
    """
    if set(joints) <= set(header):
        return list(joints), True
    positions = [name for name in header if not words_of(name, joints) & _NO_POSITION]
    held = [[name for name in positions if _holds(name, joint)] for joint in joints]
    if any(held):
        if not all(held):
            return [], True
        forms: dict[str, list[str]] = {}
        for joint, names in zip(joints, held, strict=True):
            for name in names:
                forms.setdefault(name.replace(joint, "*"), []).append(name)
        whole = [names for names in forms.values() if len(names) == len(joints)]
        if not whole:
            whole = [[_only(names, joint) for names, joint in zip(held, joints, strict=True)]]
        return _chosen(whole, joints), True
    groups: dict[str, list[tuple[int, str]]] = {}
    for name in positions:
        if found := _NUMBERED.match(name):
            groups.setdefault(found[1], []).append((int(found[2]), name))
    fitting = [sorted(group) for group in groups.values() if len(group) == len(joints)]
    numbered = [[name for _, name in group] for group in fitting]
    return (_chosen(numbered, joints) if numbered else []), False


def _only(names: Sequence[str], joint: str) -> str:
    """Return the one column that may hold a joint's position; raise InputError if several may."""
    if len(names) > 1:
        raise InputError(
            f"several columns may be the positions of {joint}: {', '.join(names)}",
            remedy=f"rename the right one to {joint}",
        )
    return names[0]


def _chosen(sets: Sequence[Sequence[str]], joints: Sequence[str]) -> list[str]:
    """Choose the set of columns that most likely has measured positions; refuse a tie.

    Each of ``sets`` has one column's name per joint. Names with words such as "actual" come first,
    those with "desired" or "command" last. In a tie, an InputError lists the possible sets.
    """

    def rank(names: Sequence[str]) -> int:
        words = words_of(names[0], joints)
        return 2 if words & _NOT_MEASURED else 0 if words & _MEASURED else 1

    best = min(map(rank, sets))
    found = [names for names in sets if rank(names) == best]
    if len(found) > 1:
        listed = "; ".join(f"{names[0]} to {names[-1]}" for names in found)
        raise InputError(
            f"several columns may be the joint positions: {listed}",
            remedy=f"rename the right ones to {', '.join(joints)}",
        )
    return list(found[0])


def words_of(name: str, joints: Sequence[str]) -> set[str]:
    """Split a column's name, apart from a joint's name in it, into words in lower case.

    The words, such as "velocity" or "desired", say what the column contains.
    """
    for joint in joints:
        if _holds(name, joint):
            name = name.replace(joint, " ")
    return {word.lower() for word in _WORD.findall(name)}


def _holds(name: str, joint: str) -> bool:
    """Test whether a joint's name is part of a column's name, as a word of its own.

    No letter or digit may be next to the joint's name.
    """
    return re.search(rf"(?<![A-Za-z0-9]){re.escape(joint)}(?![A-Za-z0-9])", name) is not None


def _whole(table: Table, n: int) -> str | None:
    """Find the name of an array (T, n) with the positions of all n joints; None if there is none.

    The array has one of the usual names, such as ``q`` or ``joints``, and exactly n columns.
    InputError is raised in two cases: there are arrays with usual names, but all have another
    number of columns, or several have n columns and their numbers differ.
    """
    known = [name for name in _TABLES if table.widths.get(name, 0) > 1]
    found = [name for name in known if table.widths[name] == n]
    if known and not found:
        raise InputError(
            f"{known[0]!r} has {table.widths[known[0]]} columns, but the arm has {n} joints",
            remedy="keep only the columns of these joints, or give times and joints as arrays",
        )
    if len(found) > 1:
        first, *others = (table.numbers([name], finite=False) for name in found)
        if not all(np.array_equal(first, other) for other in others):
            raise InputError(
                f"several arrays may be the joint positions: {', '.join(found)}",
                remedy="keep only one of them",
            )
    return found[0] if found else None


def _checked(
    name: str, t: Array, values: Array, units: Array, by_name: bool, table: Table | None
) -> JointLog:
    """Make a log without rows that lack a number or repeat the time of the preceding row.

    The columns of ``values`` (T, n + k) are n joints, then k levels. ``units`` (n,) are the units
    of the joints in rad or m, such as π/180. ``by_name``, True if the joints were found by their
    names, is an attribute of the log. ``table`` is the file that was read, with which an error
    names the line; None for arrays. InputError is raised if time runs backwards, or fewer than
    three rows remain.
    """
    rows = np.flatnonzero(np.isfinite(t) & np.isfinite(values).all(axis=1))
    steps = np.diff(t[rows])
    if (steps < 0).any():
        at = int(rows[int(np.argmax(steps < 0)) + 1])
        place = f"{name}, row {at}" if table is None else table.where(at)
        remedy = "sort the rows, or split the file"
        if table is not None and "strategy" in table.widths:
            remedy = "keep the rows of one strategy: each has a motion of its own"
        raise InputError(f"{place}: time runs backwards", remedy=remedy, at=at)
    rows = rows[np.append(True, steps > 0)] if len(rows) else rows
    if len(rows) < 3:
        raise InputError(
            f"{name} has {len(rows)} rows with numbers, too few for an audit",
            remedy="record more cycles",
        )
    n, kept = len(units), values[rows]
    q = units * kept[:, :n]
    return JointLog(name, t[rows], q, by_name, len(t) - len(rows), levels=kept[:, n:])
