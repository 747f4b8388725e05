"""Reading of waypoints from a CSV file, and the closed path through them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..arguments import file_name
from ..errors import InputError
from ..model.task import Task
from ..tables import csv_rows, number
from .polyline import MOST_POINTS, Waypoints, waypoints
from .task_path import TaskPath

_POINT, _TURN, _TIME = ("x", "y", "z"), ("qx", "qy", "qz", "qw"), ("time",)
_LAYOUTS = (_POINT, _POINT + _TURN, _POINT + _TIME, _POINT + _TURN + _TIME)
_LARGEST = 4_000_000


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
    lines = csv_rows(file, _LARGEST)
    rows = [(line, row) for line, row in lines if any(map(str.strip, row))]
    names: tuple[str, ...] = _POINT + _TURN if rows and len(rows[0][1]) == 7 else _POINT
    if rows and _is_header(rows[0][1]):
        names = _columns(rows.pop(0)[1], file)
    if not rows:
        raise InputError(
            f"{file} contains no waypoints; write x, y, z in m, one point per line"
        )
    if len(rows) - 1 > MOST_POINTS:
        raise InputError(
            f"{file} contains {len(rows)} waypoints; reduce them to at most {MOST_POINTS}"
        )
    numbers = tuple(line for line, _ in rows)
    values = np.array(
        [_numbers(row, names, f"{file}, line {line}") for line, row in rows]
    )
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
        rotations = np.array(
            [pin.Quaternion(q).normalized().matrix() for q in quaternions]
        )
    times = column.get("time")
    if times is not None and (late := np.diff(times) <= 0).any():
        raise InputError(
            f"{file}, line {numbers[int(np.argmax(late)) + 1]}: "
            "the time must increase from line to line"
        )
    return Waypoints(
        np.stack([column[name] for name in _POINT], axis=1), rotations, times, numbers
    )


def waypoint_path(file: str, blend: float) -> Callable[[Task, ArrayLike], TaskPath]:
    """Read a file of waypoints, and return a function ``(task, q0) → path`` through them.

    Without quaternions in the file, the frame keeps its orientation at q0.

    Raises
    ------
    InputError
        If the file cannot be read, or its points are not a closed path.
    """
    table = read_waypoints(file)
    name = Path(file).name
    corners = () if blend else tuple(f"line {line}" for line in table.lines)

    def through(rotation: ArrayLike) -> TaskPath:
        path = waypoints(
            table.points, rotation, times=table.times, blend=blend, name=name
        )
        return replace(
            path, spec=file + (f":blend={blend:.15g}" if blend else ""), corners=corners
        )

    known = through(
        np.eye(3) if table.rotations is None else table.rotations
    )  # report errors before a robot is loaded
    if table.rotations is not None:
        return lambda task, q0: known
    return lambda task, q0: through(task.placement(q0).rotation)


def _is_header(row: list[str]) -> bool:
    """Test whether a line of the file is a header: words instead of numbers."""
    return all(
        cell.lstrip("#\"' \t")[:1].isalpha() and not np.isfinite(number(cell))
        for cell in row
    )


def _columns(row: list[str], file: Path) -> tuple[str, ...]:
    """Read the column names, in the order of the header, and check that the set is known."""
    names = tuple(
        {"t": "time"}.get(name, name)
        for name in (cell.strip("#\"' \t").lower() for cell in row)
    )
    if not any(sorted(names) == sorted(layout) for layout in _LAYOUTS):
        if any(";" in name for name in row):
            raise InputError(
                f"{file}: separate the columns by commas, and use decimal points"
            )
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
        raise InputError(
            f"{wrong} numbers; separate them by commas, and use decimal points"
        )
    raise InputError(f"{wrong} finite numbers {', '.join(names)}")


_COUNT = {3: "three", 4: "four", 7: "seven", 8: "eight"}
