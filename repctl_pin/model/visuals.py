"""Visible shapes of a robot, their placements at configurations, and their corners.

A robot without shapes, and a link whose mesh is missing, are drawn from the kinematics, see
:mod:`.skeleton`. Surroundings are drawn by their collision shapes. A shape has the path of its mesh
file, but not its content. An argument ``surfaces`` has the contents of the mesh files, by file; if
it is None, the files are read. A placed shape is (shape, its placement on its link).

``Mechanism`` is the movable joints of a robot and their limits. ``Description`` is the content of a
validated URDF as plain data. ``Shape`` is a shape of a URDF as plain data: its kind, size, link and
place, or its mesh file. ``Surfaces`` are the triangle meshes of mesh files by path, with the error
instead if a file is unreadable.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from ..base.arguments import Array, read_only
from ..base.errors import InputError
from .mechanism import Coupling, Mechanism
from .mesh_cache import Arrays, cached
from .model import fixed_placements, frame_placements, link_frames, link_ids, origin
from .packages import find_mesh
from .shapes import Color, Shape
from .skeleton import skeleton
from .urdf import MAX_SHAPES, Description

if TYPE_CHECKING:
    from .surfaces import Surfaces

_PLAIN: Color = (0.80, 0.82, 0.85, 1.0)
"""Default colour of a shape."""

_AROUND: Color = (0.62, 0.66, 0.71, 0.45)
"""Colour of the surroundings, transparent so that the arm stays visible."""

_RIM = 24
"""Number of corners of the polygon that approximates a circle."""

_ALLOWED = 0.5
"""Maximum distance of a mesh point from the hull of the link's collision shapes, as a fraction of
the diagonal of the box around that hull. Farther points may be stray points."""

_MAJORITY = 0.9
"""Fraction of a mesh's points that must lie within that distance for the others to be dropped."""

_KEPT = 256
_hulls: dict[tuple[Path, int], Array] = {}
"""Cache of mesh hulls, by file path and modification time; the terminal and the page share it."""


_corners_of: WeakKeyDictionary[Mechanism, tuple[object, list[Array]]] = WeakKeyDictionary()
"""Cache of the corners of each robot's shapes, with the times of its mesh files; the rows of a
study, its page and its report share it."""

_Placed = tuple[Shape, pin.SE3]
"""A shape and its placement on its link."""


