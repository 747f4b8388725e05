"""Closed paths of a frame: placement and twist as functions of s in [0, 1].

s = 0 is the start and s = 1 the end, the same pose. The twist (v, ω) is the derivative of the
placement by s, in m and rad per cycle; with a period it becomes a velocity.
"""

from __future__ import annotations

import shlex
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Protocol, TypeAlias, runtime_checkable

import numpy as np
import pinocchio as pin

from ..base.arguments import (
    MOST_STEPS,
    Array,
    as_int,
    as_numbers,
    finite,
    function,
    list_of,
    positive,
    read_only,
    require_type,
    row,
    vector,
)
from ..base.errors import InputError
from .orientation import angular_velocity, rotation_matrix


@runtime_checkable
class ClosedPath(Protocol):
    """Interface of a closed path, which :class:`TaskPath` and custom classes implement.

    A path is a function of s, from 0 at the start to 1 at the end of a cycle. ``placement(s)`` is
    its pose, a ``pinocchio.SE3``, and ``twist(s)`` the derivative (6,) by s, for one number s.
    ``breaks`` are the values of s at its corners, without 0 and 1; ``name`` is shown in tables.
    """

    @property
    def name(self) -> str:
        """Display name."""

    @property
    def breaks(self) -> tuple[float, ...]:
        """Values of s in (0, 1), increasing, at which the twist or d(twist)/ds jumps."""

    def placement(self, s: float) -> pin.SE3:
        """Evaluate the placement of the frame at s in [0, 1]: position, m, and rotation."""

    def twist(self, s: float) -> Array:
        """Evaluate d(pose)/ds = (v, ω) at s in [0, 1]: (6,), m and rad per cycle, base axes."""


ArcBound: TypeAlias = Callable[[float, float], tuple[float, float]]
"""Function (a, b) → upper bounds of the length, m, and of the total rotation, rad, from s = a to b;
a < b, and no corner of the path is between them."""


