"""Motions as CSV: columns strategy, cycle, time, joints and joint velocities.

``repctl`` writes these files; the animation reads them back, and a user's own.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..base.arguments import Array, read_only
from ..base.errors import InputError
from ..base.tables import csv_rows, number, refuse_twice
from .joint_motion import rows_of
from .motion import Motion
from .timed_motion import TimedMotion

_SUFFIX = re.compile("_(velocity|acceleration)$")
_BESIDE = ("strategy", "cycle", "time")
_RUN = "run"
_CLOCKS = ("time", "t")
_LARGEST = 64_000_000


@dataclass(frozen=True, eq=False)
@read_only
class _Recorded:
    """Motion of one strategy, as stored in a file: joint positions, and times if it has them.

    Attributes
    ----------
    strategy : str
        Name of the strategy in the file, else the name of the file.
    joints : tuple of str
        Joints with a column.
    q : (T + 1, k) array
        Joint positions, rad or m.
    cycles : int
        Number of cycles; T is a multiple of it.
    t : (T + 1,) array or None
        Time, s, if the file has a column for it.
    """

    strategy: str
    joints: tuple[str, ...]
    q: Array
    cycles: int
    t: Array | None = None


def csv_text(
    motions: Motion | TimedMotion | Iterable[tuple[str, Motion]],
    *,
    most: int | None = None,
    run: str = "",
) -> str:
    """Format motions of one task as CSV, in s, rad or m, rad/s or m/s.

    The column ``cycle`` counts cycles from 0, in fractions.

    Parameters
    ----------
    motions
        One motion, or several by the names of their strategies; a timed motion has columns for
        accelerations, and none for cycles.
    most
        Maximum number of rows per cycle, cycle ends included; by default all rows, with all digits.
    run
        Text of an additional last column that names the run.

    Raises
    ------
    InputError
        If two columns would have the same name: a joint is called ``time``, or ``a_velocity``
        beside ``a``.
    """
    rows: Iterable[Sequence[object]]
    if isinstance(motions, TimedMotion):
        header = [
            "time",
            *(
                f"{name}{end}"
                for end in ("", "_velocity", "_acceleration")
                for name in motions.joints
            ),
        ]
        numbers = np.hstack([motions.t[:, None], motions.q, motions.qdot, motions.qddot])
        rows = ([repr(float(v)) for v in row] for row in numbers)
    else:
        named = list(motions) if isinstance(motions, Iterable) else [("", motions)]
        joints = named[0][1].task.robot_joints if named else ()
        beside = _BESIDE if isinstance(motions, Iterable) else _BESIDE[1:]
        header = [*beside, *joints, *(f"{name}_velocity" for name in joints)]
        rows = (
            [name, *cells] if "strategy" in beside else cells
            for name, motion in named
            for cells in _cells(motion, most)
        )
    if run:
        header = [*header, _RUN]
        rows = ([*row, run] for row in rows)
    refuse_twice(header, "a CSV of this robot's joints")
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(rows)
    return out.getvalue()


def _cells(motion: Motion, most: int | None) -> Iterator[list[str]]:
    """Format the rows of a motion as text: cycle, time, positions, velocities.

    ``most`` is the maximum number of rows per cycle; None writes all rows, with all digits.
    """
    rows = rows_of(motion, most or motion.steps)
    q = motion.joints(motion.q[rows])
    qdot = motion.joints(motion.qdot[rows])
    table = np.hstack([np.stack([rows / motion.steps, motion.t[rows]], axis=1), q, qdot])
    for values in table.tolist():
        yield [repr(v) if most is None else f"{v:.10g}" for v in values]


def read_motions(
    file: str | Path, known: Sequence[str], *, cycles: int | None = None
) -> list[_Recorded]:
    """Read the motions of a CSV file with a column per joint, such as :func:`csv_text` writes.

    Velocities are ignored.

    Parameters
    ----------
    file
        CSV file.
    known
        Joint names of the robot.
    cycles
        Number of cycles, if the file does not contain it; 1 if None.

    Raises
    ------
    InputError
        If the file cannot be read, names a joint that the robot does not have, has a column twice,
        has times that do not increase, or does not contain full cycles of equal steps; the message
        names the line.
    """
    where = str(file)
    rows = csv_rows(file, _LARGEST)
    _, header = next(rows, (1, []))
    names = [name if name in known else name.strip() for name in header]
    joints = _joints(names, known, where)
    clocks = [name for name in _CLOCKS if name in names and name not in known]
    columns = [names.index(name) for name in (*joints, *clocks[:1])]
    groups: dict[str, list[tuple[int, float | None, list[float]]]] = {}
    for at, row in rows:
        line = f"{where}, line {at}"
        if len(row) != len(names):
            raise InputError(f"{line}: {len(row)} fields, but the header has {len(names)}")
        key, turn = "", None
        if "strategy" in names:
            key = row[names.index("strategy")]
        if "cycle" in names:
            turn = _number(row[names.index("cycle")], "cycle", line)
        values = [_number(row[k], names[k], line) for k in columns]
        groups.setdefault(key or Path(file).stem, []).append((at, turn, values))
    if not groups:
        raise InputError(f"{where} contains no rows", remedy="write one row per sample")
    return [_recorded(key, rows, joints, where, cycles) for key, rows in groups.items()]


def _recorded(
    key: str,
    rows: list[tuple[int, float | None, list[float]]],
    joints: tuple[str, ...],
    where: str,
    asked: int | None,
) -> _Recorded:
    """Create the motion of one strategy from its rows: (line number, cycle, values) each.

    The cycle is None if the file has no such column. The values are the joint positions, and the
    time if the file has it. The number of cycles is ``asked``, else the last row's value of
    ``cycle``, else 1. ``key`` is the strategy's name, and ``where`` the file's, for the message.
    InputError is raised if the rows do not divide into whole cycles of equal length, or if time
    does not increase.
    """
    line, end, _ = rows[-1]
    count = asked or (1 if end is None else round(end))
    if asked is None and end is not None and (count < 1 or abs(end - count) > 1e-6):
        raise InputError(
            f"{where}, line {line}: the motion ends within a cycle, at {end:g} cycles",
            remedy="give the number of cycles",
        )
    steps, rest = divmod(len(rows) - 1, count)
    if rest or not steps:
        raise InputError(
            f"{where}: {len(rows)} rows of {key!r} are not a start "
            f"and {count} cycles of equal numbers of steps; correct the number of cycles"
        )
    values = np.array([numbers for _, _, numbers in rows])
    times = values[:, len(joints)] if values.shape[1] > len(joints) else None
    if times is not None and (late := np.flatnonzero(np.diff(times) <= 0)).size:
        raise InputError(
            f"{where}, line {rows[late[0] + 1][0]}: time must increase from row to row"
        )
    return _Recorded(key, joints, values[:, : len(joints)], count, times)


def _joints(names: list[str], known: Sequence[str], where: str) -> tuple[str, ...]:
    """Select the joint columns of a header, in its order, and refuse columns of unknown meaning.

    ``known`` are the names of the robot's joints. A column that is not read could be a misspelt
    joint.

    Raises
    ------
    InputError
        If a column is unknown or occurs twice, or there is no joint column.
    """
    refuse_twice(names, where)
    joints = tuple(name for name in names if name in known)
    beside = {*_BESIDE, *_CLOCKS, _RUN}
    strange = [
        n for n in names if n not in known and n not in beside and _SUFFIX.sub("", n) not in known
    ]
    if strange or not joints:
        what = f"the robot has no joint {strange[0]!r}" if strange else "there is no joint column"
        raise InputError(f"{where}: {what}; its joints are {', '.join(known)}")
    return joints


def _number(text: str, name: str, line: str) -> float:
    value = number(text)
    if not np.isfinite(value):
        raise InputError(f"{line}: {name} = {text!r} is not a finite number")
    return value