@dataclass(frozen=True, eq=False)
@read_only
class Visuals:
    """Shapes to draw of a robot and its surroundings. Create the object with :meth:`of`.

    Attributes
    ----------
    shapes
        The S shapes; the ``path`` of a mesh is the file that was found.
    """

    shapes: tuple[Shape, ...]
    _model: pin.Model = field(repr=False)
    _frame: NDArray[np.intp] = field(repr=False)  # (S,), frame ids
    _on_frame: Array = field(repr=False)  # (S, 4, 4)
    _coupling: Coupling = field(repr=False)
    _robot: Mechanism = field(repr=False)

    @classmethod
    def of(cls, robot: Mechanism) -> Visuals:
        """Collect the shapes of a robot; meshes are looked up in its ``package_dirs``.

        Invisible shapes are left out. Links whose mesh is missing are drawn as tubes, and so is the
        whole robot if no visible shape moves.
        """
        ids = link_ids(robot.model)
        links = link_frames(robot.model)
        riding: list[_Placed] = []
        missing = set()  # links whose mesh is missing
        for shape, place in _find_shapes(robot):
            if shape.kind == "mesh" and shape.path is None:
                missing.add(shape.link)
            elif shape.color is None or shape.color[3] > 0:
                riding.append((shape, place))
        moving = any(links[shape.link].parentJoint > 0 for shape, _ in riding)
        riding += skeleton(robot, links, missing if moving else links)
        placed = [*riding, *_surroundings(robot)]
        frames = [0 if shape.standing else ids[shape.link] for shape, _ in placed]
        return cls(
            shapes=tuple(shape for shape, _ in placed),
            _model=robot.model,
            _frame=np.array(frames, np.intp),
            _on_frame=np.array([M.homogeneous for _, M in placed]).reshape(-1, 4, 4),
            _coupling=robot.coupling,
            _robot=robot,
        )

    def placements(self, Q: ArrayLike) -> Array:
        """Compute the placements of all S shapes at T configurations: (T, S, 4, 4).

        Parameters
        ----------
        Q
            Configurations (T, n) of the whole robot (``task.to_robot(q)``).

        Returns
        -------
        Rigid transforms (T, S, 4, 4), m, relative to the robot's root, which is at rest even if the
        link ``base`` moves. The scale of a mesh is not included.
        """
        Q = np.ascontiguousarray(Q, dtype=float)
        n = self._coupling.S.shape[1]
        if Q.ndim != 2 or Q.shape[1] != n:
            raise InputError(
                f"Q has shape {Q.shape}, but this robot has {n} joints; give Q as (T, {n})"
            )
        Q = self._coupling.joints(Q)
        return frame_placements(self._model, self._frame.tolist(), Q) @ self._on_frame

    def corners(self, surfaces: Surfaces | None = None) -> list[Array]:
        """List, for each shape, the corners (P, 3), m, of its convex hull in its own frame.

        The scale of a mesh is applied. Stray points of a mesh, far from its link, are left out: a
        few points that lie outside the convex hull of the link's collision shapes by over half the
        size of that hull. A shape that cannot be read has one corner, at its origin.

        Parameters
        ----------
        surfaces
            Contents of the mesh files; if None, the files are read.
        """
        times = _file_times(self._robot, self.shapes)
        known, found = _corners_of.get(self._robot, (None, []))
        if known != times:
            found = self._confirmed_corners(surfaces)
            _corners_of[self._robot] = times, found
        return [*found]

    def _confirmed_corners(self, surfaces: Surfaces | None) -> list[Array]:
        """List the corners (P, 3), m, of each shape's convex hull, without stray points.

        They are in the shape's own frame. Stray points of a mesh are those far outside the link's
        collision shapes.
        """
        found = _corners(self.shapes, surfaces)
        solids: dict[str, Array | None] = {}
        for k, (shape, place) in enumerate(zip(self.shapes, self._on_frame, strict=True)):
            if shape.kind != "mesh" or shape.standing or len(found[k]) < 4:
                continue
            if shape.link not in solids:
                solids[shape.link] = _solid_corners(self._robot, shape.link)
            solid = solids[shape.link]
            if solid is not None and not _are_near(found[k], place, solid):
                found[k] = _confirmed(shape, found[k], place, _widened_hull(solid), surfaces)
        return found


def _find_shapes(robot: Mechanism) -> Iterator[_Placed]:
    """Yield the URDF's visual shapes as placed shapes.

    The attribute ``path`` of a mesh is set to its file, or to None if the file is missing.
    """
    for shape in robot.description.shapes:
        path = _mesh_file(shape, robot.description, robot)
        own_colors = path is not None and path.suffix.lower() != ".stl"
        color = shape.color or (None if own_colors else _PLAIN)
        yield replace(shape, path=path, color=color), origin(shape)


def _surroundings(robot: Mechanism) -> Iterator[_Placed]:
    """Yield (shape, placement) of the first ``MAX_SHAPES`` shapes of the surroundings.

    The placement is relative to the robot's root. A missing mesh is skipped here; :class:`Bodies`
    raises an error for it.
    """
    around = robot.surroundings
    if around is None:
        return
    places = fixed_placements(around)
    for shape in around.collisions[:MAX_SHAPES]:
        path = _mesh_file(shape, around, robot)
        if path is not None or shape.kind != "mesh":
            name = f"surroundings/{shape.name}"
            M = places[shape.link] * origin(shape)
            yield replace(shape, name=name, path=path, color=_AROUND, standing=True), M


