"""Collision bodies as the distance library takes them: primitives, and meshes as their convex hulls."""

from __future__ import annotations

from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
import trimesh
from numpy.typing import NDArray

from ..urdf.gate import Description
from ..urdf.meshes import find_mesh
from ..urdf.shapes import Solid

Array = NDArray[np.float64]

_LARGEST = 100_000_000
"""Bytes of a mesh file that is still read."""


def body_shape(solid: Solid, urdf: Path, package_dirs: tuple[str, ...]) -> coal.CollisionGeometry | None:
    """Make a body: a mesh as its convex hull; None where it cannot be had."""
    if solid.kind == "mesh":
        path = find_mesh(solid.filename, urdf, package_dirs)
        return None if path is None else _hull(path, np.array(solid.scale))
    kinds = {"box": coal.Box, "sphere": coal.Sphere, "cylinder": coal.Cylinder, "capsule": coal.Capsule}
    return kinds[solid.kind](*solid.size)


def origin(solid: Solid) -> pin.SE3:
    """Place a body on its link."""
    return pin.SE3(pin.rpy.rpyToMatrix(np.array(solid.rpy)), np.array(solid.xyz))


def fixed_placements(description: Description) -> dict[str, pin.SE3]:
    """Place every link of something that does not move, measured from its root."""
    model = pin.buildModelFromXML(description.xml)
    return {frame.name: frame.placement for frame in model.frames if frame.type == pin.FrameType.BODY}


def _hull(path: Path, scale: Array) -> coal.CollisionGeometry | None:
    """Read a mesh and wrap it; None where it cannot be read, or is flat."""
    try:
        if path.stat().st_size > _LARGEST:
            return None
        mesh = trimesh.load(path, force="mesh", process=False)
        points = np.asarray(mesh.convex_hull.vertices, float) * scale
    except Exception:  # a stranger's file, read by a dozen libraries: whatever they raise, there is no body
        return None
    if len(points) < 4 or not np.isfinite(points).all():
        return None
    cloud = coal.StdVec_Vec3s()
    cloud.extend(list(points))
    return coal.ConvexBase.convexHull(cloud, True, "Qt")