@dataclass(frozen=True, eq=False, repr=False)
@read_only
class TaskPath:
    """Closed path of a frame: a curve of its origin, and a fixed or varying orientation.

    Both are functions of s, from 0 at the start to 1 at the end of a cycle. The path is checked
    when created: it must be closed, and ``slope`` and ``spin`` must be the derivatives of ``point``
    and ``rotation``.

    Attributes
    ----------
    name : str
        Display name.
    point, slope : functions of s
        p(s) (3,), m, in the base frame, and dp/ds (3,), m per cycle; p(0) = p(1).
    rotation : (3, 3) array, or function of s
        Fixed orientation in base axes; or R(s), a matrix or a scipy Rotation, with R(0) = R(1).
    breaks : tuple of float
        Corners: values of s in (0, 1), increasing, at which the twist or its derivative by s is
        discontinuous.
    spec, plane : str
        Options of the command line for this path: ``circle:0.1:180``, ``xy``. Empty for a path
        created in Python, or one without a plane.
    corners : tuple of str
        Names of the waypoints from s = 0 to 1, such as ``line 3`` for a line of a file. Empty if
        they have no names.
    spin : function of s, optional
        ω(s) with ``dR/ds = [ω]× R``, rad per cycle, base axes; by default computed by finite
        differences of R(s).
    period : float, optional
        Period, s, if the waypoints have times.
    arc : function of a and b, optional
        Upper bounds of the length, m, and of the total rotation, rad, between s = a and b. A proof
        along the path needs them. The paths of this package have such bounds; paths from the user's
        own functions do not.

    Raises
    ------
    InputError
        If the path is open, or slope or spin is not the derivative.

    Examples
    --------
    >>> here = task.placement(q0)
    >>> back = rp.TaskPath(
    ...     "back and forth",
    ...     lambda s: here.translation + [0.1 * np.sin(2 * np.pi * s), 0, 0],  # m
    ...     lambda s: np.array([0.2 * np.pi * np.cos(2 * np.pi * s), 0, 0]),  # m per cycle
    ...     here.rotation,
    ... )
    >>> back.placement(0.25).translation - here.translation
    array([0.1, 0. , 0. ])
    """

    name: str
    point: Callable[[float], Array]
    slope: Callable[[float], Array]
    rotation: Array | Callable[[float], Array]
    breaks: tuple[float, ...] = ()
    spec: str = ""
    plane: str = ""
    corners: tuple[str, ...] = ()
    spin: Callable[[float], Array] | None = None
    period: float | None = None
    arc: ArcBound | None = field(default=None, init=False)

    def __post_init__(self) -> None:
        turn = self.point if self.spin is None else self.spin
        for curve, what in ((self.point, "point"), (self.slope, "slope"), (turn, "spin")):
            function(curve, what, "a function of s that returns three numbers")
        if len(list_of(self.breaks, "breaks", "values of s")):
            vector(self.breaks, None, "breaks", "values of s")
        object.__setattr__(self, "breaks", tuple(float(s) for s in self.breaks))
        if self.period is not None:
            positive(self.period, "the period", "s")
        if not callable(self.rotation):
            object.__setattr__(self, "rotation", rotation_matrix(self.rotation))
        else:
            function(
                self.rotation, "rotation", "a rotation matrix, or a function of s that returns one"
            )
            if self.spin is None:
                object.__setattr__(self, "spin", angular_velocity(self._turned, self.breaks))
        _check(self)

    def placement(self, s: float) -> pin.SE3:
        """Evaluate the placement of the frame at s in [0, 1]: position, m, and rotation."""
        s = finite(s, "s")
        return pin.SE3(self._turned(s), np.asarray(self.point(s), float))

    def twist(self, s: float) -> Array:
        """Evaluate d(pose)/ds = (v, ω) at s in [0, 1]: (6,), m and rad per cycle, base axes."""
        s = finite(s, "s")
        return np.concatenate([self.slope(s), np.zeros(3) if self.spin is None else self.spin(s)])

    def points(self, count: int = 201) -> Array:
        """Sample the frame's positions, in the order of s: (P, 3), m.

        The samples are at ``count`` evenly spaced values of s, from 0 to 1, and at the corners.
        """
        count = as_int(count, "count", 2, MOST_STEPS)
        return np.array([self.point(s) for s in np.union1d(np.linspace(0, 1, count), self.breaks)])

    def __deepcopy__(self, memo: dict[int, Any]) -> TaskPath:
        """Return the path itself, which is immutable."""
        return self

    @property
    def options(self) -> str:
        """Options of the command line that create this path; empty if there are none."""
        path = f"--path {shlex.quote(self.spec)}" if self.spec else ""
        return f"{path} --plane {self.plane}" if path and self.plane else path

    def as_dict(self) -> dict[str, Any]:
        """Collect the path's name, spec and plane in plain Python types, for JSON."""
        return {"path": self.name, "path_spec": self.spec or None, "plane": self.plane or None}

    def __repr__(self) -> str:
        turning = "varying orientation" if callable(self.rotation) else "fixed orientation"
        period = "" if self.period is None else f", {self.period:g} s"
        return f"<TaskPath {self.name}: {turning}, {len(self.breaks)} corners{period}>"

    @property
    def length(self) -> float:
        """Length of one cycle, m."""
        return float(np.linalg.norm(np.diff(self.points(1001), axis=0), axis=1).sum())

    def _turned(self, s: float) -> Array:
        R = self.rotation(s) if callable(self.rotation) else self.rotation
        R = R.as_matrix() if hasattr(R, "as_matrix") else R
        if np.shape(R) != (3, 3):
            rotation_matrix(R, f"{self.name}: rotation({s:.3g})")  # raises
        return np.asarray(R, float)


def closed_path(path: Any) -> TaskPath:
    """Require a closed path; a custom class is checked and converted to a :class:`TaskPath`.

    Raises
    ------
    InputError
        If the value is not a path, is open, or its twist is not the derivative of its placement.
    """
    if isinstance(path, TaskPath):
        return path
    require_type(path, ClosedPath, "path", "a closed path, such as rp.circle(task, q0)")
    return TaskPath(
        str(path.name),
        lambda s: path.placement(s).translation,
        lambda s: np.asarray(path.twist(s), float)[:3],
        lambda s: path.placement(s).rotation,
        tuple(path.breaks),
        spin=lambda s: np.asarray(path.twist(s), float)[3:],
    )


def with_arc(path: TaskPath, arc: ArcBound | None) -> TaskPath:
    """Set the attribute ``arc`` of a path, and return the path itself, not a copy.

    Call the function only on a path that nothing else uses yet, since paths are immutable. ``arc``
    is the function (a, b) → upper bounds of the length, m, and of the rotation, rad, from s = a to
    b; None if there are no such bounds.
    """
    object.__setattr__(path, "arc", arc)
    return path


def renamed(path: TaskPath, **names: Any) -> TaskPath:
    """Copy a path with another ``name``, ``spec``, ``plane`` or ``corners``, and with its ``arc``.

    ``dataclasses.replace`` would check the same curve again, and drop ``arc``.
    """
    copy = object.__new__(type(path))
    vars(copy).update(vars(path) | names)
    return copy