def _mesh_file(shape: Shape, of: Description, robot: Mechanism) -> Path | None:
    """Find the mesh file of a shape; None if the shape has no mesh, or the file is missing.

    ``of`` is the URDF that contains the shape: the robot's, or that of the surroundings.
    """
    name = shape.filename
    return find_mesh(name, of.path, robot.package_dirs) if name else None


# ---- corners of the drawn bodies ----


def _file_times(robot: Mechanism, shapes: Sequence[Shape]) -> list[tuple[Shape, int]]:
    """List (shape, modification time of its mesh file, ns): data on which cached corners depend.

    The list has the drawn ``shapes`` and the robot's collision shapes. The time is 0 without a
    mesh, or if its file is missing.
    """
    solid = robot.description.collisions
    found = [replace(shape, path=_mesh_file(shape, robot.description, robot)) for shape in solid]
    times = []
    for shape in [*shapes, *found]:
        time = 0
        if shape.path is not None:
            with contextlib.suppress(OSError):
                time = shape.path.stat().st_mtime_ns
        times.append((shape, time))
    return times


def _corners(shapes: Sequence[Shape], surfaces: Surfaces | None = None) -> list[Array]:
    """List, for each shape, the corners (P, 3), m, of its convex hull in its own frame.

    The scale of a mesh is applied. Stray points of a mesh are included.
    """
    return [_hull_corners(shape, surfaces) * np.array(shape.scale) for shape in shapes]


def _solid_corners(robot: Mechanism, link: str) -> Array | None:
    """List the corners of a link's collision shapes in the link's frame: (P, 3), m.

    The result is None if the link has no collision shapes, or if one of them is missing or
    unreadable.
    """
    points = []
    for shape in robot.description.collisions:
        if shape.link != link:
            continue
        path = _mesh_file(shape, robot.description, robot)
        if shape.kind == "mesh" and path is None:
            return None
        own = _corners([replace(shape, path=path)])[0]
        if len(own) < 4:  # unreadable
            return None
        M = origin(shape)
        points.append(own @ M.rotation.T + M.translation)
    return np.concatenate(points) if points else None


def _allowed(solid: Array) -> float:
    """Return how far, m, points may be outside the hull of collision corners ``solid`` (P, 3)."""
    return float(_ALLOWED * np.linalg.norm(np.ptp(solid, axis=0)))


def _are_near(corners: Array, place: Array, solid: Array) -> bool:
    """Test whether each corner of a shape is near some corner of the link's collision shapes.

    Near means within the distance that :func:`_allowed` returns. No corner of the shape is then
    outside the widened hull of the collision shapes, so this hull need not be computed. ``corners``
    (P, 3), m, are in the shape's own frame, and ``place`` (4, 4) is the shape's placement on the
    link; ``solid`` (C, 3), m, is in the frame of the link.
    """
    on_link = corners @ place[:3, :3].T + place[:3, 3]
    squares = np.sum(on_link**2, axis=1)[:, None] + np.sum(solid**2, axis=1)
    squares -= 2 * on_link @ solid.T
    return bool(squares.min(axis=1).max() <= _allowed(solid) ** 2)


def _widened_hull(solid: Array) -> Array | None:
    """Compute the convex hull of collision corners (P, 3), m, widened by half its size: (F, 4).

    A point p is inside if ``n·p + d ≤ 0`` for all F rows (n, d). The result is None if the hull is
    flat.
    """
    from scipy.spatial import ConvexHull, QhullError  # slow to import

    try:
        planes = ConvexHull(solid).equations.copy()
    except (QhullError, ValueError):  # flat
        return None
    planes[:, 3] -= _allowed(solid)
    return planes


