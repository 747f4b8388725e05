"""Closed paths of straight lines between waypoints, with sharp or blended corners.

A blend is a curve of continuous curvature that rounds a corner, so that the arm need not stop
there. Knots are the lengths, m, or the times from the start at which the lines and blends begin and
end. Divided by the last knot, they are values of the path parameter s, which runs from 0 to 1.

``Bend`` is a plane curve of length 1 that rounds a corner. ``_Curve`` is a function of u in [0, 1]
that returns the position p (3,), m, and dp/du (3,).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..base.arguments import Array, as_numbers, list_of, positive, read_only
from ..base.errors import InputError
from ..model.chain_formulas import as_placements
from ..model.task import Task, require_task
from .bend import Bend
from .orientation import piece_finder, rotation_matrix, smooth_turning
from .task_path import ArcBound, TaskPath, with_arc

MOST_POINTS = 3000
"""Maximum number of waypoints of a path; each requires an integration step per cycle, and a study
with 3000 takes half a minute."""

_PER_RADIAN = 0.1
"""Length of straight motion, m, that takes as long as 1 rad of rotation at constant speed."""


@dataclass(frozen=True, eq=False)
@read_only
class Waypoints:
    """Waypoints of a file: result of :func:`read_waypoints`, argument of :func:`waypoints`.

    Attributes
    ----------
    points : (P, 3) array
        Positions, m in the base frame.
    rotations : (P, 3, 3) array or None
        Orientations in base axes, if the file has quaternions.
    times : (P,) array or None
        Times of the points, s, if the file has a column ``time``.
    lines : tuple of int
        Line numbers in the file, from 1.

    Examples
    --------
    >>> loop = np.array([[0, 0, 0, 0], [1, 0.1, 0, 0], [2, 0, 0.1, 0], [3, 0, 0, 0]])  # s and m
    >>> np.savetxt("loop.csv", loop, delimiter=",", header="time,x,y,z", comments="")
    >>> found = rp.read_waypoints("loop.csv")
    >>> rp.waypoints(found, task.placement(q0).rotation).period  # s
    3.0
    """

    points: Array
    rotations: Array | None = None
    times: Array | None = None
    lines: tuple[int, ...] = ()

    def __repr__(self) -> str:
        more = [
            word
            for word, it in (("orientations", self.rotations), ("times", self.times))
            if it is not None
        ]
        return f"<{len(self.points)} Waypoints{' with ' if more else ''}{' and '.join(more)}>"


def polygon(
    task: Task, q0: ArrayLike, corners: ArrayLike, *, blend: float = 0.0, name: str = "polygon"
) -> TaskPath:
    """Create a closed polygon that starts at the frame's position at q0, at constant speed.

    Parameters
    ----------
    task
        Task whose frame moves.
    q0 : (n,) array
        Start configuration, rad (m for prismatic joints).
    corners : (P, 3) array
        Corners after the start, in order, m *from the start*, in base axes. The path returns to
        the start automatically; a single corner gives a line there and back. At a repeated corner
        the frame pauses for the time of an edge of mean length.
    blend
        Radius ρ, m, of the arcs that would round the corners. Each corner is rounded by a curve of
        continuous curvature that begins and ends where such an arc would. The path starts at the
        midpoint of the first curve, and the polygon is shifted accordingly.
    name
        Display name of the path.

    Returns
    -------
    TaskPath

    Raises
    ------
    InputError
        If ``corners`` is empty or only repeats the start, or an edge is too short for its blends.

    Examples
    --------
    >>> square = rp.polygon(task, q0, [[0.1, 0, 0], [0.1, 0.1, 0], [0, 0.1, 0]])  # m from the start
    >>> round(square.length, 3)
    0.4
    """
    offsets = _points(corners, "corners")
    start = require_task(task).placement(q0)
    path = _polyline(
        np.vstack([np.zeros(3), offsets, np.zeros(3)]) + start.translation,
        start.rotation,
        None,
        blend,
        name,
    )
    aside = start.translation - path.point(0.0)
    if not aside.any():
        return path
    moved = TaskPath(name, lambda s: path.point(s) + aside, path.slope, path.rotation, path.breaks)
    return with_arc(moved, path.arc)


def waypoints(
    points: Any,
    rotation: Any = None,
    *,
    times: ArrayLike | None = None,
    blend: float = 0.0,
    name: str = "waypoints",
) -> TaskPath:
    """Create a closed path of straight lines through waypoints.

    Orientations are interpolated smoothly between the waypoints.

    The last waypoint must repeat the first. Use :func:`solve_ik` to find a start configuration.

    Parameters
    ----------
    points : (P, 3) array, P placements, or Waypoints
        Positions, m in the base frame; or rigid transforms; or the result of
        :func:`read_waypoints`, with its orientations and times. At a repeated point the frame
        pauses: until the next of the times or, without times, for the time of an edge of mean
        length.
    rotation : (3, 3) array, or P of them
        Fixed orientation, or one orientation per point, interpolated by a spline on SO(3); matrices
        or scipy Rotations. Required for positions; not allowed with points that have orientations.
    times : (P,) array, optional
        Increasing times of the points, s; by default those of the file, else the speed is
        constant.
    blend
        Radius ρ, m, of the arcs that would round the corners. Each corner is rounded by a curve of
        continuous curvature that begins and ends where such an arc would; the path begins at the
        midpoint of the first curve. A reversal of direction stays sharp. Not allowed with times.
    name
        Display name of the path.

    Returns
    -------
    TaskPath

    Raises
    ------
    InputError
        If there are fewer than three points, numbers that are not finite, the path is open, or an
        edge is too short for its blends.

    Examples
    --------
    >>> here = task.placement(q0)
    >>> points = here.translation + np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0]])  # m
    >>> path = rp.waypoints(points, here.rotation)
    >>> path.breaks  # corners
    (0.2928932188134524, 0.7071067811865475)
    """
    if isinstance(points, Waypoints):
        if times is not None and points.times is not None:
            raise InputError("the waypoints already have times; omit times=")
        if rotation is not None and points.rotations is not None:
            raise InputError("the waypoints already have orientations; omit rotation=")
        times = points.times if times is None else times
        rotation = points.rotations if rotation is None else rotation
        points = points.points
    corners, turns = _placed(points, rotation)
    if len(corners) < 3:
        raise InputError(
            "a closed path requires at least 3 waypoints, the last of which is the first again; "
            f"got {len(corners)}"
        )
    size = max(float(np.ptp(corners, axis=0).max()), 1e-3)
    gap = float(np.linalg.norm(corners[-1] - corners[0]))
    turned = pin.log3(turns[0].T @ turns[-1])
    if gap > 1e-6 * size or np.linalg.norm(turned) > 1e-6:
        by = f"{gap:.3g} m" if gap > 1e-6 * size else f"{np.linalg.norm(turned):.3g} rad"
        raise InputError(f"the path is open by {by}; repeat the first point at the end")
    corners = np.vstack([corners[:-1], corners[0]])
    return _polyline(corners, turns[0] if len(turns) == 1 else turns, times, blend, name)


def _placed(points: Any, rotation: Any) -> tuple[Array, list[Array]]:
    """Convert waypoints to corners (P, 3), m, and a list of one orientation, or P of them.

    ``points`` are P positions, or P placements, which have orientations; ``rotation`` is then None.
    For positions, ``rotation`` is one rotation, a matrix or a scipy Rotation, or P of them.
    InputError is raised for other arguments.
    """
    if not isinstance(points, np.ndarray):
        points = list_of(points, "waypoints", "rows of three numbers")
    if _are_placements(points):
        if rotation is not None:
            raise InputError(
                "the waypoints are placements and already have orientations; omit rotation="
            )
        placements = as_placements(points, "waypoint", "a list of placements")
        corners = np.array([x.translation for x in placements])
        return corners, [x.rotation for x in placements]
    corners = _points(points, "waypoints")
    if rotation is None:
        raise InputError(
            "the waypoints have no orientations; "
            "add rotation=, such as rotation=task.placement(q0).rotation"
        )
    if hasattr(rotation, "as_matrix"):  # SciPy's, which is slow to import
        rotation = rotation.as_matrix()
    listed = isinstance(rotation, (list, tuple, np.ndarray))
    several = listed and ((matrix := _doubles(rotation)) is None or matrix.ndim > 2)
    turns = [rotation_matrix(R) for R in (rotation if several else [rotation])]
    if len(turns) not in (1, len(corners)):
        raise InputError(
            f"{len(corners)} waypoints require 1 or {len(corners)} rotations, "
            f"but rotation= has {len(turns)}"
        )
    return corners, turns


def _polyline(
    corners: Array, rotation: Array | list[Array], times: ArrayLike | None, blend: float, name: str
) -> TaskPath:
    """Create a path through corners (P, 3), m, the last equal to the first.

    ``rotation`` is one orientation (3, 3), or a list of P orientations to interpolate. ``times``
    (P,), s, determine the speed, which is constant without them; ``blend`` is the radius, m, of the
    rounded corners; ``name`` is the display name.
    """
    sizes = _edge_sizes(corners, rotation, name)
    blend = _blend_radius(blend, times)
    period = None
    if times is not None:
        at_corners = knots = _times(times, len(corners))
        edges = np.diff(corners, axis=0)
        pieces = [_line(*ends) for ends in zip(corners[:-1], edges, strict=True)]
        period = float(knots[-1])
    else:
        pieces, knots, at_corners = _rounded(corners, sizes, blend, name)
    s = knots / knots[-1]
    widths = np.diff(knots) / knots[-1]

    piece = piece_finder(s, widths)

    def point(x: float) -> Array:
        i, u = piece(x)
        return pieces[i](u)[0]

    def slope(x: float) -> Array:
        i, u = piece(x)
        return pieces[i](u)[1] / widths[i]

    breaks = tuple(float(x) for x in s[1:-1])
    if not isinstance(rotation, list):
        path = TaskPath(name, point, slope, rotation, breaks, period=period)
        return with_arc(path, _arc(pieces, s, None))
    try:
        R, spin, turned = smooth_turning(at_corners / knots[-1], rotation)
    except InputError as error:
        raise InputError(f"{name}: {error}") from None
    path = TaskPath(name, point, slope, R, breaks, spin=spin, period=period)
    return with_arc(path, _arc(pieces, s, (at_corners / knots[-1], turned)))


def _edge_sizes(corners: Array, rotation: Array | list[Array], name: str) -> Array:
    """Measure the edges between corners (P, 3): (P − 1,), m, where 1 rad of rotation counts 0.1 m.

    The size of an edge is √(length² + (0.1 m · angle)²). An edge of size 0, a pause, counts as
    the mean of the other edges. ``rotation`` is one orientation, or one per corner;
    ``name`` is the path's name in error messages. InputError is raised for too many corners, and if
    all edges have size 0.
    """
    if len(corners) - 1 > MOST_POINTS:
        raise InputError(f"{name} has {len(corners)} points; reduce them to at most {MOST_POINTS}")
    turns = np.zeros(len(corners) - 1)
    if isinstance(rotation, list):
        turns = np.array([np.linalg.norm(pin.log3(a.T @ b)) for a, b in pairwise(rotation)])
    edges = np.diff(corners, axis=0)
    sizes = np.hypot(np.linalg.norm(edges, axis=1), _PER_RADIAN * turns)
    stays = sizes < 1e-9
    if stays.all():
        raise InputError(f"{name}: all points are the same; give at least two different points")
    return np.where(stays, sizes[~stays].mean(), sizes)


def _blend_radius(blend: float, times: ArrayLike | None) -> float:
    """Check the radius of the rounded corners, m, and return it.

    InputError is raised for a negative radius, and for one above 0 if times are given.
    """
    blend = positive(blend, "blend", "m", zero=True)
    if blend and times is not None:
        raise InputError(
            "times= and blend= are mutually exclusive: blended paths have constant speed"
        )
    return blend


def _times(times: ArrayLike, count: int) -> Array:
    """Check the times of ``count`` waypoints, s; return them (count,), counted from the first."""
    t = _doubles(times)
    if t is None or t.shape != (count,) or not np.isfinite(t).all() or not (np.diff(t) > 0).all():
        raise InputError(f"times must be {count} increasing finite numbers, in s, one per waypoint")
    return t - t[0]


def _arc(pieces: list[_Curve], s: Array, turns: tuple[Array, Array] | None) -> ArcBound:
    """Make the function (a, b) → upper bounds (length, m; rotation, rad) between s = a and b.

    ``pieces`` are the lines and half bends, with constant speed between the knots ``s``. ``turns``
    is None for a fixed orientation, else a pair of arrays: knots of the orientation, and upper
    bounds of the total rotation, rad, from the start to each of these knots.
    """
    lengths = [float(np.linalg.norm(piece(0.5)[1])) for piece in pieces]
    passed = np.concatenate([[0.0], np.cumsum(lengths)])

    def arc(a: float, b: float) -> tuple[float, float]:
        length = float(np.diff(np.interp([a, b], s, passed))[0])
        if turns is None:
            return length, 0.0
        knots, turned = turns
        # the rate of turning is not constant: an arc counts with all of each interval it touches
        first = int(np.searchsorted(knots, a, side="right")) - 1
        last = int(np.searchsorted(knots, b, side="left"))
        most = np.diff(turned[first : last + 1]) / np.diff(knots[first : last + 1])
        return length, float(most.max(initial=0.0)) * (b - a)

    return arc


_Curve = Callable[[float], tuple[Array, Array]]
"""Function of u in [0, 1] that returns the position p (3,), m, and dp/du (3,)."""


def _line(start: Array, edge: Array) -> _Curve:
    return lambda u: (start + u * edge, edge)


def _bend(
    bend: Bend, start: Array, along: Array, inward: Array, length: float, begin: float
) -> _Curve:
    """Create half of a bend as a function on [0, 1]: the first (``begin`` 0) or second (0.5) half.

    A path begins in the middle of a bend, so bends are used in halves. The whole bend has the given
    length, m; it starts at the point ``start`` (3,), m, in the direction ``along``, and turns
    towards ``inward``, both unit vectors (3,).
    """
    frame = np.stack([along, inward])

    def at(u: float) -> tuple[Array, Array]:
        v = begin + u / 2
        theta = bend.direction_of(bend.phi, v)
        direction = np.array([np.cos(theta), np.sin(theta)])
        return start + length * bend.at(v) @ frame, length / 2 * direction @ frame

    return at


def _rounded(
    corners: Array, sizes: Array, radius: float, name: str
) -> tuple[list[_Curve], Array, Array]:
    """Round the corners (P, 3), m, of a closed polyline by bends, for a radius ρ, m, of arcs.

    The last corner equals the first, so there are P − 1 edges. ``name`` is the path's name in error
    messages. The bend at a corner, where the direction turns by φ, cuts ρ tan(φ/2), m, off both
    edges, as an arc of radius ρ does. The path begins at the midpoint of the first corner's bend.

    Returns three results: the lines and half bends in order; the knots at their ends, from 0 on;
    and the knots (P,) of the midpoints of the corners' bends. Over a half bend, the knots increase
    by its arc length, m. Over the straight rest of an edge, the increase is the edge's entry of
    ``sizes`` (P − 1,), m, times the fraction of the edge that the bends leave.
    """
    at = _Corners.of(corners, radius, name)
    pieces: list[_Curve] = []
    took: list[float] = []
    upto = [0]  # number of pieces before the midpoint of each corner

    def half(i: int, begin: float) -> None:
        bend = at.bends[i]
        if bend is not None:
            start = corners[i] - at.cut[i] * at.before[i]
            length = bend.length(at.cut[i])
            pieces.append(_bend(bend, start, at.before[i], at.inward[i], length, begin))
            took.append(length / 2)

    for i, edge in enumerate(np.diff(corners, axis=0)):
        half(i, 0.5)
        share = at.straight[i]
        if share > 1e-9:
            pieces.append(_line(corners[i] + at.cut[i] * at.units[i], share * edge))
            took.append(share * sizes[i])
        half((i + 1) % len(at.units), 0.0)
        upto.append(len(pieces))
    knots = np.concatenate([[0.0], np.cumsum(took)])
    return pieces, knots, knots[upto]


def _too_short(lengths: Array, straight: Array, radius: float, name: str) -> InputError:
    """Create the error that names the edge too short for its bends, and the largest blend radius.

    ``lengths`` are the lengths of the edges, m, and ``straight`` what the bends of the given radius
    leave of them, m; negative for an edge that is too short. ``name`` is the path's name.
    """
    at = int(np.argmin(straight))
    most = radius * lengths[at] / (lengths[at] - straight[at])
    return InputError(
        f"{name}: blends of radius {radius:g} m do not fit the edge of {lengths[at]:.3g} m "
        f"from point {at + 1} to {at + 2}; use a blend radius of at most {most:.2g} m"
    )


class _Corners(NamedTuple):
    """Corners of a closed polyline, with their edges and the lengths that bends cut off.

    For each of P corners, ``units`` and ``before`` (P, 3) are the unit vectors along the edges that
    leave and reach the corner, ``inward`` (P, 3) the unit vector towards which the path turns,
    ``bends`` its bend (None for a sharp corner), and ``cut`` (P,) the length, m, cut off both
    edges. ``straight`` (P,) is the fraction of the edge after each corner that the bends leave.
    """

    units: Array
    before: Array
    inward: Array
    bends: list[Bend | None]
    cut: Array
    straight: Array

    @classmethod
    def of(cls, corners: Array, radius: float, name: str) -> _Corners:
        """Create the bends at corners (P + 1, 3), the last equal to the first; ``radius`` is in m.

        InputError is raised if an edge is too short.
        """
        edges = np.diff(corners, axis=0)
        lengths = np.linalg.norm(edges, axis=1)
        units = edges / np.maximum(lengths, 1e-300)[:, None]
        before = np.roll(units, 1, axis=0)
        inward = units - np.einsum("ij,ij->i", units, before)[:, None] * before
        across = np.linalg.norm(inward, axis=1)
        phi = np.arctan2(across, np.einsum("ij,ij->i", units, before))
        moving = lengths > 1e-9
        sharp = ~(moving & np.roll(moving, 1)) | (phi > np.pi - 1e-3) | (phi < 1e-9)
        phi[sharp | (radius == 0)] = 0.0
        cut = radius * np.tan(phi / 2)
        straight = lengths - cut - np.roll(cut, -1)
        if (straight < -1e-12).any():
            raise _too_short(lengths, straight, radius, name)
        with np.errstate(divide="ignore", invalid="ignore"):
            inward = inward / across[:, None]
            straight = np.where(moving, straight / lengths, 1.0)
        bends = [Bend.of(float(turn)) if turn > 0 else None for turn in phi]
        return cls(units, before, inward, bends, cut, straight)


_FARTHEST = 1e9
"""Maximum coordinate of a waypoint, m; squares of coordinates beyond 1e154 would overflow."""


def _are_placements(points: Sequence[Any] | Array) -> bool:
    """Test whether waypoints are rigid transforms instead of positions, by the first one."""
    if isinstance(points, np.ndarray):
        return points.ndim == 3
    if not points or isinstance(points[0], pin.SE3):
        return bool(points)
    matrix = as_numbers(points[0])
    return matrix is not None and matrix.shape == (4, 4)


def _points(values: ArrayLike | Sequence[Any], what: str) -> Array:
    points = _doubles(values)
    if points is None:
        raise InputError(f"{what} must be rows of three numbers, x, y, z in m")
    if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
        raise InputError(f"{what} must be rows of three finite numbers, x, y, z in m")
    if np.abs(points).max(initial=0.0) > _FARTHEST:
        raise InputError(
            f"{what}: a coordinate of {np.abs(points).max():.3g} m is beyond the maximum, "
            f"{_FARTHEST:g} m; give coordinates in m"
        )
    return points


def _doubles(values: Any) -> Array | None:
    """Convert values to an array of doubles, numeric strings included; None if NumPy cannot."""
    try:
        return np.array(values, dtype=float)
    except (TypeError, ValueError, OverflowError):
        return None
