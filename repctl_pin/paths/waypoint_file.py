"""Waypoints from a CSV file, and the closed path through them, whose corners are the file's
lines."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..arguments import file_name
from ..errors import InputError
from ..files import read_whole
from ..robot.task import Task
from .polyline import MOST_POINTS, Waypoints, waypoints
from .task_path import TaskPath

_POINT, _TURN, _TIME = ("x", "y", "z"), ("qx", "qy", "qz", "qw"), ("time",)
_LAYOUTS = (_POINT, _POINT + _TURN, _POINT + _TIME, _POINT + _TURN + _TIME)
_LARGEST = 4_000_000


def read_waypoints(file: str | Path) -> Waypoints:
    """Read waypoints from a CSV file: x, y, z in m, and a quaternion qx, qy, qz, qw if the frame is
    to turn.

    A first line of names says which column is which, in any order, ``time`` among them; without it
    there are three columns or seven, in the order above.

    Returns
    -------
    Waypoints
        ``points`` (P, 3), ``rotations`` and ``times`` if the file has them; :func:`waypoints` takes
        it as it is.

    Raises
    ------
    InputError
        If the file cannot be read, or a line is not as many finite numbers; the line is named.

    Examples
    --------
    >>> np.savetxt("loop.csv", [[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0]], delimiter=",")  # m
    >>> rp.read_waypoints("loop.csv").points.shape
    (4, 3)
    """
    return _read(file_name(file))


def waypoint_path(file: str, blend: float = 0.0) -> Callable[[Task, ArrayLike], TaskPath]:
    """Read a file of waypoints, and make the function ``(task, q0) → path`` of it.

    Where the file has no quaternions, the start's orientation is held.

    Raises
    ------
    InputError
        If the file cannot be read, or its points make no closed path.
    """
    table = _read(Path(file))
    name = Path(file).name
    corners = () if blend else tuple(f"line {line}" for line in table.lines)

    def through(rotation: ArrayLike) -> TaskPath:
        path = waypoints(table.points, rotation, times=table.times, blend=blend, name=name)
        return replace(path, spec=file + (f":blend={blend:.15g}" if blend else ""), corners=corners)

    known = through(
        np.eye(3) if table.rotations is None else table.rotations
    )  # complain before any arm is loaded
    if table.rotations is not None:
        return lambda task, q0: known
    return lambda task, q0: through(task.placement(q0).rotation)


def _read(file: Path) -> Waypoints:
    lines = csv.reader(io.StringIO(read_whole(file, _LARGEST), newline=""))
    try:
        rows = [(number, row) for number, row in enumerate(lines, 1) if any(map(str.strip, row))]
    except csv.Error as error:
        raise InputError(f"cannot read waypoints from {file}: {error}") from None
    names: tuple[str, ...] = _POINT + _TURN if rows and len(rows[0][1]) == 7 else _POINT
    if rows and _is_header(rows[0][1]):
        names = _columns(rows.pop(0)[1], file)
    if not rows:
        raise InputError(f"{file} holds no waypoints; write x, y, z in m, one point a line")
    if len(rows) - 1 > MOST_POINTS:
        raise InputError(
            f"{file} holds {len(rows)} waypoints; thin them out to {MOST_POINTS} or fewer"
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
                f"{file}, line {numbers[at]}: the quaternion has length {sizes[at]:.3g}; it must be 1, in the order "
                "qx, qy, qz, qw"
            )
        rotations = np.array([pin.Quaternion(q).normalized().matrix() for q in quaternions])
    times = column.get("time")
    if times is not None and (late := np.diff(times) <= 0).any():
        raise InputError(
            f"{file}, line {numbers[int(np.argmax(late)) + 1]}: the time must rise from line to line"
        )
    return Waypoints(np.stack([column[name] for name in _POINT], axis=1), rotations, times, numbers)


def _is_header(row: list[str]) -> bool:
    """Whether a line holds names of columns: words, no numbers."""
    return all(
        cell.lstrip("#\"' \t")[:1].isalpha() and not np.isfinite(number(cell)) for cell in row
    )


def _columns(row: list[str], file: Path) -> tuple[str, ...]:
    """Take the names of the columns, in any order."""
    names = tuple(
        {"t": "time"}.get(name, name) for name in (cell.strip("#\"' \t").lower() for cell in row)
    )
    if not any(sorted(names) == sorted(layout) for layout in _LAYOUTS):
        if any(";" in name for name in row):
            raise InputError(f"{file}: write commas between the columns, and points for decimals")
        called = f"the columns are called {', '.join(map(str.strip, row))}"
        meant = "x, y, z (m), and qx, qy, qz, qw, and time (s), where there are such"
        raise InputError(f"{file}: {called}; call them {meant}")
    return names


def _numbers(row: list[str], names: tuple[str, ...], where: str) -> list[float]:
    text = ",".join(row)
    values = [number(cell) for cell in row]
    if len(values) == len(names) and np.isfinite(values).all():
        return values
    wrong = f"{where}: {text!r} is not {_COUNT[len(names)]}"
    if ";" in text or len(text.split()) == len(names) > len(row):
        raise InputError(f"{wrong} numbers; write commas between them, and points for decimals")
    raise InputError(f"{wrong} finite numbers {', '.join(names)}")


_COUNT = {3: "three", 4: "four", 7: "seven", 8: "eight"}


def number(text: str) -> float:
    """Read a number; nan where it is none."""
    try:
        return float(text)
    except ValueError:
        return np.nan
