"""Circles, figure eights and roses that start at the frame's position."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, TypeAlias

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..base.arguments import Array, as_int, finite, positive, require_type, shown, vector
from ..base.errors import InputError
from ..model.task import Task, require_task
from .orientation import facing
from .task_path import TaskPath, with_arc

Normal = Literal["x", "y", "z", "-x", "-y", "-z", "xy", "yz", "xz", "-xy", "-yz", "-xz"]
"""Normal of a path's plane, or the plane itself; a minus sign reverses the normal."""

PLANES: dict[str, tuple[int, int]] = {"xy": (0, 1), "yz": (1, 2), "xz": (0, 2)}
_Curve: TypeAlias = Callable[[float], Array]
_MOST_PETALS = 1001
_RADIUS = "the radius of a path"
_NORMALS = {"z": "xy", "x": "yz", "y": "-xz"}  # about y, from z to x


def circle(
    task: Task,
    q0: ArrayLike,
    radius: float = 0.1,
    *,
    normal: Normal = "z",
    start_angle: float = 0.0,
    rotation: Literal["fixed", "tangent"] | ArrayLike = "fixed",
) -> TaskPath:
    """Create a circle that starts at the frame's position at q0.

    Parameters
    ----------
    task
        Task whose frame moves.
    q0 : (n,) array
        Start configuration, rad (m for prismatic joints).
    radius
        Radius, m.
    normal
        Axis of the circle, ``x``, ``y`` or ``z`` of the base, around which the frame moves in the
        positive sense; or the plane of the circle, such as ``xz`` for a motion from x towards z,
        ``yz`` or ``xy``. A minus sign, as in ``-z``, reverses the motion.
    start_angle
        Angle α of the start on the circle, rad, counted from the plane's first axis in the
        direction of the motion. In the plane xy, the centre is at ``p − radius (cos α, sin α)``,
        where p is the start.
    rotation
        ``fixed`` keeps the orientation at q0. ``tangent`` rotates the frame with the direction of
        the circle, a full turn per cycle, for which repeatability is not guaranteed. A point (3,),
        m in the base frame, is faced all along: seen in the frame's axes, its direction is
        constant.

    Returns
    -------
    TaskPath

    Raises
    ------
    InputError
        If the radius is not positive, the plane is unknown, or the path passes through the point
        that it faces.

    Examples
    --------
    >>> path = rp.circle(task, q0, radius=0.2)
    >>> round(path.length, 3)  # m
    1.257
    """
    radius = positive(radius, _RADIUS, "m")
    start_angle = finite(start_angle, "start_angle", "rad")
    here, e1, e2, plane = _frame(task, q0, normal)

    def around(angle: float) -> Array:
        return radius * (np.cos(angle) * e1 + np.sin(angle) * e2)

    def point(s: float) -> Array:
        return center + around(start_angle + 2 * np.pi * s)

    def slope(s: float) -> Array:
        return 2 * np.pi * around(start_angle + 2 * np.pi * s + np.pi / 2)

    center = here.translation - around(start_angle)
    name = f"circle of radius {radius:g} m in {plane}"
    if not isinstance(rotation, str):
        return _facing(name, point, slope, here.rotation, rotation, 2 * np.pi * radius)
    if rotation not in ("fixed", "tangent"):
        raise InputError(
            f"rotation must be 'fixed', 'tangent' or a point to face, not {rotation!r}"
        )
    if rotation == "fixed":
        fixed = TaskPath(name, point, slope, here.rotation)
        return with_arc(fixed, lambda a, b: (2 * np.pi * radius * (b - a), 0.0))
    axis = np.cross(e1, e2)
    turning = TaskPath(
        f"{name}, tangent orientation",
        point,
        slope,
        lambda s: pin.exp3(2 * np.pi * s * axis) @ here.rotation,
        spin=lambda s: 2 * np.pi * axis,
    )
    return with_arc(turning, lambda a, b: (2 * np.pi * radius * (b - a), 2 * np.pi * (b - a)))


def _facing(
    name: str, point: _Curve, slope: _Curve, start: Array, target: ArrayLike, length: float
) -> TaskPath:
    """Create a path of constant speed whose frame always faces the point ``target`` (3,), m.

    Points are in the base frame. ``name`` is the display name of the curve, ``point`` and ``slope``
    are p(s), m, and dp/ds, ``start`` is R(0), and ``length`` the length of the path, m.
    """
    target = vector(target, 3, "rotation, as a point to face,")
    R, spin, turn = facing(target, point, slope, start)
    to = ", ".join(f"{v:g}" for v in target)
    path = TaskPath(f"{name}, facing ({to})", point, slope, R, spin=spin)
    return with_arc(path, lambda a, b: (length * (b - a), turn(a, length * (b - a))))


