"""A path in a few characters, as the command line takes it: ``circle:0.1``, ``square:0.2``, ``loop.csv``."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path as FilePath

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..plugins import plugin, registered
from ..robot.task import Task
from .paths import PLANES, Path, circle, figure_eight, polygon, read_waypoints, rose, waypoints

Array = NDArray[np.float64]
PathMaker = Callable[[Task, Array], Path]

FORMS = "circle:RADIUS, eight:RADIUS, rose:RADIUS, square:SIDE, polygon:CORNERS:RADIUS or FILE.csv"


def parse_path(text: str, plane: str = "xy") -> PathMaker:
    """Turn a path's short form into a function ``(task, q0) → Path``.

    Raises
    ------
    InputError
        If the form is unknown, a number is missing or not above 0, or the CSV cannot be used.
    """
    if plane not in PLANES:
        raise InputError(f"no plane {plane!r}; there is {', '.join(PLANES)}")
    if text.lower().endswith(".csv") or FilePath(text).is_file():
        points = read_waypoints(text)
        waypoints(points, np.eye(3))  # complain now, before any arm is loaded
        return lambda task, q0: waypoints(points, task.placement(q0).rotation, name=FilePath(text).name)
    kind, *parts = text.split(":")
    numbers = [_number(part, text) for part in parts]
    curves: dict[str, Callable[..., Path]] = {"circle": circle, "eight": figure_eight, "rose": rose}
    if kind in curves and len(numbers) == 1:
        return lambda task, q0: curves[kind](task, q0, numbers[0], normal=plane)
    if kind == "square" and len(numbers) == 1:
        side = numbers[0]
        flat = [(side, 0), (side, side), (0, side)]
        return lambda task, q0: polygon(task, q0, _in_plane(flat, plane), name=f"square of side {side:g} m in {plane}")
    if kind == "polygon" and len(numbers) == 2 and numbers[0] >= 3 and numbers[0] == int(numbers[0]):
        count, radius = int(numbers[0]), numbers[1]
        angles = 2 * np.pi * np.arange(1, count) / count
        ring = [(radius * (np.cos(a) - 1), radius * np.sin(a)) for a in angles]
        return lambda task, q0: polygon(
            task, q0, _in_plane(ring, plane), name=f"{count}-gon of radius {radius:g} m in {plane}"
        )
    others = registered("paths")
    if kind in others:
        return lambda task, q0: plugin("paths", kind)(task, q0, *numbers, plane=plane)
    more = "".join(f", {name}" for name in others)
    raise InputError(f"no path {text!r}; give {FORMS}{more}, lengths in m")


def _number(part: str, text: str) -> float:
    try:
        value = float(part)
    except ValueError:
        value = np.nan
    if not (np.isfinite(value) and value > 0):
        raise InputError(f"path {text!r}: {part!r} is not a number above 0; give {FORMS}, lengths in m")
    return value


def _in_plane(corners: list[tuple[float, float]], plane: str) -> Array:
    """Lay flat corners into a plane of the base frame: (P, 3)."""
    points = np.zeros((len(corners), 3))
    points[:, PLANES[plane]] = corners
    return points
