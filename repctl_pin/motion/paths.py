"""Closed paths of the frame: where it should be, and how fast it should move, at s in [0, 1]."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from ..arguments import positive, wanted, whole
from ..errors import InputError
from ..robot.task import Task, wanted_task

Array = NDArray[np.float64]

PLANES: dict[str, tuple[int, int]] = {"xy": (0, 1), "yz": (1, 2), "xz": (0, 2)}
_NORMALS = {"z": "xy", "x": "yz", "y": "xz"}


@runtime_checkable
class ClosedPath(Protocol):
    """What :func:`follow` asks of a path: a :class:`TaskPath` has it, and so may a class of your own."""

    @property
    def name(self) -> str:
        """What a person would call it."""
        ...

    @property
    def breaks(self) -> tuple[float, ...]:
        """Values of s in (0, 1) where the twist jumps."""
        ...

    def placement(self, s: float) -> pin.SE3:
        """Where the frame should be at s."""
        ...

    def twist(self, s: float) -> Array:
        """Evaluate d(pose)/ds: (6,), m and rad a cycle, world axes."""
        ...


@dataclass(frozen=True)
class TaskPath:
    """A closed path: a curve of the frame's origin, the orientation held.

    Attributes
    ----------
    name : str
        What a person would call it.
    point, slope : functions of s
        p(s), m, and dp/ds, m a cycle; p(0) = p(1).
    rotation : (3, 3) array
        The orientation held.
    breaks : tuple of float
        Values of s in (0, 1) where dp/ds jumps: corners.
    words, plane : str
        What the command line calls it: ``circle:0.1:180``, ``xy``. Empty for a path made in Python, and where
        it lies in no plane of its own.
    corners : tuple of str
        What the corners are called, from the start to the end: lines of a file. Empty where they have no names.
    """

    name: str
    point: Callable[[float], Array]
    slope: Callable[[float], Array]
    rotation: Array
    breaks: tuple[float, ...] = ()
    words: str = ""
    plane: str = ""
    corners: tuple[str, ...] = ()

    def placement(self, s: float) -> pin.SE3:
        """Where the frame should be at s."""
        return pin.SE3(self.rotation, self.point(s))

    def twist(self, s: float) -> Array:
        """Evaluate d(pose)/ds: (6,), m and rad a cycle, world axes."""
        return np.concatenate([self.slope(s), np.zeros(3)])

    def points(self, count: int = 201) -> Array:
        """Sample the curve, corners included: (≥ count, 3), m."""
        return np.array([self.point(s) for s in np.union1d(np.linspace(0, 1, count), self.breaks)])

    @property
    def options(self) -> str:
        """The options that make the command line draw it again; empty where there are none."""
        path = f"--path {shlex.quote(self.words)}" if self.words else ""
        return f"{path} --plane {self.plane}" if path and self.plane else path

    def as_dict(self) -> dict[str, Any]:
        """Say what it is called, in plain Python types."""
        return {"path": self.name, "path_words": self.words or None, "plane": self.plane or None}

    @property
    def length(self) -> float:
        """Length of one cycle, m."""
        return float(np.linalg.norm(np.diff(self.points(1001), axis=0), axis=1).sum())


def circle(task: Task, q0: ArrayLike, radius: float = 0.1, *, normal: str = "z", start_angle: float = 0.0) -> TaskPath:
    """Draw a circle that starts where the frame is at q0.

    Parameters
    ----------
    task, q0
        The task and the start.
    radius
        In m.
    normal
        The axis it goes round: ``x``, ``y`` or ``z``, ``-z`` the other way round; or name its plane:
        ``yz``, ``xz``, ``xy``.
    start_angle
        Where on the circle the start lies, rad from the plane's first axis: the centre is at
        ``p − radius (cos, sin)``.

    Returns
    -------
    TaskPath

    Raises
    ------
    InputError
        If the radius is not positive or the plane has no such name.
    """
    radius = _positive(radius, "radius")
    here, e1, e2 = _frame(task, q0, normal)

    def around(angle: float) -> Array:
        return radius * (np.cos(angle) * e1 + np.sin(angle) * e2)

    center = here.translation - around(start_angle)
    return TaskPath(
        f"circle of radius {radius:g} m in {_plane(normal)}",
        lambda s: center + around(start_angle + 2 * np.pi * s),
        lambda s: 2 * np.pi * around(start_angle + 2 * np.pi * s + np.pi / 2),
        here.rotation,
    )


def figure_eight(
    task: Task, q0: ArrayLike, radius: float = 0.1, *, normal: str = "z", start_angle: float = 0.0
) -> TaskPath:
    """Draw a figure eight (Gerono's lemniscate) of half-length ``radius``, m, crossing at the start.

    Returns
    -------
    TaskPath
    """
    radius = _positive(radius, "radius")
    here, e1, e2 = _frame(task, q0, normal)
    along = np.cos(start_angle) * e1 + np.sin(start_angle) * e2
    across = -np.sin(start_angle) * e1 + np.cos(start_angle) * e2
    turn = 2 * np.pi
    return TaskPath(
        f"figure eight of half-length {radius:g} m in {_plane(normal)}",
        lambda s: here.translation + radius * (np.sin(turn * s) * along + 0.5 * np.sin(2 * turn * s) * across),
        lambda s: radius * turn * (np.cos(turn * s) * along + np.cos(2 * turn * s) * across),
        here.rotation,
    )


def rose(task: Task, q0: ArrayLike, radius: float = 0.1, *, petals: int = 3, normal: str = "z") -> TaskPath:
    """Draw a rose ρ = radius · sin(petals · φ), an odd number of petals, from its centre at the start.

    Returns
    -------
    TaskPath
    """
    radius = _positive(radius, "radius")
    if whole(petals, "petals", 1) % 2 == 0:
        raise InputError(f"a rose closes in half a turn with an odd number of petals, not {petals}")
    here, e1, e2 = _frame(task, q0, normal)

    def ray(angle: float) -> Array:
        return np.cos(angle) * e1 + np.sin(angle) * e2

    return TaskPath(
        f"rose of {petals} petals, {radius:g} m, in {_plane(normal)}",
        lambda s: here.translation + radius * np.sin(petals * np.pi * s) * ray(np.pi * s),
        lambda s: (
            radius
            * np.pi
            * (
                petals * np.cos(petals * np.pi * s) * ray(np.pi * s)
                + np.sin(petals * np.pi * s) * ray(np.pi * (s + 0.5))
            )
        ),
        here.rotation,
    )


def polygon(task: Task, q0: ArrayLike, corners: ArrayLike, *, name: str = "polygon") -> TaskPath:
    """Draw a closed polygon from where the frame is at q0, at constant speed.

    Parameters
    ----------
    task, q0
        The task and the start.
    corners : (P, 3) array
        The other corners, in m *from the start*, in order; the path returns to the start by itself.

    Returns
    -------
    TaskPath

    Raises
    ------
    InputError
        If there are fewer than two other corners, or two in a row coincide.
    """
    offsets = _points(corners, "corners")
    if len(offsets) < 2:
        raise InputError("a polygon needs at least two corners beside the start")
    start = wanted_task(task).placement(q0)
    return _polyline(np.vstack([np.zeros(3), offsets, np.zeros(3)]) + start.translation, start.rotation, name)


def waypoints(points: ArrayLike, rotation: ArrayLike, *, name: str = "waypoints") -> TaskPath:
    """Join waypoints (P, 3), m in the base frame, by straight lines at constant speed.

    The path is closed: the last point repeats the first. Bring the arm there with :func:`solve_ik`.

    Returns
    -------
    TaskPath

    Raises
    ------
    InputError
        If there are fewer than four points, numbers that are not finite, or the path is open.
    """
    corners = _points(points, "waypoints")
    if len(corners) < 4:
        raise InputError(f"a closed path needs at least 4 waypoints (the last repeats the first), not {len(corners)}")
    size = float(np.ptp(corners, axis=0).max())
    gap = float(np.linalg.norm(corners[-1] - corners[0]))
    if gap > 1e-6 * max(size, 1e-3):
        raise InputError(f"the path is open by {gap:.3g} m; end it with its first point again")
    corners = np.vstack([corners[:-1], corners[0]])
    return _polyline(corners, np.asarray(rotation, float), name)


def _polyline(corners: Array, rotation: Array, name: str) -> TaskPath:
    """Join corners (P, 3), the last equal to the first, by straight lines at constant speed."""
    edges = np.diff(corners, axis=0)
    lengths = np.linalg.norm(edges, axis=1)
    if (lengths < 1e-9).any():
        at = int(np.argmin(lengths))
        raise InputError(f"{name}: points {at + 1} and {at + 2} are the same; leave one out")
    knots = np.concatenate([[0.0], np.cumsum(lengths) / lengths.sum()])
    knots[-1] = 1.0

    def edge_at(s: float) -> int:
        return int(np.clip(np.searchsorted(knots, s, side="right") - 1, 0, len(edges) - 1))

    def point(s: float) -> Array:
        i = edge_at(s)
        return corners[i] + edges[i] * (s - knots[i]) / (knots[i + 1] - knots[i])

    def slope(s: float) -> Array:
        i = edge_at(s)
        return edges[i] / (knots[i + 1] - knots[i])

    return TaskPath(name, point, slope, rotation, tuple(float(k) for k in knots[1:-1]))


def _frame(task: Task, q0: ArrayLike, normal: str) -> tuple[pin.SE3, Array, Array]:
    """The start's placement and the two axes of the path's plane."""
    first, second = PLANES[_plane(normal)]
    way = -1.0 if normal.startswith("-") else 1.0
    return wanted_task(task).placement(q0), np.eye(3)[first], way * np.eye(3)[second]


def _plane(normal: str) -> str:
    normal = wanted(normal, str, "normal", "an axis, 'x', 'y' or 'z', or a plane, 'xy', 'yz' or 'xz'")
    bare = normal.removeprefix("-")
    plane = _NORMALS.get(bare, bare)
    if plane not in PLANES:
        raise InputError(f"no plane {normal!r}; there is {', '.join(PLANES)} (or a normal: x, y, z, -z …)")
    return plane


def _positive(value: float, what: str) -> float:
    return positive(value, f"the {what} of a path", "m")


def _points(values: ArrayLike | Sequence, what: str) -> Array:
    try:
        points = np.array(values, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"{what} must be rows of three numbers, x, y, z in m") from None
    if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
        raise InputError(f"{what} must be rows of three finite numbers, x, y, z in m")
    return points
