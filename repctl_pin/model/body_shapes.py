"""Collision geometry for coal: primitives, meshes with convex hulls, and points inside meshes.

coal is the library that computes distances. Letters: V vertices, F faces (triangles) of a mesh.

``_MeshInterior`` is a test of whether points lie inside a mesh. ``_MeshParts`` are the connected
parts of a mesh: points, faces, the part of each, and which parts are closed. ``BodyShape`` is a
collision body: a convex shape, or a mesh and its convex hull.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ..base.arguments import Array, read_only
from ..base.errors import InputError, needed
from .mesh_cache import Arrays, cached
from .packages import find_mesh
from .shapes import Shape
from .surfaces import HEAD, unit, without_tracebacks

_LARGEST_FILE = 100_000_000
"""Maximum size of a mesh file, bytes."""

_LARGEST = 1e5
"""Maximum size of a body, m; for larger ones rounding errors exceed the distances."""

_THIN = 1e-4
"""Half the thickness given to a flat body, m; flat is closer than this (rms) to a plane."""

_CONVEX = 1e-6
"""Relative tolerance in area and volume within which a mesh counts as convex."""


class UnusableShape(InputError):
    """Raised for an unusable collision shape; the message gives the cause and the remedy.

    A robot is loaded without the shape, with a note; in the surroundings, such a shape is an error.
    """


@dataclass(frozen=True, eq=False)
@read_only
class BodyShape:
    """Collision body: a convex shape, or a mesh and its convex hull.

    Distances between convex shapes are fast; the mesh decides whether bodies collide.

    Attributes
    ----------
    hull
        Convex shape, or convex hull of the mesh.
    points, faces
        Vertices (V, 3), m, in the body's own frame, and triangles (F, 3) of a mesh that is not
        convex; else None.
    standing
        True for a body of the surroundings; a mesh with gaps, such as a room without a ceiling,
        then has no interior.
    """

    hull: coal.CollisionGeometry
    points: Array | None = None
    faces: NDArray[np.intp] | None = None
    standing: bool = False

    @cached_property
    def exact(self) -> coal.CollisionGeometry:
        """Exact geometry: the mesh itself if it is not convex, else the convex shape.

        If the convex hulls of two bodies overlap, the exact geometry decides whether the bodies
        collide.
        """
        if self.points is None or self.faces is None:
            return self.hull
        mesh = coal.BVHModelOBBRSS()
        triangles = coal.StdVec_Triangle()
        triangles.extend([coal.Triangle(*face) for face in self.faces.tolist()])
        mesh.beginModel(len(self.faces), len(self.points))
        mesh.addSubModel(_cloud(self.points), triangles)
        mesh.endModel()
        mesh.computeLocalAABB()
        return mesh

    @property
    def convex(self) -> bool:
        """True if the body is convex, so that its hull is exact."""
        return self.points is None

    @property
    def measured(self) -> coal.CollisionGeometry:
        """Geometry for distances: exact for a body of the surroundings, else the convex hull.

        The hull of a room would leave no space for the arm inside it.
        """
        return self.exact if self.standing else self.hull

    @cached_property
    def witnesses(self) -> Array:
        """One point of each of the K connected parts of the body: (K, 3), m, in its own frame.

        If the surfaces of two bodies do not intersect, a part lies inside the other body if and
        only if its point does.
        """
        if self._parts is None:
            return np.asarray(self.hull.aabb_center, float)[None]
        return self._parts.witnesses

    @cached_property
    def interior(self) -> _MeshInterior | None:
        """Interior of the mesh, to test whether another body lies inside it without touching it.

        None for a convex body, which the library coal treats as solid, and for a mesh of the
        surroundings without closed parts, which has no interior.
        """
        if self._parts is None or (self.standing and not self._parts.closed.any()):
            return None
        return _MeshInterior(self._parts, gaps=not self.standing)

    @cached_property
    def _parts(self) -> _MeshParts | None:
        if self.points is None or self.faces is None:
            return None
        return _mesh_parts(self.points, self.faces)


def body_shape(
    solid: Shape, urdf: Path, package_dirs: tuple[str, ...], *, standing: bool = False
) -> BodyShape:
    """Create the collision body of a shape of the URDF; ``standing`` is True in the surroundings.

    ``urdf`` is the file, and ``package_dirs`` are folders, from which meshes are looked up.

    Raises
    ------
    UnusableShape
        If the mesh is missing or unreadable, or the shape has size 0 or is too large.
    """
    if solid.kind != "mesh":
        return _primitive(solid)
    path = find_mesh(solid.filename, urdf, package_dirs)
    if path is None:
        raise UnusableShape(
            f"mesh {solid.filename!r} is missing; "
            "give the folder of its package (--package-dir, package_dirs=), "
            "or replace the mesh by a box"
        )
    try:
        return _from_mesh(path, tuple(solid.scale), path.stat().st_mtime_ns, standing)
    except UnusableShape as error:
        raise UnusableShape(f"mesh {solid.filename!r} {error}") from error


def _primitive(solid: Shape) -> BodyShape:
    """Create the body of a box, sphere, cylinder or capsule.

    UnusableShape is raised for a size of 0 or above 100 km; only one edge of a box, and the length
    of a cylinder or capsule, can be 0.
    """
    size = solid.size
    allowed = {"box": 1, "cylinder": 1, "capsule": 1}.get(solid.kind, 0)
    empty = size.count(0.0) > allowed or (solid.kind in ("cylinder", "capsule") and size[0] == 0)
    if empty:
        raise UnusableShape(
            f"the {solid.kind} {solid.name!r} has size 0; set its size, or delete it"
        )
    if max(size) > _LARGEST:
        raise UnusableShape(
            f"the {solid.kind} {solid.name!r} is {_too_large(max(size))}; correct its size"
        )
    kinds = {
        "box": coal.Box,
        "sphere": coal.Sphere,
        "cylinder": coal.Cylinder,
        "capsule": coal.Capsule,
    }
    hull = kinds[solid.kind](*size)
    hull.computeLocalAABB()
    return BodyShape(hull)


def _too_large(size: float) -> str:
    return f"{size:.3g} m large, but the maximum is {_LARGEST:g} m"


def collide(
    one: BodyShape, here: coal.Transform3s, other: BodyShape, there: coal.Transform3s
) -> bool:
    """Test whether two bodies intersect, or one contains a connected part of the other.

    ``one`` is placed at ``here``, ``other`` at ``there``.
    """
    request = coal.CollisionRequest()
    result = coal.CollisionResult()
    if coal.collide(one.exact, here, other.exact, there, request, result):
        return True
    return contains(one, here, other, there) or contains(other, there, one, here)


def contains(
    outer: BodyShape, here: coal.Transform3s, inner: BodyShape, there: coal.Transform3s
) -> bool:
    """Test whether ``outer`` contains a connected part of ``inner``.

    Call it only for bodies whose surfaces do not intersect: one point of each part then decides.
    ``outer`` is placed at ``here``, ``inner`` at ``there``. The result is False if ``outer`` has no
    interior, see :attr:`BodyShape.interior`.
    """
    if outer.interior is None:
        return False
    points = inner.witnesses @ there.getRotation().T + there.getTranslation()
    return outer.interior.contains((points - here.getTranslation()) @ here.getRotation())


def transform(place: pin.SE3) -> coal.Transform3s:
    """Convert a placement to a Transform3s of coal, the collision library."""
    return coal.Transform3s(place.rotation, place.translation)


@lru_cache(maxsize=256)
def _from_mesh(path: Path, scale: tuple[float, ...], changed: int, standing: bool) -> BodyShape:
    """Create the body of a mesh file, with its convex hull; cached for all robots.

    ``changed`` is the modification time of the file, ns, so that a changed file is read again.
    ``scale`` has a factor per axis, and ``standing`` is True for a mesh of the surroundings.
    """
    solid = cached(path, f"{scale} {standing}", partial(_solid, path, scale, standing=standing))
    hull, coarse = _hull(solid["corners"])
    hull.computeLocalAABB()
    if not coarse and solid["convex"]:
        return BodyShape(hull, standing=standing)
    return BodyShape(hull, solid["vertices"], solid["faces"], standing)


def _solid(path: Path, scale: tuple[float, ...], *, standing: bool) -> Arrays:
    """Read a mesh file, as a dict of arrays: vertices, faces, corners and convex.

    ``vertices`` (V, 3) and ``corners`` (C, 3), those of the convex hull, are in m; ``faces`` (F, 3)
    are vertex indices; ``convex`` is True or False. The faces of a link's mesh are turned over if
    their normals point inwards; those of the surroundings, with ``standing``, are left as they are.
    ``scale`` has a factor per axis. UnusableShape is raised for a mesh that cannot be read, has
    size 0 or is larger than 100 km.
    """
    collada = ["collada"] if path.suffix.lower() == ".dae" else []
    needed("trimesh", *collada, by=f"the distance to the mesh {path.name}")
    vertices, faces = _read_mesh(path, scale)
    size = float(np.ptp(vertices, axis=0).max())
    if not size <= _LARGEST:
        raise UnusableShape(
            f"is {_too_large(size)}; correct its scale, {scale[0]:g} {scale[1]:g} {scale[2]:g}"
        )
    if size == 0:
        raise UnusableShape("has size 0; correct the file, or its scale")
    if np.prod(scale) < 0:
        faces = faces[:, ::-1]  # mirrored: restore outward normals
    if not standing and _volume(vertices, faces) < 0:
        faces = faces[:, ::-1]  # a link of a robot is solid: outward normals
    wrapped = _convex_hull(vertices)
    convex = np.array(_is_convex(vertices, faces, wrapped))
    corners = np.asarray(wrapped.vertices)
    return {"vertices": vertices, "faces": faces, "corners": corners, "convex": convex}


def _read_mesh(path: Path, scale: tuple[float, ...]) -> tuple[Array, NDArray[np.intp]]:
    """Read the vertices (V, 3), m, and the triangles (F, 3) of a mesh file, scaled.

    ``scale`` has a factor for each axis. Vertices outside all triangles are dropped. UnusableShape
    is raised for a file that is too large, cannot be read, or has no triangles.
    """
    import trimesh

    size = path.stat().st_size
    if size > _LARGEST_FILE:
        raise UnusableShape(
            f"is a file of {size / 1e6:.0f} MB, but the maximum is {_LARGEST_FILE / 1e6:.0f} MB; "
            "simplify the mesh"
        )
    try:
        with without_tracebacks():
            mesh = trimesh.load(path, force="mesh", process=False)
        meters = _unit_of(path)
        vertices = np.asarray(mesh.vertices, float) * meters * scale
        faces = np.asarray(mesh.faces, np.intp)
    except Exception as error:  # trimesh's readers raise errors of many kinds
        raise UnusableShape("cannot be read; export it again, as STL for example") from error
    if faces.ndim != 2 or not len(faces):
        raise UnusableShape("contains no readable triangles; export it again, as STL for example")
    used = np.unique(faces)
    if used[0] < 0 or used[-1] >= len(vertices) or not np.isfinite(vertices[used]).all():
        raise UnusableShape("cannot be read: a vertex is missing or not finite; export it again")
    if len(used) < len(vertices):
        vertices = vertices[used]
        faces = np.searchsorted(used, faces)
    return vertices, faces


def _unit_of(path: Path) -> float:
    """Read the unit of length of a mesh file, m; it is 1 m in all formats except COLLADA."""
    if path.suffix.lower() != ".dae":
        return 1.0
    with path.open("rb") as file:
        return unit(file.read(HEAD))


def _convex_hull(vertices: Array) -> Any:
    """Compute the convex hull of vertices (V, 3), m, as a mesh of the library trimesh.

    A flat set of vertices is thickened first. UnusableShape is raised if Qhull finds no hull.
    """
    import trimesh

    try:
        return trimesh.convex.convex_hull(_thickened(vertices))
    except Exception as error:  # Qhull's
        raise UnusableShape("has no convex hull; export it again, as STL for example") from error


def _volume(points: Array, faces: NDArray[np.intp]) -> float:
    """Compute the volume of a closed mesh, m³; negative if its normals point inwards.

    ``points`` (V, 3) are the vertices, m, and ``faces`` (F, 3) the triangles.
    """
    a, b, c = (points[faces[:, k]] - points[0] for k in range(3))
    return float(np.einsum("fi,fi->", a, np.cross(b, c)) / 6)


def _is_convex(points: Array, faces: NDArray[np.intp], hull: Any) -> bool:
    """Test whether a mesh is the surface of its convex hull, with outward normals.

    The areas and the volumes of the mesh and of ``hull``, a trimesh mesh, are compared. ``points``
    (V, 3) and ``faces`` (F, 3) are the mesh.
    """
    a, b, c = (points[faces[:, k]] for k in range(3))
    area = float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)
    same = abs(area - hull.area) <= _CONVEX * hull.area
    return bool(same and abs(_volume(points, faces) - hull.volume) <= _CONVEX * hull.volume)


def _hull(points: Array) -> tuple[coal.CollisionGeometry, bool]:
    """Create a convex shape of the library coal from the vertices (V, 3) of a convex hull.

    coal fails if a vertex has over 255 neighbours. The vertices are then rounded outwards to
    coarser and coarser grids until coal succeeds; the last resort is the bounding box. Return the
    shape, and True if it is larger than the hull for this reason.
    """
    size = float(np.ptp(points, axis=0).max())
    for grid in size * np.array([0, 1 / 1024, 1 / 256, 1 / 64]):
        corners = points
        if grid:
            # outwards by the maximum inward shift of the rounding
            out = points - points.mean(axis=0)
            out /= np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-300)
            corners = np.unique(np.round((points + grid * out) / grid), axis=0) * grid
        with suppress(RuntimeError):
            return coal.ConvexBase.convexHull(_cloud(corners), True, "Qt"), bool(grid)
    low = points.min(axis=0)
    high = points.max(axis=0)
    box = np.array([[(low, high)[k >> i & 1][i] for i in range(3)] for k in range(8)])
    return coal.ConvexBase.convexHull(_cloud(box), True, "Qt"), True


def _thickened(points: Array) -> Array:
    """Thicken a flat set of vertices (V, 3) to 0.2 mm, because coal crashes on a flat hull.

    Along each direction in which the set is flat, every vertex is replaced by two, one on either
    side. The result is (V, 3), (2 V, 3), (4 V, 3) or (8 V, 3), m.
    """
    spread, axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[1:]
    for axis in axes[spread < np.sqrt(len(points)) * _THIN]:
        points = np.concatenate([points + _THIN * axis, points - _THIN * axis])
    return points


def _cloud(points: Array) -> coal.StdVec_Vec3s:
    cloud = coal.StdVec_Vec3s()
    cloud.extend(list(points))
    return cloud


# ---- inside a mesh: signed ray crossings ----

_SAME = 1e-8
"""Relative tolerance, in mesh sizes, within which vertices are merged."""

_DIRECTIONS = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3, 3)))[0]
"""Frames (3, 3, 3) whose z axes are the rays, in general position so that no ray meets an edge."""


@dataclass(frozen=True, eq=False)
@read_only
class _MeshParts:
    """Connected parts of a mesh, with coincident vertices merged, for containment tests.

    Attributes
    ----------
    points, faces
        Vertices (V, 3), m, and triangles (F, 3).
    part
        Number of the part, 0 to P − 1, to which each triangle belongs (F,).
    closed
        Mask (P,): True for a closed part, each of whose edges occurs equally often in both
        directions.
    """

    points: Array
    faces: NDArray[np.intp]
    part: NDArray[np.intp]
    closed: NDArray[np.bool_]

    @property
    def witnesses(self) -> Array:
        """One vertex of each of the P parts: (P, 3), m."""
        _, first = np.unique(self.part, return_index=True)
        return self.points[self.faces[first, 0]]


def _mesh_parts(points: Array, faces: NDArray[np.intp]) -> _MeshParts:
    """Split a mesh into connected parts, after merging coincident vertices.

    STL files store each triangle with its own vertices, so nothing is connected before the merging.
    Triangles that merging collapses are dropped. ``points`` (V, 3), m, and ``faces`` (F, 3) are the
    mesh.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    grid = max(float(np.ptp(points, axis=0).max()), 1e-300) * _SAME
    _, first, merged = np.unique(
        np.round(points / grid), axis=0, return_index=True, return_inverse=True
    )
    points = points[first]
    faces = merged.reshape(-1)[faces]
    thin = (faces == np.roll(faces, 1, axis=1)).any(axis=1)
    if not thin.all():
        faces = faces[~thin]
    tails = faces.reshape(-1)
    heads = np.roll(faces, -1, axis=1).reshape(-1)
    size = (len(points), len(points))
    passed: Any = coo_array((np.ones(len(tails)), (tails, heads)), shape=size).tocsr()
    _, label = connected_components(passed, directed=False)
    _, part = np.unique(label[faces[:, 0]], return_inverse=True)
    uneven = (passed - passed.T).tocoo()
    closed = np.ones(part.max() + 1, bool)
    part_of_vertex = np.zeros(len(points), np.intp)
    part_of_vertex[faces] = part[:, None]
    closed[part_of_vertex[uneven.row[uneven.data != 0]]] = False
    return _MeshParts(points, faces, part, closed)


