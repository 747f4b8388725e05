"""How near a robot's own bodies come to each other, and to its surroundings."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from weakref import WeakKeyDictionary

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from ..arguments import Array, rows, vector, wanted
from ..errors import InputError
from ..urdf.catalogue import disabled_pairs
from ..urdf.shapes import Solid
from .body_bounds import BodyBounds
from .body_shapes import BodyShape, body_shape, fixed_placements, origin, touch
from .model import link_frames
from .task import Task

Pair = tuple[str, str]

_SAMPLES = 100
"""Configurations at which it is looked whether a pair touches always."""

_FREE = np.pi
"""How far, rad or m, from the reference pose they go where a joint has no limit."""

_TOUCHING = 1e-12
"""Distance, m, below 0, of two bodies that touch in a point."""

_BLOCK = 64
"""Configurations whose bounds are worked out at once: they stay in the processor's cache."""

_MOST_BOUNDS = 1_000_000
"""Bounds held at once, at most, where there are very many pairs."""

_MADE: WeakKeyDictionary[Task, Bodies] = WeakKeyDictionary()


@dataclass(frozen=True)
class Nearest:
    """The two bodies that are nearest to each other.

    Attributes
    ----------
    distance : float
        m; below 0 they touch, at 0 only their hulls do. inf if no two bodies move against each other.
    links : (str, str)
        Whose they are.
    """

    distance: float
    links: Pair


