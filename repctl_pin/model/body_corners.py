"""Corners of the drawn bodies."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from ..arguments import Array
from ..errors import InputError
from .visuals import Shape

if TYPE_CHECKING:
    from .surfaces import Surface, Surfaces

_RIM = 24
"""Number of corners of the polygon that approximates a circle."""

_KEPT = 256
_hulls: dict[tuple[Path, int], Array] = {}
"""Cache of mesh hulls, by file path and modification time; the terminal and the page share it."""


def corners(shapes: Sequence[Shape], surfaces: Surfaces | None = None) -> list[Array]:
    """Collect the corners of each shape's convex hull in its own frame, scaled: (P, 3) each, m.

    A shape that cannot be read has one corner, at its origin. ``surfaces`` are the contents of the
    mesh files; if None, the files are read.
    """
    return [_hull(shape, surfaces) * np.array(shape.scale) for shape in shapes]


def _hull(shape: Shape, surfaces: Surfaces | None) -> Array:
    """Collect the corners of a shape's convex hull before scaling: (P, 3)."""
    if shape.kind != "mesh":
        return _primitive(shape)
    assert shape.path is not None
    try:
        key = (shape.path, shape.path.stat().st_mtime_ns)
    except OSError:
        return np.zeros((1, 3))
    if key not in _hulls:
        if len(_hulls) >= _KEPT:
            _hulls.clear()
        if surfaces is None:
            from .surfaces import (
                read_surfaces,  # an arm without meshes has no need of it
            )

            surfaces = read_surfaces([shape])
        _hulls[key] = _mesh_hull(surfaces[shape.path])
    return _hulls[key]


def _mesh_hull(surface: Surface | InputError) -> Array:
    """Collect the corners (P, 3) of a mesh's convex hull; the origin for an unreadable mesh."""
    if isinstance(surface, InputError):
        return np.zeros((1, 3))
    try:
        points = surface.points[ConvexHull(surface.points).vertices]
    except (QhullError, ValueError):  # flat
        points = surface.points
    return np.unique(points, axis=0)


def _primitive(shape: Shape) -> Array:
    """Collect the corners of a box, or of a polytope that approximates a round shape: (P, 3), m."""
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
