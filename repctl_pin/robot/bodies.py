"""How near a robot's own bodies come to each other."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from weakref import WeakKeyDictionary

import coal
import numpy as np
import pinocchio as pin
import trimesh
from numpy.typing import ArrayLike, NDArray

from ..arguments import rows, wanted
from ..urdf.catalogue import disabled_pairs
from ..urdf.meshes import find_mesh
from ..urdf.shapes import Solid
from .task import Task

Array = NDArray[np.float64]
Pair = tuple[str, str]

_SAMPLES = 100
"""Configurations at which it is looked whether a pair touches always."""

_FREE = np.pi
"""How far, rad or m, from the reference pose they go where a joint has no limit."""

_LARGEST = 100_000_000
"""Bytes of a mesh file that is still read."""


_MADE: WeakKeyDictionary[Task, Bodies] = WeakKeyDictionary()


@dataclass(frozen=True)
class Nearest:
    """The two bodies that are nearest to each other.

    Attributes
    ----------
    distance : float
        m; below 0 they overlap. inf where no two bodies move against each other.
    links : (str, str)
        Whose they are.
    """

    distance: float
    links: Pair


class Bodies:
    """The collision bodies of a robot, and the pairs of them that a task's joints move against each other.

    A mesh is replaced by its convex hull, so no distance is above that of the mesh. Pairs that share a joint, that
    the robot's SRDF rules out, or that touch at every configuration tried (as the hulls of neighbours do) are left
    out. Not to be shared between threads.

    Parameters
    ----------
    task
        Whose joints move; the others stand at the reference pose.

    Attributes
    ----------
    pairs : tuple of (str, str)
        Links between which distances are measured.
    touching : tuple of (str, str)
        Pairs left out because they touch at every configuration tried.
    disabled : tuple of (str, str)
        Pairs left out because the SRDF rules them out.
    missing : tuple of str
        Meshes, as the URDF writes them, that were not found or cannot be read: those links have no body.

    Raises
    ------
    InputError
        If what is given is not a task.

    Examples
    --------
    >>> bodies = rp.Bodies(panda)
    >>> len(bodies.pairs) > 10
    True
    >>> bodies.nearest(panda.reference).distance > 0.05  # m
    True
    """

    def __init__(self, task: Task) -> None:
        self.task = wanted(task, Task, "task", "a task, such as rp.Robot.load('panda').task()")
        self._model, self._drive = task.bodies_model()
        self._data = self._model.createData()
        self._shapes = pin.GeometryModel()
        missing = [name for name in map(self._add, task.robot.description.collisions) if name]
        self.missing = tuple(dict.fromkeys(missing))
        self._links = [body.name.rpartition("_")[0] for body in self._shapes.geometryObjects]
        self._joint = np.array([body.parentJoint for body in self._shapes.geometryObjects], int)
        boxes = [(body.placement.act(body.geometry.aabb_center), body.geometry.aabb_radius)
                 for body in self._shapes.geometryObjects]  # fmt: skip
        self._centers = np.array([center for center, _ in boxes]).reshape(-1, 3)
        self._radii = np.array([radius for _, radius in boxes])
        pairs = self._moving_pairs()
        entry = task.robot.entry
        ruled_out = disabled_pairs(entry.srdf) if entry is not None and entry.srdf is not None else set()
        self.disabled = self._named(pair for pair in pairs if frozenset(self._pair(pair)) in ruled_out)
        self._measure([pair for pair in pairs if frozenset(self._pair(pair)) not in ruled_out])
        always = self._touching_always()
        self.touching = self._named(pair for pair, touch in zip(self._both, always, strict=True) if touch)
        self._measure([pair for pair, touch in zip(self._both, always, strict=True) if not touch])
        self.pairs = self._named(self._both)

    # ---- distances -----------------------------------------------------------------------------

    def nearest(self, q: ArrayLike) -> Nearest:
        """Find the two bodies nearest to each other at q (n,)."""
        distances, which = self._all(np.asarray(q, float)[None])
        links = ("", "") if which[0] < 0 else self._pair(self._both[which[0]])
        return Nearest(float(distances[0]), links)

    def distances(self, Q: ArrayLike) -> Array:
        """Measure the least distance between bodies at every row of Q (K, n): (K,), m; below 0 they overlap."""
        return self._all(Q)[0]

    def _all(self, Q: ArrayLike) -> tuple[Array, NDArray[np.intp]]:
        """Least distance and its pair at every row of Q: (K,), (K,)."""
        Q = rows(Q, self.task.n, repr(self.task))
        found, which, last = np.full(len(Q), np.inf), np.full(len(Q), -1), 0
        for k, q in enumerate(Q if self._drive is None else self._drive.joints(Q)):
            if len(self._both):
                found[k], last = self._least(q, last)
                which[k] = last
        return found, which

    def _least(self, q: Array, guess: int) -> tuple[float, int]:
        """Measure exactly only where the spheres round two bodies are nearer than the best pair known."""
        bounds = self._place(q)
        best, at = self._exact(guess), guess
        near = np.flatnonzero(bounds < best)
        for k in near[np.argsort(bounds[near])].tolist():
            if bounds[k] >= best:
                break
            distance = self._exact(k)
            if distance < best:
                best, at = distance, k
        return best, at

    def _place(self, q: Array) -> Array:
        """Move all bodies; bound the distance of every pair from below by spheres (P,)."""
        pin.forwardKinematics(self._model, self._data, q)
        pin.updateGeometryPlacements(self._model, self._data, self._shapes, self._placed)
        M = np.array([joint.homogeneous for joint in self._data.oMi])[self._joint]
        centers = (M[:, :3, :3] @ self._centers[:, :, None])[:, :, 0] + M[:, :3, 3]
        gaps = centers[self._first] - centers[self._second]
        return np.sqrt(np.einsum("pi,pi->p", gaps, gaps)) - self._reach

    def _exact(self, k: int) -> float:
        return pin.computeDistance(self._shapes, self._placed, k).min_distance

    # ---- making them ---------------------------------------------------------------------------

    def _add(self, solid: Solid) -> str:
        """Add a body; return the name of its mesh where there is none."""
        robot = self.task.robot
        geometry = _geometry(solid, robot.description.path, robot.package_dirs)
        if geometry is None:
            return solid.filename
        geometry.computeLocalAABB()
        link = next(f for f in self._model.frames if f.name == solid.link and f.type == pin.FrameType.BODY)
        origin = pin.SE3(pin.rpy.rpyToMatrix(np.array(solid.rpy)), np.array(solid.xyz))
        body = pin.GeometryObject(solid.name, link.parentJoint, link.placement * origin, geometry)
        self._shapes.addGeometryObject(body)
        return ""

    def _moving_pairs(self) -> list[tuple[int, int]]:
        """Pairs of bodies that a joint moves against each other, but not those next to each other."""
        parent, joint, many = list(self._model.parents), self._joint.tolist(), range(len(self._joint))
        return [
            (a, b)
            for b in many
            for a in range(b)
            if joint[a] != joint[b] and parent[joint[a]] != joint[b] and parent[joint[b]] != joint[a]
        ]

    def _measure(self, pairs: list[tuple[int, int]]) -> None:
        """Choose the pairs whose distances are measured."""
        self._both = pairs
        self._shapes.removeAllCollisionPairs()
        for a, b in pairs:
            self._shapes.addCollisionPair(pin.CollisionPair(a, b))
        self._placed = pin.GeometryData(self._shapes)
        self._first, self._second = np.array(pairs, int).reshape(-1, 2).T
        self._reach = self._radii[self._first] + self._radii[self._second]

    def _touching_always(self) -> NDArray[np.bool_]:
        """Say which of the measured pairs touch at the reference and at random configurations: (P,)."""
        always, q0 = np.ones(len(self._both), bool), np.array(self.task.reference)
        low, high = np.maximum(self.task.lower, q0 - _FREE), np.minimum(self.task.upper, q0 + _FREE)
        random = np.random.default_rng(0).uniform(low, high, (_SAMPLES, self.task.n))
        for q in np.vstack([q0, random]):
            if always.any():
                bounds = self._place(q if self._drive is None else self._drive.joints(q))
                always &= bounds < 0
                for k in np.flatnonzero(always).tolist():
                    always[k] = self._exact(k) <= 0
        return always

    def _pair(self, pair: tuple[int, int]) -> Pair:
        return self._links[pair[0]], self._links[pair[1]]

    def _named(self, pairs: Iterable[tuple[int, int]]) -> tuple[Pair, ...]:
        return tuple(dict.fromkeys(map(self._pair, pairs)))


def bodies_of(task: Task) -> Bodies:
    """Make the bodies of a task, once."""
    if task not in _MADE:
        _MADE[task] = Bodies(task)
    return _MADE[task]


def _geometry(solid: Solid, urdf: Path, package_dirs: tuple[str, ...]) -> coal.CollisionGeometry | None:
    """Make a body: a mesh as its convex hull; None where it cannot be had."""
    if solid.kind == "mesh":
        path = find_mesh(solid.filename, urdf, package_dirs)
        return None if path is None else _hull(path, np.array(solid.scale))
    kinds = {"box": coal.Box, "sphere": coal.Sphere, "cylinder": coal.Cylinder, "capsule": coal.Capsule}
    return kinds[solid.kind](*solid.size)


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