def _confirmed(
    shape: Shape, corners: Array, place: Array, hull: Array | None, surfaces: Surfaces | None
) -> Array:
    """Return the corners (P, 3), m, of the hull of a mesh without its stray points.

    A stray point is outside ``hull``, the widened convex hull of the link's collision shapes.
    ``hull`` (L, 4) has a row (a, b) for each of L half-spaces ``a·x + b ≤ 0`` in the frame of the
    link. It is None if the hull is flat; no point is then left out. If many points are outside, the
    collision shapes do not cover the link, and no point is left out, either.

    ``corners`` are the corners of the hull of all points of the mesh. They and the result are in
    the shape's own frame, with the scale of the mesh applied. ``place`` (4, 4) is the shape's
    placement on its link.
    """

    if hull is None:
        return corners
    normals, offsets = hull[:, :3], hull[:, 3]

    def inside(points: Array) -> NDArray[np.bool_]:
        on_link = points @ place[:3, :3].T + place[:3, 3]
        return np.asarray((on_link @ normals.T + offsets).max(axis=1) <= 0)

    if inside(corners).all():
        return corners
    assert shape.path is not None
    if surfaces is None:
        from .surfaces import read_surfaces  # an arm without meshes has no need of it

        surfaces = read_surfaces([shape])
    surface = surfaces[shape.path]
    if isinstance(surface, InputError):
        return corners
    points = surface.points * np.array(shape.scale)
    # blocks keep the memory small
    kept = np.concatenate(
        [inside(part) for part in np.array_split(points, len(points) // 4096 + 1)]
    )
    return _hull_points(points[kept]) if kept.mean() > _MAJORITY else corners


def _hull_corners(shape: Shape, surfaces: Surfaces | None) -> Array:
    """Return the corners (P, 3) of a shape's convex hull, before scaling.

    Those of a mesh are cached by file and modification time, and on disk by content; an unreadable
    mesh has one corner, at its origin.
    """
    if shape.kind != "mesh":
        return _primitive_corners(shape)
    assert shape.path is not None
    try:
        key = (shape.path, shape.path.stat().st_mtime_ns)
    except OSError:
        return np.zeros((1, 3))
    if key not in _hulls:
        if len(_hulls) >= _KEPT:
            _hulls.clear()
        make = partial(_mesh_corners, shape, surfaces)
        try:
            _hulls[key] = cached(shape.path, "corners of the hull of the surface", make)["corners"]
        except InputError:
            _hulls[key] = np.zeros((1, 3))
    return _hulls[key]


def _mesh_corners(shape: Shape, surfaces: Surfaces | None) -> Arrays:
    """Compute the corners (P, 3) of a mesh's convex hull: the entry ``corners`` of a dict.

    They are in the axes and units of the mesh file; the shape's scale is not applied. InputError is
    raised for a mesh that cannot be read.
    """
    assert shape.path is not None
    if surfaces is None:
        from .surfaces import read_surfaces  # an arm without meshes has no need of it

        surfaces = read_surfaces([shape])
    surface = surfaces[shape.path]
    if isinstance(surface, InputError):
        raise surface
    return {"corners": _hull_points(surface.points)}


def _hull_points(points: Array) -> Array:
    """Select those of the points (V, 3) that are corners of their convex hull: (P, 3).

    All distinct points are returned if the hull is flat.
    """
    from scipy.spatial import ConvexHull, QhullError  # slow to import

    with contextlib.suppress(QhullError, ValueError):  # flat
        points = points[ConvexHull(points).vertices]
    return np.unique(points, axis=0)


def _primitive_corners(shape: Shape) -> Array:
    """Return the corners (P, 3), m, of a box, or of a polytope that approximates a round shape."""
    ends = np.array([-0.5, 0.5])
    if shape.kind == "box":
        return np.array(list(product(*(edge * ends for edge in shape.size))))
    angles = 2 * np.pi * np.arange(_RIM) / _RIM
    radius = shape.size[0]
    length = shape.size[1] if len(shape.size) > 1 else 0.0
    tilts = np.zeros(1) if shape.kind == "cylinder" else np.linspace(0, np.pi / 2, 7)
    rings = [
        np.c_[
            radius * np.cos(tilt) * np.cos(angles),
            radius * np.cos(tilt) * np.sin(angles),
            np.full(_RIM, side * (length / 2 + radius * np.sin(tilt))),
        ]
        for tilt in tilts
        for side in (-1, 1)
    ]
    return np.vstack(rings)
