"""Collision bodies as the distance library takes them: primitives, and meshes with their convex hulls."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ..arguments import Array
from ..errors import needed
from ..urdf.gate import Description
from ..urdf.shapes import Solid, find_mesh
from .model import link_frames

_LARGEST = 100_000_000
"""Bytes of a mesh file that is still read."""


_THIN = 1e-4
"""Thinner than this, m, a body is given a thickness."""


@dataclass(frozen=True)
class BodyShape:
    """A body: its convex hull, and the points (V, 3) and triangles (F, 3) of the mesh that it wraps, if it is one."""

    hull: coal.CollisionGeometry
    points: Array | None = None
    faces: NDArray[np.intp] | None = None

    @cached_property
    def exact(self) -> coal.CollisionGeometry:
        """The body as it is."""
        if self.points is None or self.faces is None:
            return self.hull
        mesh, triangles = coal.BVHModelOBBRSS(), coal.StdVec_Triangle()
        triangles.extend([coal.Triangle(*face) for face in self.faces.tolist()])
        mesh.beginModel(len(self.faces), len(self.points))
        mesh.addSubModel(_cloud(self.points), triangles)
        mesh.endModel()
        return mesh


def body_shape(solid: Solid, urdf: Path, package_dirs: tuple[str, ...]) -> BodyShape | None:
    """Make a body; None where its mesh cannot be had."""
    if solid.kind == "mesh":
        path = find_mesh(solid.filename, urdf, package_dirs)
        return None if path is None else _wrapped(path, tuple(solid.scale), path.stat().st_mtime_ns)
    kinds = {"box": coal.Box, "sphere": coal.Sphere, "cylinder": coal.Cylinder, "capsule": coal.Capsule}
    return BodyShape(kinds[solid.kind](*solid.size))


def touch(one: BodyShape, here: pin.SE3, other: BodyShape, there: pin.SE3) -> bool:
    """Say whether two bodies touch as they are, at their places."""
    places = [coal.Transform3s(place.rotation, place.translation) for place in (here, there)]
    request, result = coal.CollisionRequest(), coal.CollisionResult()
    return bool(coal.collide(one.exact, places[0], other.exact, places[1], request, result))


def origin(solid: Solid) -> pin.SE3:
    """Place a body on its link."""
    return pin.SE3(pin.rpy.rpyToMatrix(np.array(solid.rpy)), np.array(solid.xyz))


def fixed_placements(description: Description) -> dict[str, pin.SE3]:
    """Place every link of something that does not move, measured from its root."""
    return {name: frame.placement for name, frame in link_frames(pin.buildModelFromXML(description.xml)).items()}


@lru_cache(maxsize=256)
def _wrapped(path: Path, scale: tuple[float, ...], changed: int) -> BodyShape | None:
    """Read a mesh and wrap it, once for all tasks; None where it cannot be read."""
    collada = ["collada"] if path.suffix.lower() == ".dae" else []
    needed("trimesh", *collada, by=f"the distance to the mesh {path.name}")
    import trimesh

    try:
        if path.stat().st_size > _LARGEST:
            return None
        mesh = trimesh.load(path, force="mesh", process=False)
        vertices, faces = np.asarray(mesh.vertices, float) * scale, np.asarray(mesh.faces, np.intp)
        points = trimesh.convex.convex_hull(_thickened(vertices)).vertices
    except Exception:  # a stranger's file, read by a dozen libraries: whatever they raise, there is no body
        return None
    if len(points) < 4 or not np.isfinite(points).all():
        return None
    return BodyShape(_hull(points), vertices, faces)


def _hull(points: Array) -> coal.CollisionGeometry:
    """Wrap the corners of a convex body; where one has more neighbours than coal takes, 255, on a coarser grid."""
    size = float(np.ptp(points, axis=0).max())
    for grid in size * np.array([0, 1 / 1024, 1 / 256, 1 / 64]):
        corners = points
        if grid:
            # outwards by as much as the rounding may have moved them inwards
            out = points - points.mean(axis=0)
            out /= np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-300)
            corners = np.unique(np.round((points + grid * out) / grid), axis=0) * grid
        with suppress(RuntimeError):
            return coal.ConvexBase.convexHull(_cloud(corners), True, "Qt")
    low, high = points.min(axis=0), points.max(axis=0)
    box = np.array([[(low, high)[k >> i & 1][i] for i in range(3)] for k in range(8)])
    return coal.ConvexBase.convexHull(_cloud(box), True, "Qt")


def _thickened(points: Array) -> Array:
    """Give a flat body a thickness, 0.2 mm: the distance library crashes on a hull without volume."""
    spread, axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[1:]
    for axis in axes[spread < np.sqrt(len(points)) * _THIN]:
        points = np.concatenate([points + _THIN * axis, points - _THIN * axis])
    return points


def _cloud(points: Array) -> coal.StdVec_Vec3s:
    cloud = coal.StdVec_Vec3s()
    cloud.extend(list(points))
    return cloud