def figure_eight(
    task: Task,
    q0: ArrayLike,
    radius: float = 0.1,
    *,
    normal: Normal = "z",
    start_angle: float = 0.0,
) -> TaskPath:
    """Create a figure eight (Gerono's lemniscate) that crosses itself at the start.

    Parameters
    ----------
    task
        Task whose frame moves.
    q0 : (n,) array
        Start configuration, rad (m for prismatic joints).
    radius
        Half of the extent along the long axis, m.
    normal
        Normal of the curve's plane, ``x``, ``y`` or ``z`` of the base, or the plane: ``yz``,
        ``xz``, ``xy``. A minus sign, as in ``-z``, mirrors the curve at the plane's first axis.
    start_angle
        Direction of the long axis, rad from the plane's first axis, such as x for ``z``.

    Returns
    -------
    TaskPath

    Raises
    ------
    InputError
        If the radius is not positive, or the plane is unknown.

    Examples
    --------
    >>> path = rp.figure_eight(task, q0, radius=0.1)
    >>> begin, half = path.placement(0.0), path.placement(0.5)
    >>> np.allclose(begin.translation, half.translation)  # it crosses itself at the start
    True
    """
    radius = positive(radius, _RADIUS, "m")
    start_angle = finite(start_angle, "start_angle", "rad")
    here, e1, e2, plane = _frame(task, q0, normal)
    along = np.cos(start_angle) * e1 + np.sin(start_angle) * e2
    across = -np.sin(start_angle) * e1 + np.cos(start_angle) * e2
    turn = 2 * np.pi
    path = TaskPath(
        f"figure eight of half-length {radius:g} m in {plane}",
        lambda s: (
            here.translation
            + radius * (np.sin(turn * s) * along + 0.5 * np.sin(2 * turn * s) * across)
        ),
        lambda s: radius * turn * (np.cos(turn * s) * along + np.cos(2 * turn * s) * across),
        here.rotation,
    )
    return with_arc(path, lambda a, b: (np.sqrt(2) * radius * turn * (b - a), 0.0))


def rose(
    task: Task, q0: ArrayLike, radius: float = 0.1, *, petals: int = 3, normal: Normal = "z"
) -> TaskPath:
    """Create a rose, ρ = radius · sin(petals · φ) in polar coordinates around the start.

    φ is counted from the first axis of the plane.

    Parameters
    ----------
    task
        Task whose frame moves.
    q0 : (n,) array
        Start configuration, rad (m for prismatic joints).
    radius
        Length of a petal, m.
    petals
        Number of petals, odd.
    normal
        Normal of the rose's plane, ``x``, ``y`` or ``z`` of the base, or the plane: ``yz``,
        ``xz``, ``xy``. A minus sign, as in ``-z``, mirrors the rose at the plane's first axis.

    Returns
    -------
    TaskPath

    Raises
    ------
    InputError
        If the radius is not positive, the number of petals is even, or the plane is unknown.

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
        raise InputError(f"a rose requires an odd number of petals, not {petals}")
    here, e1, e2, plane = _frame(task, q0, normal)

    def ray(angle: float) -> Array:
        return np.cos(angle) * e1 + np.sin(angle) * e2

    def slope(s: float) -> Array:
        phase = petals * np.pi * s
        outward = petals * np.cos(phase) * ray(np.pi * s)
        across = np.sin(phase) * ray(np.pi * (s + 0.5))
        return radius * np.pi * (outward + across)

    path = TaskPath(
        f"rose of {petals} petals, {radius:g} m, in {plane}",
        lambda s: here.translation + radius * np.sin(petals * np.pi * s) * ray(np.pi * s),
        slope,
        here.rotation,
    )
    return with_arc(path, lambda a, b: (radius * np.pi * petals * (b - a), 0.0))


def _frame(task: Task, q0: ArrayLike, normal: str) -> tuple[pin.SE3, Array, Array, str]:
    """Return the frame's placement at q0 (n,), and the path's plane: two unit vectors, its name.

    ``normal`` is the axis or plane that the user gave, such as "-z" or "xz"; the name of the plane
    is xy, yz or xz, with the axes of the base frame. The vectors (3,) are along these two axes, in
    that order. For ``-xy``, ``-yz``, ``-xz`` and ``-z``, ``-x``, ``y``, the second vector is
    reversed, and so is the direction of a circle: about y, a circle leads from z to x.
    """
    normal = require_type(
        normal, str, "normal", "an axis, 'x', 'y' or 'z', or a plane, 'xy', 'yz' or 'xz'"
    )
    bare = normal.removeprefix("-")
    meant = _NORMALS.get(bare, bare)
    plane = meant.removeprefix("-")
    if plane not in PLANES:
        raise InputError(
            f"there is no plane {shown(normal)}; choose from {', '.join(PLANES)}, "
            "or give a normal: x, y, z, -x, -y, -z"
        )
    first, second = (np.eye(3)[k] for k in PLANES[plane])
    back = normal.startswith("-") != meant.startswith("-")
    return require_task(task).placement(q0), first, -second if back else second, plane
