"""Motions as CSV: columns strategy, cycle, time, joints and joint velocities.

``repctl`` writes such files. The animation reads them, also those that other programs wrote.

``_Recorded`` is a motion as read from a file: joint positions and, if given, times. ``CsvTable`` is
a CSV file that was read: its header and its lines of cells.
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
from ..base.data_tables import CsvTable, read_csv, refuse_twice
from ..base.errors import InputError
from .joint_motion import rows_of
from .motion import Motion
from .timed_motion import TimedMotion

_SUFFIX = re.compile("_(velocity|acceleration)$")
_BESIDE = ("strategy", "cycle", "time")
_RUN = "run"
_THIS = "a CSV of this robot's joints"
_CLOCKS = ("time", "t")
_LARGEST = 64_000_000


@dataclass(frozen=True, eq=False)
@read_only
class _Recorded:
    """Motion of one strategy as read from a file: joint positions and, if given, times.

    Attributes
    ----------
    strategy : str
        Name of the strategy in the file; without a column for it, the name of the file.
    joints : tuple of str
        Names of the k joints with a column.
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
    motions: Motion | TimedMotion | Iterable[tuple[str, Motion]], *, most: int | None = None
) -> str:
    """Format motions of one task as CSV, in s, rad or m, rad/s or m/s.

    The column ``cycle`` is the time in cycles, from 0, with fractions.

    Parameters
    ----------
    motions
        One motion, or pairs (name of the strategy, motion). A timed motion gives columns for
        accelerations too, and no column ``cycle``.
    most
        Maximum number of steps per cycle: samples are left out, but those at the ends of the cycles
        are kept, and the numbers have 10 digits. By default, and for a timed motion, all rows are
        written with all digits.

    Raises
    ------
    InputError
        If two columns would have the same name, because a joint is called ``time``, or one is
        called ``a`` and another ``a_velocity``.
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
        joints = named[0][1].task.joint_names if named else ()
        beside = _BESIDE if isinstance(motions, Iterable) else _BESIDE[1:]
        header = [*beside, *joints, *(f"{name}_velocity" for name in joints)]
        rows = (
            [name, *cells] if "strategy" in beside else cells
            for name, motion in named
            for cells in _cells(motion, most)
        )
    refuse_twice(header, _THIS)
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(rows)
    return out.getvalue()


def with_run(text: str, run: str) -> str:
    """Add a column called "run" to the text of a CSV file, with the argument ``run`` in each row.

    InputError is raised if a joint is called "run".
    """
    header, *rows = text.splitlines()
    refuse_twice([*next(csv.reader([header])), _RUN], _THIS)
    return "".join([f"{header},{_RUN}\n", *(f"{row},{run}\n" for row in rows)])


def _cells(motion: Motion, most: int | None) -> Iterator[list[str]]:
    """Yield the rows of a motion as texts: cycle, time, positions, velocities.

    ``most`` is the maximum number of steps per cycle: other rows are left out, and the numbers have
    10 digits. With None, all rows are given, with all digits.
    """
    rows = rows_of(motion, most or motion.steps)
    q = motion.q[rows]
    qdot = motion.qdot[rows]
    table = np.hstack([np.stack([rows / motion.steps, motion.t[rows]], axis=1), q, qdot])
    for values in table.tolist():
        yield [repr(v) if most is None else f"{v:.10g}" for v in values]


def read_motions(
    file: str | Path, known: Sequence[str], *, cycles: int | None = None
) -> list[_Recorded]:
    """Read the motions of a CSV file with a column per joint, rad or m.

    The result has one motion per name in the column ``strategy``, or a single one if there is no
    such column. Velocities are ignored.

    Parameters
    ----------
    file
        CSV file.
    known
        Joint names of the robot.
    cycles
        Number of cycles of each motion; by default the last value of the column ``cycle`` in the
        motion's rows, or 1 without such a column.

    Raises
    ------
    InputError
        If the file cannot be read, names a joint that the robot does not have, has a column twice,
        has times that do not increase, or does not contain full cycles of equal steps; the message
        names the line.
    """
    table = read_csv(file, known, largest=_LARGEST, rows="rows")
    joints = _joints(table.names, known, str(file))
    clocks = [name for name in _CLOCKS if name in table.names and name not in known][:1]
    turn = ["cycle"] if "cycle" in table.names and "cycle" not in known else []
    values = table.numbers([*joints, *clocks, *turn])
    rows_by_key = _rows_by_key(table, len(values))
    n = len(joints)
    made = []
    for key, rows in rows_by_key.items():
        end = float(values[rows[-1], -1]) if turn else None
        count = _count(end, cycles, table, rows[-1])
        steps, rest = divmod(len(rows) - 1, count)
        if rest or not steps:
            raise InputError(
                f"{file}: {len(rows)} rows of {key!r} do not split into one start row "
                f"and {count} cycles of equal length; give another number of cycles"
            )
        times = values[rows, n] if clocks else None
        if times is not None and (late := np.flatnonzero(np.diff(times) <= 0)).size:
            where = table.where(rows[late[0] + 1])
            raise InputError(f"{where}: time must increase from row to row; correct it")
        made.append(_Recorded(key, joints, values[rows, :n], count, times))
    return made


def _rows_by_key(table: CsvTable, count: int) -> dict[str, list[int]]:
    """Group the indices of the ``count`` rows of a table by motion: {name: indices}.

    The name of a motion is the entry in the column ``strategy`` or, if this is missing or empty,
    the name of the file.
    """
    stem = table.file.stem
    keys = [stem] * count
    if "strategy" in table.names:
        at = table.names.index("strategy")
        keys = [row[at] or stem for _, row in table.rows()]
    rows_by_key: dict[str, list[int]] = {}
    for row, key in enumerate(keys):
        rows_by_key.setdefault(key, []).append(row)
    return rows_by_key


def _count(end: float | None, asked: int | None, table: CsvTable, row: int) -> int:
    """Return the number of cycles of a motion: ``asked``, else ``end``, else 1.

    ``asked`` is the user's number, or None. ``end`` is the value of the column ``cycle`` in the
    motion's last row, or None without such a column; that row has the number ``row`` in the table.
    InputError is raised if ``end`` is used and is not a whole number.
    """
    count = asked or (1 if end is None else round(end))
    if asked is None and end is not None and (count < 1 or abs(end - count) > 1e-6):
        raise InputError(
            f"{table.where(row)}: the motion ends within a cycle, at {end:g} cycles",
            remedy="give the number of cycles (cycles=), or correct the column cycle",
        )
    return count


def _joints(names: Sequence[str], known: Sequence[str], where: str) -> tuple[str, ...]:
    """Select the names of joints from the column names of a file, in the order of the columns.

    ``names`` are the column names, ``known`` the names of the robot's joints, and ``where`` names
    the file in messages. Columns of velocities and accelerations are skipped, and so are the
    columns strategy, cycle, time, t and run.

    Raises
    ------
    InputError
        If there is no joint column, or a column has any other name, which could be a misspelt
        joint.
    """
    joints = tuple(name for name in names if name in known)
    beside = {*_BESIDE, *_CLOCKS, _RUN}
    strange = [
        n for n in names if n not in known and n not in beside and _SUFFIX.sub("", n) not in known
    ]
    if strange or not joints:
        what = f"the robot has no joint {strange[0]!r}" if strange else "there is no joint column"
        raise InputError(f"{where}: {what}; name the columns after its joints {', '.join(known)}")
    return joints
