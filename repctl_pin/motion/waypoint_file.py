"""Waypoints from a CSV file, and the closed path through them, whose corners are the file's lines."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from ..files import read_whole
from ..robot.task import Task
from .paths import TaskPath, waypoints

Array = NDArray[np.float64]

_LARGEST = 4_000_000


def read_waypoints(file: str | Path) -> Array:
    """Read waypoints from a CSV file: three numbers a line, x, y, z in m; a first line of names may stand.

    Returns
    -------
    (P, 3) array

    Raises
    ------
    InputError
        If the file cannot be read, or a line is not three finite numbers; the line is named.
    """
    return np.array([point for _, point in _numbered(Path(file))])


def waypoint_path(file: str) -> Callable[[Task, ArrayLike], TaskPath]:
    """Read a file of waypoints, and make the function ``(task, q0) → path`` of it; the start's orientation is held.

    Raises
    ------
    InputError
        If the file cannot be read, or its points make no closed path.
    """
    lines, points = zip(*_numbered(Path(file)), strict=True)
    waypoints(points, np.eye(3))  # complain now, before any arm is loaded
    corners = tuple(f"line {line}" for line in lines)

    def make(task: Task, q0: ArrayLike) -> TaskPath:
        path = waypoints(points, task.placement(q0).rotation, name=Path(file).name)
        return replace(path, words=file, corners=corners)

    return make


def _numbered(file: Path) -> list[tuple[int, list[float]]]:
    """Read the points, each with the number of its line."""
    lines = csv.reader(io.StringIO(read_whole(file, _LARGEST), newline=""))
    try:
        rows = [(number, row) for number, row in enumerate(lines, 1) if any(map(str.strip, row))]
    except csv.Error as error:
        raise InputError(f"cannot read waypoints from {file}: {error}") from None
    if rows and _names(rows[0][1]):
        rows = rows[1:]
    if not rows:
        raise InputError(f"{file} holds no waypoints; write x, y, z in m, one point a line")
    return [(number, _point(row, f"{file}, line {number}")) for number, row in rows]


def _names(row: list[str]) -> bool:
    """Whether a line holds names of columns: words, no numbers."""
    return all(cell.lstrip("#\"' \t")[:1].isalpha() and not np.isfinite(number(cell)) for cell in row)


def _point(row: list[str], where: str) -> list[float]:
    text = ",".join(row)
    values = [number(cell) for cell in row]
    if len(values) == 3 and np.isfinite(values).all():
        return values
    if ";" in text or len(text.split()) == 3 > len(row):
        raise InputError(f"{where}: {text!r} is not three numbers; write commas between them, and points for decimals")
    raise InputError(f"{where}: {text!r} is not three finite numbers x, y, z")


def number(text: str) -> float:
    """Read a number; nan where it is none."""
    try:
        return float(text)
    except ValueError:
        return np.nan
