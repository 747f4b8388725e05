"""Motions as CSV, one layout for all: ``strategy``, ``cycle``, ``time``, columns for joints and
their velocities."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..arguments import Array
from ..errors import InputError
from ..files import read_whole
from ..paths.waypoint_file import number
from .joint_motion import rows_of
from .motion import Motion
from .timing import TimedMotion

_SUFFIX = re.compile("_(velocity|acceleration)$")
_BESIDE = ("strategy", "cycle", "time")
_RUN = "run"
_CLOCKS = ("time", "t")
_LARGEST = 64_000_000


@dataclass(frozen=True)
class Recorded:
    """One strategy's motion, as a file holds it.

    Attributes
    ----------
    strategy : str
        What the file calls it, or the file's own name.
    joints : tuple of str
        The joints with a column.
    q : (T + 1, k) array
        Their positions, rad or m.
    cycles : int
        Number of cycles; T is a multiple of it.
    t : (T + 1,) array or None
        Time, s, where the file has a column of it.
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
    """Write motions of one task as CSV: s, rad or m, rad/s or m/s; cycles are counted from 0, in
    fractions.

    Parameters
    ----------
    motions
        One motion, or several, each with the name of its strategy; a timed one with accelerations,
        and no cycles.
    most
        Maximum number of rows per cycle, cycle ends included; by default all, and every digit of
        each number.
    run
        Name of the run, written into a last column if it is given.

    Raises
    ------
    InputError
        If two columns would have one name: a joint is called ``time``, or ``a_velocity`` beside
        ``a``.
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
        header, rows = [*header, _RUN], ([*row, run] for row in rows)
    _refuse_twice(header, "a CSV of this robot's joints")
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(rows)
    return out.getvalue()


def _cells(motion: Motion, most: int | None) -> Iterator[list[str]]:
    """Write the numbers of a motion, row by row: cycle, time, positions, velocities."""
    rows = rows_of(motion, most or motion.steps)
    q, qdot = motion.joints(motion.q[rows]), motion.joints(motion.qdot[rows])
    table = np.hstack([np.stack([rows / motion.steps, motion.t[rows]], axis=1), q, qdot])
    for values in table.tolist():
        yield [repr(v) if most is None else f"{v:.10g}" for v in values]


def read_motions(
    file: str | Path, known: Sequence[str], *, cycles: int | None = None
) -> list[Recorded]:
    """Read the motions of a CSV file that :func:`csv_text` wrote, or that has a column for each
    joint.

    Velocities are passed over.

    Parameters
    ----------
    file
        The file.
    known
        The robot's joints.
    cycles
        Number of cycles, where the file does not say; 1 if None.

    Raises
    ------
    InputError
        If the file cannot be read, names a joint that the robot does not have, has a column twice,
        goes back in time, or holds no whole cycles of equal steps; the line is named where there is
        one.
    """
    lines = csv.reader(io.StringIO(read_whole(file, _LARGEST), newline=""))
    where = str(file)
    try:
        names = [name if name in known else name.strip() for name in next(lines, [])]
        joints = _joints(names, known, where)
        clock = next((name for name in _CLOCKS if name in names and name not in known), None)
        columns = [names.index(name) for name in (*joints, *([clock] if clock else []))]
        groups: dict[str, list[tuple[int, float | None, list[float]]]] = {}
        for row in lines:
            if not row:
                continue
            line = f"{where}, line {lines.line_num}"
            if len(row) != len(names):
                raise InputError(f"{line}: {len(row)} cells where the header has {len(names)}")
            key = row[names.index("strategy")] if "strategy" in names else ""
            turn = _number(row[names.index("cycle")], "cycle", line) if "cycle" in names else None
            values = [_number(row[k], names[k], line) for k in columns]
            groups.setdefault(key or Path(file).stem, []).append((lines.line_num, turn, values))
    except csv.Error as error:
        raise InputError(f"{where}, line {lines.line_num}: {error}") from None
    if not groups:
        raise InputError(f"{where} holds no rows")
    return [_recorded(key, rows, joints, where, cycles) for key, rows in groups.items()]


def _recorded(
    key: str,
    rows: list[tuple[int, float | None, list[float]]],
    joints: tuple[str, ...],
    where: str,
    asked: int | None,
) -> Recorded:
    """Make one motion of its rows, round as often as asked, or as its last row says, or once."""
    line, end, _ = rows[-1]
    count = asked or (1 if end is None else round(end))
    if asked is None and end is not None and (count < 1 or abs(end - count) > 1e-6):
        raise InputError(
            f"{where}, line {line}: the motion ends in cycle {end:g}, not at the end of one"
        )
    steps, rest = divmod(len(rows) - 1, count)
    if rest or not steps:
        raise InputError(
            f"{where}: {len(rows)} rows of {key!r} are not {count} cycles of equal steps and a start"
        )
    values = np.array([numbers for _, _, numbers in rows])
    times = values[:, len(joints)] if values.shape[1] > len(joints) else None
    if times is not None and (late := np.flatnonzero(np.diff(times) <= 0)).size:
        raise InputError(f"{where}, line {rows[late[0] + 1][0]}: time does not go on")
    return Recorded(key, joints, values[:, : len(joints)], count, times)


def _joints(names: list[str], known: Sequence[str], where: str) -> tuple[str, ...]:
    """Choose the columns that hold joints."""
    _refuse_twice(names, where)
    joints = tuple(name for name in names if name in known)
    beside = {*_BESIDE, *_CLOCKS, _RUN}
    strange = [
        n for n in names if n not in known and n not in beside and _SUFFIX.sub("", n) not in known
    ]
    if strange or not joints:
        what = f"no joint {strange[0]!r}" if strange else "no column of a joint"
        raise InputError(f"{where}: the robot has {what}; its joints are {', '.join(known)}")
    return joints


def _refuse_twice(names: Sequence[str], where: str) -> None:
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(
            f"{where}: two columns are called {twice[0]!r}; each needs a name of its own"
        )


def _number(text: str, name: str, line: str) -> float:
    value = number(text)
    if not np.isfinite(value):
        raise InputError(f"{line}: {name} = {text!r} is not a finite number")
    return value
