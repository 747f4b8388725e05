"""Corners of the drawn bodies, and how far the bodies drift between cycles."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from ...arguments import Array
from ...errors import InputError
from ...motion.displacement import displacements
from ...robot.visuals import Shape
from .surfaces import Surface, Surfaces, read_surfaces

_RIM = 24
"""Number of corners of the polygon that approximates a circle."""

_KEPT = 256
_hulls: dict[tuple[Path, int], Array] = {}
"""Cache of mesh hulls, by file path and modification time; the terminal and the page share it."""


def body_drift(
    bodies: Sequence[Array], placements: Array, per_cycle: int
) -> tuple[tuple[Array, ...], Array]:
    """Compute how far each body is displaced since the same moment of cycle 1.

    Parameters
    ----------
    bodies : sequence of (P, 3) arrays
        Corners of each body, see :func:`corners`.
    placements : (T, S, 4, 4) array
        Placements of S bodies at T samples, cycle by cycle.
    per_cycle
        Number of samples of one cycle, including both ends.

    Returns
    -------
    points : tuple of (P, 3) arrays
        For each body, in its own frame, m: the corners that are displaced most at any sample, and
        the outermost corners.
    off : (T, S) array
        Displacement of S bodies at T samples, m. At the end of a cycle, it is counted from the
        start of cycle 1.
    """
    first = np.arange(len(placements)) % per_cycle
    first[per_cycle - 1 :: per_cycle] = 0
    off, which = displacements(placements[first], placements, bodies)
    kept = [
        body[np.union1d(np.unique(which[:, s]), _outermost(body))]
        for s, body in enumerate(bodies)
    ]
    return tuple(kept), off


def farthest(shapes: Sequence[Shape], off: Array) -> tuple[str, float]:
    """Find the link of the shape that is displaced most, and how far, m, from all of them (S,)."""
    if not len(shapes):
        return "", 0.0
    which = int(np.argmax(off))
    return shapes[which].link, float(off[which])


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
        read = read_surfaces([shape]) if surfaces is None else surfaces
        _hulls[key] = _mesh_hull(read[shape.path])
    return _hulls[key]


def _mesh_hull(surface: Surface | InputError) -> Array:
    """Collect the corners (P, 3) of a mesh's convex hull; the origin for an unreadable mesh."""
    if not isinstance(surface, Surface):
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
    """Find the corners of a body, by index, that lie farthest in the eight diagonal directions."""
    ways = np.array(list(product((-1.0, 1.0), repeat=3)))
    return np.unique(np.argmax(body @ ways.T, axis=0))
