"""Closed curves that start where the frame is: circles, figures of eight, roses."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..arguments import Array, as_int, finite, positive, require_type, shown, vector
from ..errors import InputError
from ..robot.task import Task, require_task
from .orientation import facing, turning_about
from .task_path import TaskPath

Normal = Literal["x", "y", "z", "-x", "-y", "-z", "xy", "yz", "xz", "-xy", "-yz", "-xz"]
"""Normal of a path's plane, or the plane; with a minus sign the other direction."""

PLANES: dict[str, tuple[int, int]] = {"xy": (0, 1), "yz": (1, 2), "xz": (0, 2)}
_MOST_PETALS = 1001
_RADIUS = "the radius of a path"
_NORMALS = {"z": "xy", "x": "yz", "y": "-xz"}  # from z to x is the way round y


def circle(
    task: Task,
    q0: ArrayLike,
    radius: float = 0.1,
    *,
    normal: Normal = "z",
    start_angle: float = 0.0,
    rotation: Literal["fixed", "tangent"] | ArrayLike = "fixed",
) -> TaskPath:
    """Draw a circle that starts where the frame is at q0.

    Parameters
    ----------
    task
        Whose frame moves.
    q0 : (n,) array
        The start, rad (m for sliding joints).
    radius
        In m.
    normal
        The axis it goes round: ``x``, ``y`` or ``z``, ``-z`` the other way round; or name its
        plane: ``yz``, ``xz``, ``xy``.
    start_angle
        Where on the circle the start lies, rad from the plane's first axis: the centre is at
        ``p − radius (cos, sin)``.
    rotation
        ``fixed``; ``tangent``: the frame turns with the circle, a full turn, on which a repeatable
        control makes no promise; or a point (3,), m from the base: the frame keeps facing it as it
        does at the start.

    Returns
    -------
    TaskPath

    Raises
    ------
    InputError
        If the radius is not positive, the plane has no such name, or the path runs through the
        point it faces.

    Examples
    --------
    >>> path = rp.circle(task, q0, radius=0.2)
    >>> round(path.length, 3)  # m
    1.257
    """
    radius, start_angle = positive(radius, _RADIUS, "m"), finite(start_angle, "start_angle", "rad")
    here, e1, e2, plane = _frame(task, q0, normal)

    def around(angle: float) -> Array:
        return radius * (np.cos(angle) * e1 + np.sin(angle) * e2)

    def point(s: float) -> Array:
        return center + around(start_angle + 2 * np.pi * s)

    def slope(s: float) -> Array:
        return 2 * np.pi * around(start_angle + 2 * np.pi * s + np.pi / 2)

    center = here.translation - around(start_angle)
    name = f"circle of radius {radius:g} m in {plane}"
    if isinstance(rotation, str):
        if rotation not in ("fixed", "tangent"):
            raise InputError(
                f"rotation of a circle is 'fixed', 'tangent' or a point to face, not {rotation!r}"
            )
        if rotation == "fixed":
            return TaskPath(name, point, slope, here.rotation)
        R, spin = turning_about(np.cross(e1, e2), here.rotation)
        return TaskPath(f"{name}, turning along", point, slope, R, spin=spin)
    target = vector(rotation, 3, "rotation, as a point to face,")
    R, spin = facing(target, point, slope, here.rotation)
    return TaskPath(
        f"{name}, facing ({', '.join(f'{v:g}' for v in target)})", point, slope, R, spin=spin
    )