class _MeshInterior:
    r"""Interior of a mesh: points from which a ray crosses more faces outwards than inwards.

    A ray leaves the mesh at a face whose normal points along the ray, and enters it at one whose
    normal points against the ray. This test is also right where closed parts overlap, and excludes
    cavities.

    Parameters
    ----------
    parts
        Parts of the mesh.
    gaps
        True to include parts that are not closed; if there are any, a point is inside if the test
        holds for at least two of three rays. False to ignore such parts.
    """

    def __init__(self, parts: _MeshParts, *, gaps: bool) -> None:
        kept = parts.faces if gaps else parts.faces[parts.closed[parts.part]]
        turns = _DIRECTIONS if gaps and not parts.closed.all() else _DIRECTIONS[:1]
        self._rays = [_Ray(turn, parts.points, kept) for turn in turns] if len(kept) else []

    def contains(self, points: Array) -> bool:
        """Test whether any of the points (K, 3), m, in the mesh's own frame, is inside."""
        return any(self._contains(point) for point in points)

    def _contains(self, point: Array) -> bool:
        votes = sum(ray.crossings(point) > 0 for ray in self._rays)
        return 2 * votes > len(self._rays)


class _Ray:
    """Faces of a mesh, sorted to find those that a ray in a given direction crosses.

    ``turn`` (3, 3) has columns x, y and z, of which z is the direction of the rays. The faces are
    sorted into strips along x, so that few are tested per ray.
    """

    def __init__(self, turn: Array, points: Array, faces: NDArray[np.intp]) -> None:
        self._turn = turn
        corners = (points @ turn)[faces]
        low, high = corners.min(axis=1), corners.max(axis=1)  # (F, 3)
        self._bottom = low.min(axis=0)
        self._top = high.max(axis=0)
        self._edges = np.linspace(self._bottom[0], self._top[0], int(np.sqrt(len(faces))) + 1)
        ends = zip(self._edges[:-1], self._edges[1:], strict=True)
        meets = [(low[:, 0] <= end) & (high[:, 0] >= start) for start, end in ends]
        self._strips = [(corners[on], low[on].T, high[on].T) for on in meets]

    def crossings(self, point: Array) -> int:
        """Count how much more often the ray from a point (3,) leaves the mesh than enters it.

        The point is in the mesh's own frame, m.
        """
        p = point @ self._turn
        if (p < self._bottom).any() or (p > self._top).any():
            return 0
        strip = min(int(np.searchsorted(self._edges, p[0], side="right")), len(self._strips)) - 1
        corners, (left, front, _), (right, back, top) = self._strips[strip]
        x, y, z = p.tolist()
        near = (left <= x) & (x <= right) & (front <= y) & (y <= back) & (z <= top)
        return sum(_looks_up(corner) for corner in (corners[near] - p).tolist())


def _looks_up(corners: list[list[float]]) -> int:
    """Return 1 if the ray from the origin along +z crosses a triangle whose normal points up.

    Return −1 if it crosses a triangle whose normal points down, and 0 if it crosses none. Each of
    the three corners is (x, y, z).
    """
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = corners
    # twice the signed areas of the triangles formed by the origin and each edge
    bc = bx * cy - by * cx
    ca = cx * ay - cy * ax
    ab = ax * by - ay * bx
    height = bc * az + ca * bz + ab * cz
    if bc > 0 and ca > 0 and ab > 0:
        return int(height > 0)
    if bc < 0 and ca < 0 and ab < 0:
        return -int(height < 0)
    return 0