def _check(path: TaskPath) -> None:
    """Raise InputError unless a path is closed and its twist is the derivative of its placement."""
    knots = np.array([0.0, *path.breaks, 1.0])
    if not (np.diff(knots) > 0).all():
        raise InputError(
            f"{path.name}: breaks must increase between s = 0 and 1, both excluded; "
            f"got {path.breaks}"
        )
    samples = _inner_points(knots)
    for s in (0.0, *(s + x for s, e in samples for x in (-e, 0.0, e)), 1.0):
        _require_values(path, s)
    start = path.point(0.0)
    size = max(float(np.abs([path.point(s) - start for s, _ in samples]).max()), 1e-3)
    _check_closed(path, size)
    _check_twist(path, size, samples)


_PARTS = ((slice(3), "m", "point", "slope"), (slice(3, 6), "rad", "rotation", "spin"))
"""Rows of the position and of the rotation in a twist: unit, curve, and its derivative."""


def _check_closed(path: TaskPath, size: float) -> None:
    """Raise InputError unless a path of this size, m, ends at the placement where it begins."""
    gap = _difference(path.placement(0.0), path.placement(1.0))
    for part, unit, curve, _ in _PARTS:
        off = np.linalg.norm(gap[part])
        if not off <= 1e-6 * (size if curve == "point" else 1.0):
            raise InputError(
                f"{path.name} is open: {curve}(1) differs from {curve}(0) by {off:.3g} {unit}; "
                "let the path end where it begins"
            )


def _check_twist(path: TaskPath, size: float, samples: list[tuple[float, float]]) -> None:
    """Raise InputError unless the twist is the derivative of the placement at samples (s, e).

    The twist is compared with central differences of the placement between s − e and s + e: with a
    wrong derivative, every motion would miss its path. ``size`` is the extent of the path, m, from
    which the tolerance is computed.
    """
    twists = np.array([path.twist(s) for s, _ in samples])
    differences = np.array(
        [_difference(path.placement(s - e), path.placement(s + e)) / (2 * e) for s, e in samples]
    )
    for part, unit, curve, rate in _PARTS:
        off = np.linalg.norm(twists[:, part] - differences[:, part], axis=1)
        worst = int(np.argmax(off))
        if not off[worst] <= 1e-3 * np.abs(differences).max() + 1e-6 * size:
            raise InputError(
                f"{path.name}: at s = {samples[worst][0]:.3g}, {rate} is "
                f"{row(twists[worst, part])} {unit} per cycle, but differences of {curve}(s) give "
                f"{row(differences[worst, part])}; correct {rate} or {curve}"
            )


def _inner_points(knots: Array) -> list[tuple[float, float]]:
    """Choose 16 values s away from the knots: pairs (s, step of a finite difference at s).

    ``knots`` are 0, the values of s at the corners, and 1.
    """
    samples = []
    for j in range(16):
        i = j * (len(knots) - 1) // 16
        width = knots[i + 1] - knots[i]
        samples.append((knots[i] + width * (0.1 + 0.8 * (0.618 * j % 1)), 1e-5 * width))
    return samples


def _require_values(path: TaskPath, s: float) -> None:
    """Raise InputError unless a path's functions return a rotation and finite numbers at s."""
    if callable(path.rotation):
        rotation_matrix(path.rotation(s), f"{path.name}: rotation({s:.3g})")
    for f in (path.point, path.slope, path.point if path.spin is None else path.spin):
        value = as_numbers(f(s))
        if value is None or value.shape != (3,) or not np.isfinite(value).all():
            raise InputError(
                f"{path.name}: "
                f"{'point' if f is path.point else 'slope' if f is path.slope else 'spin'}"
                f"({s:.3g}) must be three finite numbers"
            )


def _difference(a: pin.SE3, b: pin.SE3) -> Array:
    """Compute the displacement from placement a to b: (6,), base axes.

    It is a translation, m, and a rotation vector, rad.
    """
    return np.concatenate([b.translation - a.translation, pin.log3(b.rotation @ a.rotation.T)])


@dataclass(frozen=True, eq=False)
@read_only
class Cycle:
    """One cycle of a motion that ends in its start configuration.

    Attributes
    ----------
    start : (n,) array
        Configuration at the start and the end, rad or m.
    path : TaskPath
        Path of the frame.
    period : float
        Period, s.
    """

    start: Array
    path: TaskPath
    period: float
