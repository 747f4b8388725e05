"""Paths given by name: ``circle:0.1``, ``square:0.2``, ``loop.csv``.

The option ``--path`` of the commands takes such a name, called the spec of the path. A path also
depends on the robot and its start q0, so parsing returns a function of the task and q0.
"""

from __future__ import annotations

import os
from collections.abc import Callable

import numpy as np

from ..base.arguments import Array, require_type
from ..base.data_tables import number
from ..base.errors import InputError
from ..base.plugins import plugin, registered
from ..model.task import Task
from ..paths.polyline import MOST_POINTS, polygon
from ..paths.shapes import PLANES, figure_eight, rose
from ..paths.task_path import TaskPath, renamed
from ..paths.waypoint_file import waypoint_path
from .fitting_circle import circle_at, fitting_circle

_PathMaker = Callable[[Task, Array], TaskPath]
_Drawn = Callable[[Task, Array, str], TaskPath]
"""Function (task, q0, plane) that returns a path."""

_FORMS = (
    "circle:RADIUS, circle:RADIUS:DEGREES, eight:RADIUS, rose:RADIUS, square:SIDE, "
    "polygon:CORNERS:RADIUS or FILE.csv; corners are rounded by :blend=RADIUS"
)


def parse_path(text: str, plane: str | None) -> _PathMaker:
    """Parse the name of a path, and return the function ``(task, q0) → TaskPath`` that creates it.

    Parameters
    ----------
    text
        Name of the path: ``circle:RADIUS``, ``circle:RADIUS:DEGREES``, ``eight:RADIUS``,
        ``rose:RADIUS``, ``square:SIDE``, ``polygon:CORNERS:RADIUS``, a CSV file, or a shape of a
        plug-in. Lengths are in m. ``:blend=RADIUS`` at the end rounds corners. ``circle:RADIUS``
        lies where the arm can follow it, see :func:`fitting_circle`. DEGREES is the angle of the
        start on the circle, from the first axis of the plane.
    plane
        ``xy``, ``yz`` or ``xz``; by default the first plane that the task allows. For
        ``circle:RADIUS``, the default is the first one in which the arm can follow the circle. Not
        allowed with a file.

    Raises
    ------
    InputError
        If the name or the plane is unknown, a number is missing or not above 0, the file cannot be
        used, or an option does not fit the path.
    """
    if plane is not None and plane not in PLANES:
        raise InputError(f"there is no plane {plane!r}; choose from {', '.join(PLANES)}")
    # rounding of corners, for any path that has them
    words, _, blended = text.partition(":blend=")
    blend = _length(blended, text) if blended or text.endswith(":blend=") else 0.0
    # a file
    if words.lower().endswith(".csv") or os.path.isfile(words):
        if plane is not None:
            raise InputError(
                f": the points of the file {words} already lie in space",
                argument="plane",
                remedy="omit the plane",
            )
        return waypoint_path(words, blend)
    # a named shape: a circle that fits, or one with all its numbers
    kind, *parts = words.split(":")
    if blend and kind not in ("square", "polygon"):
        raise InputError(
            f"path {text!r}: only a square, a polygon and a file have corners to blend",
            remedy="omit :blend=",
        )
    if kind == "circle" and len(parts) == 1:
        radius = _length(parts[0], text)
        return lambda task, q0: fitting_circle(task, q0, plane=plane, radius=radius)
    drawn = _drawn(kind, parts, text, blend)

    def make(task: Task, q0: Array) -> TaskPath:
        flat = plane or task.kind.planes[0]
        path = require_type(
            drawn(task, q0, flat),
            TaskPath,
            f"the result of {kind!r}",
            "a closed path, such as the result of rp.circle",
        )
        return path if path.spec else renamed(path, spec=text, plane=flat)

    return make


def _drawn(kind: str, parts: list[str], text: str, blend: float) -> _Drawn:
    """Create the function ``(task, q0, plane) → path`` for the shape ``kind`` with its parameters.

    ``plane`` is ``xy``, ``yz`` or ``xz``. ``kind`` and ``parts`` are the texts between the colons,
    such as ``square`` and ``["0.2"]``. ``text`` is the whole name, for messages, and ``blend`` the
    radius of rounded corners, m. A shape can also be that of a plug-in. InputError is raised for an
    unknown shape, and for parameters that it does not have.
    """
    if kind == "circle" and len(parts) == 2:
        radius = _length(parts[0], text)
        degrees = number(parts[1])
        if not np.isfinite(degrees):
            raise InputError(
                f"path {text!r}: {parts[1]!r} is not an angle in degrees; give {_FORMS}"
            )
        return lambda task, q0, plane: circle_at(task, q0, radius, plane, degrees)
    numbers = [_length(part, text) for part in parts]
    curves: dict[str, Callable[..., TaskPath]] = {"eight": figure_eight, "rose": rose}
    if kind in curves and len(numbers) == 1:
        return lambda task, q0, plane: curves[kind](task, q0, numbers[0], normal=plane)
    if kind == "square" and len(numbers) == 1:
        side = numbers[0]
        return _polygon([(side, 0), (side, side), (0, side)], f"square of side {side:g} m", blend)
    if kind == "polygon" and len(numbers) == 2 and numbers[0] >= 3 and numbers[0].is_integer():
        return _regular_polygon(numbers[0], numbers[1], text, blend)
    others = registered("paths")
    if kind in others:
        return lambda task, q0, plane: plugin("paths", kind)(task, q0, *numbers, plane=plane)
    more = "".join(f", {name}" for name in others)
    raise InputError(f"there is no path {text!r}; give {_FORMS}{more}, lengths in m")


def _regular_polygon(corners: float, radius: float, text: str, blend: float) -> _Drawn:
    """Create the function (task, q0, plane) → path of a regular polygon on a circle of a radius, m.

    ``corners`` is the number of corners, ``text`` the whole name, for messages, and ``blend`` the
    radius of rounded corners, m.
    """
    if corners > MOST_POINTS:
        raise InputError(
            f"path {text!r} has more than {MOST_POINTS} corners; give fewer, or a circle"
        )
    count = int(corners)
    angles = 2 * np.pi * np.arange(1, count) / count
    ring = [(radius * (np.cos(a) - 1), radius * np.sin(a)) for a in angles]
    return _polygon(ring, f"{count}-gon of radius {radius:g} m", blend)


def _polygon(corners: list[tuple[float, float]], name: str, blend: float) -> _Drawn:
    """Create the function (task, q0, plane) → path of a polygon with corners (x, y), m.

    The coordinates are relative to the start, which is the corner (0, 0); ``corners`` does not
    contain it. ``blend`` is the radius of rounded corners, m, and ``name`` describes the polygon in
    reports.
    """

    def draw(task: Task, q0: Array, plane: str) -> TaskPath:
        points = np.zeros((len(corners), 3))
        points[:, PLANES[plane]] = corners
        return polygon(task, q0, points, blend=blend, name=f"{name} in {plane}")

    return draw


def _length(part: str, text: str) -> float:
    """Parse a number above 0, such as a length in m; raise InputError for any other text.

    ``part`` is the number, and ``text`` the name of the whole path, for the message.
    """
    value = number(part)
    if not (np.isfinite(value) and value > 0):
        raise InputError(
            f"path {text!r}: {part!r} is not a number above 0; give {_FORMS}, lengths in m"
        )
    return value
