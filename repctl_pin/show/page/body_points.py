"""Corners of the drawn bodies, by which the page measures how far each is off."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from ...arguments import Array, read_only
from ...errors import InputError
from ...motion.displacement import displacements
from ...robot.visuals import Shape
from .surfaces import Surface, Surfaces, read_surfaces

_RIM = 24
"""Corners of the polygon that stands for a circle."""

_KEPT = 256
_hulls: dict[tuple[Path, int], Array] = {}
"""Hulls of mesh files by path and time of change: the terminal and the page measure with them."""


@dataclass(frozen=True, eq=False)
@read_only
class BodyDrift:
    """How far each body is off its place in cycle 1.

    Attributes
    ----------
    points : tuple of (P, 3) arrays
        For each body the corners that are ever farthest off, and its outermost ones, m.
    off : (T, S) array
        Displacement of each body since the same moment of cycle 1, m; at the end of a cycle, since
        the start.
    """

    points: tuple[Array, ...]
    off: Array


def body_drift(bodies: Sequence[Array], placements: Array, per_cycle: int) -> BodyDrift:
    """Measure how far each body is off its place in cycle 1.

    Parameters
    ----------
    bodies : sequence of (P, 3) arrays
        Corners of each body, see :func:`corners`.
    placements : (T, S, 4, 4) array
        Placements of the bodies, cycle by cycle.
    per_cycle
        Number of samples of one cycle, including both ends.
    """
    first = np.arange(len(placements)) % per_cycle
    first[per_cycle - 1 :: per_cycle] = 0
    off, which = displacements(placements[first], placements, bodies)
    kept = [
        body[np.union1d(np.unique(which[:, s]), _outermost(body))] for s, body in enumerate(bodies)
    ]
    return BodyDrift(tuple(kept), off)


def corners(shapes: Sequence[Shape], surfaces: Surfaces | None = None) -> list[Array]:
    """Collect the corners of each shape's convex hull in its own frame, scaled: (P, 3) each, m.

    A shape that cannot be read has one, its origin. The surfaces of their mesh files are read if
    not given.
    """
    return [_hull(shape, surfaces) * np.array(shape.scale) for shape in shapes]


def _hull(shape: Shape, surfaces: Surfaces | None) -> Array:
    """Collect the corners of a shape's convex hull, without its scale."""
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
        read = read_surfaces([shape]) if surfaces is None else surfaces
        _hulls[key] = _mesh_hull(read[shape.path])
    return _hulls[key]


def _mesh_hull(surface: Surface | InputError) -> Array:
    """Collect the corners of a mesh's convex hull; the origin for a mesh that cannot be read."""
    if not isinstance(surface, Surface):
        return np.zeros((1, 3))
    points = np.unique(surface.points, axis=0)
    try:
        return points[ConvexHull(points).vertices]
    except (QhullError, ValueError):  # flat
        return points


def _primitive(shape: Shape) -> Array:
    """Collect corners of a box, or of a polytope that stands for a round shape."""
    ends = np.array([-0.5, 0.5])
    if shape.kind == "box":
        return np.array(list(product(*(edge * ends for edge in shape.size))))
    angles = 2 * np.pi * np.arange(_RIM) / _RIM
    radius, length = shape.size[0], shape.size[1] if len(shape.size) > 1 else 0.0
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


def _outermost(body: Array) -> NDArray[np.intp]:
    """Find the corners that lie farthest in the directions of a box's corners."""
    ways = np.array(list(product((-1.0, 1.0), repeat=3)))
    return np.unique(np.argmax(body @ ways.T, axis=0))
