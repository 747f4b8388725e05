"""Reading of waypoints from a CSV file, and the closed path through them.

A line of the file (:data:`_Line`) is its number and its cells, so that errors can name it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..base.arguments import file_name
from ..base.errors import InputError
from ..base.tables import csv_rows, number
from ..model.task import Task
from .polyline import MOST_POINTS, Waypoints, waypoints
from .several_paths import several_paths
from .task_path import TaskPath

_POINT, _TURN, _TIME = ("x", "y", "z"), ("qx", "qy", "qz", "qw"), ("time",)
_TIMES = {"t": "time"}
_LAYOUTS = (_POINT, _POINT + _TURN, _POINT + _TIME, _POINT + _TURN + _TIME)
_LARGEST = 4_000_000

_Line = tuple[int, list[str]]
"""Number of a line of a file, and its cells."""


def read_waypoints(file: str | Path) -> Waypoints:
    """Read waypoints from a CSV file: x, y, z in m, and optionally a quaternion qx, qy, qz, qw.

    A header line can name the columns in any order, ``time`` included; without a header there are
    three or seven columns in the order above.

    Returns
    -------
    Waypoints
        ``points`` (P, 3), ``rotations`` and ``times`` if the file has them; an argument of
        :func:`waypoints`.

    Raises
    ------
    InputError
        If the file cannot be read, or a line has the wrong number of finite numbers; the message
        names the line.

    Examples
    --------
    >>> np.savetxt("loop.csv", [[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0]], delimiter=",")  # m
    >>> rp.read_waypoints("loop.csv").points.shape
    (4, 3)
    """
    file = file_name(file)
    return _waypoints(file, _lines(file))


def _lines(file: Path) -> list[_Line]:
    """Read the lines of a CSV file that are not empty: their numbers and cells."""
    lines = csv_rows(file, _LARGEST)
    return [(line, row) for line, row in lines if any(map(str.strip, row))]


def _waypoints(file: Path, rows: list[_Line]) -> Waypoints:
    """Read the waypoints of one frame from its columns, and check them.

    ``rows`` are the lines of the file, a header first if there is one. InputError names the line
    with a wrong number, a quaternion that is not of length 1, or a time that does not increase.
    """
    names: tuple[str, ...] = _POINT + _TURN if rows and len(rows[0][1]) == 7 else _POINT
    if rows and _is_header(rows[0][1]):
        names = _columns(rows.pop(0)[1], file)
    if not rows:
        raise InputError(f"{file} contains no waypoints; write x, y, z in m, one point per line")
    if len(rows) - 1 > MOST_POINTS:
        raise InputError(
            f"{file} contains {len(rows)} waypoints; reduce them to at most {MOST_POINTS}"
        )
    numbers = tuple(line for line, _ in rows)
    values = np.array([_numbers(row, names, f"{file}, line {line}") for line, row in rows])
    column = {name: values[:, i] for i, name in enumerate(names)}
    rotations = None
    if "qw" in column:
        quaternions = np.stack([column[name] for name in _TURN], axis=1)
        sizes = np.linalg.norm(quaternions, axis=1)
        if (off := np.abs(sizes - 1) > 1e-2).any():
            at = int(np.argmax(off))
            raise InputError(
                f"{file}, line {numbers[at]}: the quaternion has length {sizes[at]:.3g}; "
                "normalise it, in the order qx, qy, qz, qw"
            )
        rotations = np.array([pin.Quaternion(q).normalized().matrix() for q in quaternions])
    times = column.get("time")
    if times is not None and (late := np.diff(times) <= 0).any():
        raise InputError(
            f"{file}, line {numbers[int(np.argmax(late)) + 1]}: "
            "the time must increase from line to line"
        )
    return Waypoints(np.stack([column[name] for name in _POINT], axis=1), rotations, times, numbers)


def waypoint_path(file: str, blend: float) -> Callable[[Task, ArrayLike], TaskPath]:
    """Read a file of waypoints, and return a function ``(task, q0) → path`` through them.

    Without quaternions in the file, a frame keeps its orientation at q0. In a file for several
    frames, each has its own columns, ``left.x, left.y, left.z``: before the dot stands its name, or
    a part of it that is in no other frame's. A frame without columns holds still; columns without a
    dot are of the first frame.

    Raises
    ------
    InputError
        If the file cannot be read, or its points are not a closed path.
    """
    where = file_name(file)
    spec = file + (f":blend={blend:.15g}" if blend else "")
    # report errors before a robot is loaded
    made = {
        frame: _through(_waypoints(where, rows), where.name, spec, blend)
        for frame, rows in _by_frame(where, _lines(where)).items()
    }

    def path_of(task: Task, q0: ArrayLike) -> TaskPath:
        own = {_frame_of(text, task, where): path for text, path in made.items()}
        if len(own) < len(made):
            raise InputError(
                f"{where}: {' and '.join(made)} are columns of one frame",
                remedy="name each frame once",
            )
        path = several_paths(task, q0, [own.get(frame) for frame in task.frames])
        return path if path.spec else replace(path, spec=spec)

    return path_of


def _through(
    table: Waypoints, name: str, spec: str, blend: float
) -> Callable[[Task, ArrayLike], TaskPath]:
    """Return the function ``(task, q0) → path`` of the waypoints of one frame.

    The path depends on the task only if the file has no orientations: the frame then keeps that at
    q0. ``name`` and ``spec`` are its display name and its text on the command line, ``blend`` the
    radius of rounded corners, m.
    """
    corners = () if blend else tuple(f"line {line}" for line in table.lines)

    def through(rotation: ArrayLike) -> TaskPath:
        path = waypoints(table.points, rotation, times=table.times, blend=blend, name=name)
        return replace(path, spec=spec, corners=corners)

    known = through(np.eye(3) if table.rotations is None else table.rotations)
    if table.rotations is not None:
        return lambda task, q0: known
    return lambda task, q0: through(task.placement(q0).rotation)


def _by_frame(file: Path, rows: list[_Line]) -> dict[str, list[_Line]]:
    """Split the lines of a file into those of each frame, by the text before a column's dot.

    ``left.x`` is a column of the frame ``left``; a column of times is of all frames. Without dots,
    all lines stand under an empty text, which is the first frame. InputError is raised if only some
    columns name a frame.
    """
    header = rows[0][1] if rows else []
    cells = [_cell(cell).rpartition(".")[::2] for cell in header]
    frames = tuple(dict.fromkeys(frame for frame, _ in cells if frame))
    if not frames or not _is_header(header):
        return {"": rows}
    common = [name for frame, name in cells if not frame]
    if not {_TIMES.get(name.lower(), name.lower()) for name in common} <= {*_TIME}:
        raise InputError(
            f"{file}: column {common[0]!r} names no frame, but others do",
            remedy=f"write it as {frames[0]}.{common[0]}",
        )
    for line, row in rows:
        if len(row) != len(header):
            raise InputError(f"{file}, line {line}: {len(row)} cells for {len(header)} columns")
    found: dict[str, list[_Line]] = {}
    for frame in frames:
        own = [i for i, (of, _) in enumerate(cells) if of in ("", frame)]
        names = [cells[i][1] for i in own]
        later = [(line, [row[i] for i in own]) for line, row in rows[1:]]
        found[frame] = [(rows[0][0], names), *later]
    return found


def _frame_of(text: str, task: Task, file: Path) -> str:
    """Find the frame of a task that the columns ``text.x`` are of; the first one for an empty text.

    ``text`` is its name, or a beginning or part of only one frame's name; InputError otherwise.
    """
    frames = task.frames
    if text in frames or not text:
        return text or frames[0]
    meant = [frame for frame in frames if frame.startswith(text)]
    meant = meant or [frame for frame in frames if text in frame]
    if len(meant) != 1:
        raise InputError(
            f"{file}: the columns {text}.x … name {'no' if not meant else 'more than one'} frame "
            f"of {', '.join(frames)}",
            remedy="write the name of a frame, or a beginning or part of only one, before the dot",
        )
    return meant[0]


def _cell(text: str) -> str:
    """Strip a cell of a CSV file's header of blanks, quotes and the ``#`` of a comment."""
    return text.strip("#\"' \t")