class Bodies:
    """The collision bodies of a robot and of its surroundings, and the pairs that a task's joints move.

    A mesh is replaced by its convex hull, so no distance is larger than that of the mesh; if hulls overlap but the
    meshes do not touch, it is 0. Among the robot's own bodies, pairs are left out that share a joint, that its SRDF
    rules out, or whose hulls overlap at every configuration tried (as neighbours' do); with the surroundings
    (``rp.Robot.load(…, surroundings=)``), only the last kind. Not thread-safe.

    Parameters
    ----------
    task
        The task whose joints move; the other joints stay at the reference pose.

    Attributes
    ----------
    pairs : tuple of (str, str)
        Links between which distances are measured.
    touching : tuple of (str, str)
        Pairs left out because they, or their hulls, touch at every configuration tried.
    disabled : tuple of (str, str)
        Pairs left out because the SRDF rules them out.
    missing : tuple of str
        Meshes, as the URDF writes them, that were not found or cannot be read: those links have no body.
    standing : frozenset of str
        Links of the surroundings; if the robot has a link of the same name, it is called ``surroundings/name``.

    Raises
    ------
    InputError
        If what is given is not a task, or a mesh of the surroundings cannot be read.

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
        robot = task.robot
        self._links: list[str] = []
        self._bodies: list[BodyShape] = []
        links, missing = link_frames(self._model), []
        for solid in robot.description.collisions:
            link = links[solid.link]
            if not self._add(solid, robot.description.path, link.parentJoint, link.placement, solid.link):
                missing.append(solid.filename)
        self.missing = tuple(dict.fromkeys(missing))
        own = len(self._links)
        self._add_surroundings()
        self.standing = frozenset(self._links[own:])
        pairs = self._moving_pairs(own)
        entry = robot.entry
        ruled_out = disabled_pairs(entry.srdf) if entry is not None and entry.srdf is not None else set()
        self.disabled = self._named(pair for pair in pairs if frozenset(self._pair(pair)) in ruled_out)
        self._measure([pair for pair in pairs if frozenset(self._pair(pair)) not in ruled_out])
        always = self._touching_always()
        self.touching = self._named(pair for pair, touch in zip(self._both, always, strict=True) if touch)
        self._measure([pair for pair, touch in zip(self._both, always, strict=True) if not touch])
        self.pairs = self._named(self._both)

    def __reduce__(self) -> tuple[type[Bodies], tuple[Task]]:
        """Pickle the task: its bodies are made again."""
        return type(self), (self.task,)

    def __repr__(self) -> str:
        left_out = f"{len(self.disabled)} disabled by the SRDF, {len(self.touching)} that always touch"
        return f"<Bodies of {self.task.robot.name}: {len(self.pairs)} pairs measured; left out: {left_out}>"

    @property
    def notes(self) -> list[str]:
        """What a user should know: which bodies are missing, and which of the surroundings are ignored."""
        notes = []
        if self.missing:
            more = f" and {len(self.missing) - 1} more" if len(self.missing) > 1 else ""
            notes.append(f"collision mesh {self.missing[0]!r}{more} not found or not read: touches there are not seen")
        elif not self.task.robot.description.collisions:
            notes.append("the URDF has no collision shapes: how near the robot comes to itself is not known")
        stuck = [" and ".join(pair) for pair in self.touching if self.standing & {*pair}]
        if stuck:
            notes.append(f"{', '.join(stuck)} touch at every configuration tried, and are not looked at")
        return notes

    # ---- distances -----------------------------------------------------------------------------

    def nearest(self, q: ArrayLike) -> Nearest:
        """Find the two bodies nearest to each other at q (n,)."""
        distances, which = self._all(vector(q, self.task.n, "q")[None])
        links = ("", "") if which[0] < 0 else self._pair(self._both[which[0]])
        return Nearest(float(distances[0]), links)

    def distances(self, Q: ArrayLike) -> Array:
        """Measure the smallest distance between bodies at every row of Q (K, n): (K,), m; below 0 they touch."""
        return self._all(Q)[0]

    def hull_distances(self, Q: ArrayLike) -> Array:
        """Measure the smallest distance between convex hulls at every row of Q (K, n): (K,), m.

        Below 0 it is how deep the hulls overlap, whether or not the bodies touch: its slope says what moves them apart.
        """
        return self._all(Q, hulls=True)[0]

    def _all(self, Q: ArrayLike, *, hulls: bool = False) -> tuple[Array, NDArray[np.intp]]:
        """Least distance and its pair at every row of Q: (K,), (K,)."""
        Q = rows(Q, self.task.n, repr(self.task))
        found, which, last = np.full(len(Q), np.inf), np.full(len(Q), -1), 0
        measure = self._of_hulls if hulls else self._exact
        if not self._both:
            return found, which
        Q = Q if self._drive is None else self._drive.joints(Q)
        for k, (q, bounds) in enumerate(self._with_bounds(Q)):
            found[k], last = self._least(q, bounds, last, measure)
            which[k] = last
        return found, which

    def _with_bounds(self, Q: Array) -> Iterator[tuple[Array, Array]]:
        """Go through the model's joints Q (K, N), each with its bounds (P,)."""
        size = min(_BLOCK, max(1, _MOST_BOUNDS // len(self._both)))
        for start in range(0, len(Q), size):
            block = Q[start : start + size]
            yield from zip(block, self._bounds(block), strict=True)

    def _least(self, q: Array, bounds: Array, guess: int, measure: Callable[[int], float]) -> tuple[float, int]:
        """Measure exactly only where the bound of two bodies is below the best pair known."""
        pin.updateGeometryPlacements(self._model, self._data, self._shapes, self._placed, q)
        best, at = measure(guess), guess
        near = np.flatnonzero(bounds < best)
        for k in near[np.argsort(bounds[near])].tolist():
            if bounds[k] >= best:
                break
            distance = measure(k)
            if distance < best:
                best, at = distance, k
        return best, at

    def _of_hulls(self, k: int) -> float:
        """Measure the hulls of a pair."""
        return float(pin.computeDistance(self._shapes, self._placed, k).min_distance)

    def _exact(self, k: int) -> float:
        """Measure a pair; 0 where their hulls overlap and they do not touch."""
        distance = self._of_hulls(k)
        if distance > 0:
            return distance
        (a, b), placed = self._both[k], self._placed.oMg
        one, other = self._bodies[a], self._bodies[b]
        wrapped = one.points is not None or other.points is not None
        return 0.0 if wrapped and not touch(one, placed[a], other, placed[b]) else min(distance, -_TOUCHING)

    # ---- making them ---------------------------------------------------------------------------

    def _add_surroundings(self) -> None:
        """Add the bodies of the robot's surroundings, measured from its root."""
        robot = self.task.robot
        around = robot.surroundings
        if around is None:
            return
        places = fixed_placements(around)
        for solid in around.collisions:
            name = f"surroundings/{solid.link}" if solid.link in robot.description.links else solid.link
            if not self._add(solid, around.path, 0, places[solid.link], name):
                raise InputError(
                    f"{around.path}: mesh {solid.filename!r} of {solid.link!r} was not found or cannot be read; "
                    "say where it is (--package-dir), or give the link a box"
                )

    def _add(self, solid: Solid, urdf: Path, joint: int, place: pin.SE3, link: str) -> bool:
        """Add a body of a link, carried by a joint; say whether there is one."""
        body = body_shape(solid, urdf, self.task.robot.package_dirs)
        if body is None:
            return False
        body.hull.computeLocalAABB()
        self._links.append(link)
        self._bodies.append(body)
        self._shapes.addGeometryObject(pin.GeometryObject(solid.name, joint, place * origin(solid), body.hull))
        return True

    def _moving_pairs(self, own: int) -> list[tuple[int, int]]:
        """Pairs of bodies that a joint moves against each other, but not the robot's that are next to each other."""
        parent, joint = list(self._model.parents), [body.parentJoint for body in self._shapes.geometryObjects]
        return [
            (a, b)
            for b in range(len(joint))
            for a in range(b)
            if joint[a] != joint[b] and (b >= own or (parent[joint[a]] != joint[b] and parent[joint[b]] != joint[a]))
        ]

    def _measure(self, pairs: list[tuple[int, int]]) -> None:
        """Choose the pairs whose distances are measured."""
        self._both = pairs
        self._shapes.removeAllCollisionPairs()
        for a, b in pairs:
            self._shapes.addCollisionPair(pin.CollisionPair(a, b))
        self._placed = pin.GeometryData(self._shapes)
        self._bounds = BodyBounds(self._model, self._shapes)

    def _touching_always(self) -> NDArray[np.bool_]:
        """Say which of the measured pairs touch at the reference and at random configurations: (P,)."""
        always, task = np.ones(len(self._both), bool), self.task
        (lower, upper, _), q0 = task.joint_limits, task.joints(task.reference)  # limits are the joints', whatever ψ
        low, high = np.maximum(lower, q0 - _FREE), np.minimum(upper, q0 + _FREE)
        Q = np.vstack([q0, np.random.default_rng(0).uniform(low, high, (_SAMPLES, task.n))])
        Q = Q if task.coordinates is None else task.coordinates.coordinates(Q)
        Q = Q if self._drive is None else self._drive.joints(Q)
        for q, bounds in self._with_bounds(Q) if self._both else ():
            always &= bounds < 0
            pin.updateGeometryPlacements(self._model, self._data, self._shapes, self._placed, q)
            for k in np.flatnonzero(always).tolist():
                always[k] = self._of_hulls(k) <= 0
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