def figure_eight(
    task: Task,
    q0: ArrayLike,
    radius: float = 0.1,
    *,
    normal: Normal = "z",
    start_angle: float = 0.0,
) -> TaskPath:
    """Draw a figure eight (Gerono's lemniscate) of half-length ``radius``, m, crossing at the
    start.

    Parameters
    ----------
    task
        Whose frame moves.
    q0 : (n,) array
        The start, rad (m for sliding joints).
    radius
        Half the length, m.
    normal
        As for :func:`circle`.
    start_angle
        Direction of the length, rad from the plane's first axis.

    Returns
    -------
    TaskPath

    Raises
    ------
    InputError
        If the radius is not positive, or the plane has no such name.

    Examples
    --------
    >>> path = rp.figure_eight(task, q0, radius=0.1)
    >>> np.allclose(path.placement(0.0).translation, path.placement(0.5).translation)  # it crosses at the start
    True
    """
    radius, start_angle = positive(radius, _RADIUS, "m"), finite(start_angle, "start_angle", "rad")
    here, e1, e2, plane = _frame(task, q0, normal)
    along = np.cos(start_angle) * e1 + np.sin(start_angle) * e2
    across = -np.sin(start_angle) * e1 + np.cos(start_angle) * e2
    turn = 2 * np.pi
    return TaskPath(
        f"figure eight of half-length {radius:g} m in {plane}",
        lambda s: (
            here.translation
            + radius * (np.sin(turn * s) * along + 0.5 * np.sin(2 * turn * s) * across)
        ),
        lambda s: radius * turn * (np.cos(turn * s) * along + np.cos(2 * turn * s) * across),
        here.rotation,
    )


def rose(
    task: Task, q0: ArrayLike, radius: float = 0.1, *, petals: int = 3, normal: Normal = "z"
) -> TaskPath:
    """Draw a rose ρ = radius · sin(petals · φ), an odd number of petals, from its centre at the
    start.

    Parameters
    ----------
    task
        Whose frame moves.
    q0 : (n,) array
        The start, rad (m for sliding joints).
    radius
        Length of a petal, m.
    petals
        An odd number.
    normal
        As for :func:`circle`.

    Returns
    -------
    TaskPath

    Raises
    ------
    InputError
        If the radius is not positive, the petals are even, or the plane has no such name.

    Examples
    --------
    >>> from repctl_pin.paths.shapes import rose
    >>> path = rose(task, q0, radius=0.1, petals=3)
    >>> path.name
    'rose of 3 petals, 0.1 m, in xy'
    """
    radius = positive(radius, _RADIUS, "m")
    petals = as_int(petals, "petals", 1, _MOST_PETALS)
    if petals % 2 == 0:
        raise InputError(f"a rose closes in half a turn with an odd number of petals, not {petals}")
    here, e1, e2, plane = _frame(task, q0, normal)

    def ray(angle: float) -> Array:
        return np.cos(angle) * e1 + np.sin(angle) * e2

    def slope(s: float) -> Array:
        phase = petals * np.pi * s
        outward, across = (
            petals * np.cos(phase) * ray(np.pi * s),
            np.sin(phase) * ray(np.pi * (s + 0.5)),
        )
        return radius * np.pi * (outward + across)

    return TaskPath(
        f"rose of {petals} petals, {radius:g} m, in {plane}",
        lambda s: here.translation + radius * np.sin(petals * np.pi * s) * ray(np.pi * s),
        slope,
        here.rotation,
    )


def _frame(task: Task, q0: ArrayLike, normal: str) -> tuple[pin.SE3, Array, Array, str]:
    """The start's placement, the two axes of the path's plane, from the first to the second, and
    the plane's name."""
    normal = require_type(
        normal, str, "normal", "an axis, 'x', 'y' or 'z', or a plane, 'xy', 'yz' or 'xz'"
    )
    bare = normal.removeprefix("-")
    meant = _NORMALS.get(bare, bare)
    plane = meant.removeprefix("-")
    if plane not in PLANES:
        raise InputError(
            f"no plane {shown(normal)}; choose from {', '.join(PLANES)} (or a normal: x, y, z, -z …)"
        )
    first, second = (np.eye(3)[k] for k in PLANES[plane])
    back = normal.startswith("-") != meant.startswith("-")
    return require_task(task).placement(q0), first, -second if back else second, plane