def _is_header(row: list[str]) -> bool:
    """Test whether a line of the file is a header: words instead of numbers."""
    return all(_cell(cell)[:1].isalpha() and not np.isfinite(number(cell)) for cell in row)


def _columns(row: list[str], file: Path) -> tuple[str, ...]:
    """Read the column names, in the order of the header, and check that the set is known.

    Known are x, y, z, with or without qx, qy, qz, qw, and with or without time, in any order.
    """
    names = tuple(_TIMES.get(name, name) for name in (_cell(cell).lower() for cell in row))
    if not any(sorted(names) == sorted(layout) for layout in _LAYOUTS):
        if any(";" in name for name in row):
            raise InputError(f"{file}: separate the columns by commas, and use decimal points")
        called = f"the columns are named {', '.join(map(str.strip, row))}"
        meant = "x, y, z (m), and optionally qx, qy, qz, qw and time (s)"
        raise InputError(f"{file}: {called}; name them {meant}")
    return names


def _numbers(row: list[str], names: tuple[str, ...], where: str) -> list[float]:
    text = ",".join(row)
    values = [number(cell) for cell in row]
    if len(values) == len(names) and np.isfinite(values).all():
        return values
    wrong = f"{where}: {text!r} is not {_COUNT[len(names)]}"
    if ";" in text or len(text.split()) == len(names) > len(row):
        raise InputError(f"{wrong} numbers; separate them by commas, and use decimal points")
    raise InputError(f"{wrong} finite numbers {', '.join(names)}")


_COUNT = {3: "three", 4: "four", 7: "seven", 8: "eight"}
