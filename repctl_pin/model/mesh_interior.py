"""Point-in-mesh test by signed ray crossings."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array, read_only

_Index = NDArray[np.intp]

_SAME = 1e-8
"""Relative tolerance, in mesh sizes, within which vertices are merged."""

_DIRECTIONS = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3, 3)))[0]
"""Frames (3, 3, 3) whose z axes are the rays, in general position so that no ray meets an edge."""


@dataclass(frozen=True, eq=False)
@read_only
class MeshParts:
    """Connected parts of a mesh, with coincident vertices merged.

    Attributes
    ----------
    points, faces
        Vertices (V, 3), m, and triangles (F, 3).
    part
        Part number of each triangle (F,).
    closed
        True for each closed part (P,): every edge occurs equally often in both directions.
    """

    points: Array
    faces: _Index
    part: _Index
    closed: NDArray[np.bool_]

    @property
    def witnesses(self) -> Array:
        """One vertex of each part (P, 3), m."""
        _, first = np.unique(self.part, return_index=True)
        return self.points[self.faces[first, 0]]


def mesh_parts(points: Array, faces: _Index) -> MeshParts:
    """Split a mesh into connected parts, after merging coincident vertices."""
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
    return MeshParts(points, faces, part, closed)


class MeshInterior:
    r"""Interior of a mesh: points from which rays cross more faces outwards than inwards.

    With s = 1 for a crossed face whose normal points along the ray, and s = −1 for one against it,
    a point is inside a closed mesh if Σ s > 0. This also holds where closed parts overlap, and
    excludes cavities.

    Parameters
    ----------
    parts
        Parts of the mesh.
    gaps
        True to include parts with gaps: a point is then inside if two of three rays say so. False
        to ignore them.
    """

    def __init__(self, parts: MeshParts, *, gaps: bool) -> None:
        kept = parts.faces if gaps else parts.faces[parts.closed[parts.part]]
        turns = _DIRECTIONS if gaps and not parts.closed.all() else _DIRECTIONS[:1]
        self._rays = (
            [_Ray(turn, parts.points, kept) for turn in turns] if len(kept) else []
        )

    def contains(self, points: Array) -> bool:
        """Test whether any of the points (K, 3) is inside."""
        return any(self._contains(point) for point in points)

    def _contains(self, point: Array) -> bool:
        votes = sum(ray.crossings(point) > 0 for ray in self._rays)
        return 2 * votes > len(self._rays)


class _Ray:
    """Crossings of a mesh by rays in one direction, from any point.

    The faces are sorted into strips along x, so that few are tested per ray. Their corners
    (F, 3, 3) are in axes whose z axis is the direction of the rays.
    """

    def __init__(self, turn: Array, points: Array, faces: _Index) -> None:
        self._turn = turn
        corners = (points @ turn)[faces]
        low, high = corners.min(axis=1), corners.max(axis=1)  # (F, 3)
        self._bottom = low.min(axis=0)
        self._top = high.max(axis=0)
        self._edges = np.linspace(
            self._bottom[0], self._top[0], int(np.sqrt(len(faces))) + 1
        )
        ends = zip(self._edges[:-1], self._edges[1:], strict=True)
        meets = [(low[:, 0] <= end) & (high[:, 0] >= start) for start, end in ends]
        self._strips = [(corners[on], low[on].T, high[on].T) for on in meets]

    def crossings(self, point: Array) -> int:
        """Sum ±1 over the faces that the ray from a point (3,) crosses.

        It is −1 for a face whose normal points against the ray.
        """
        p = point @ self._turn
        if (p < self._bottom).any() or (p > self._top).any():
            return 0
        strip = (
            min(
                int(np.searchsorted(self._edges, p[0], side="right")), len(self._strips)
            )
            - 1
        )
        corners, (left, front, _), (right, back, top) = self._strips[strip]
        x, y, z = p.tolist()
        near = (left <= x) & (x <= right) & (front <= y) & (y <= back) & (z <= top)
        return sum(_looks_up(corner) for corner in (corners[near] - p).tolist())


def _looks_up(corners: list[list[float]]) -> int:
    """Return whether a triangle above the origin faces up (1) or down (−1); 0 if not above it.

    The three corners are given as x, y, z.
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
