"""Collision model: the bodies of a chain, the pairs that can collide, and their distances.

A pair is two bodies between which a joint moves, given by its index 0 to P − 1. For distances, each
body of the robot is replaced by its convex hull, and each body of the surroundings keeps its exact
shape; *hulls* below are these two shapes of a pair. A measured pair has a distance. A
collision-only pair, such as neighbouring links, is tested for collisions without a distance,
because its bodies are always close. The model has N joints, mimic joints included. K is the number
of configurations, the rows of Q, and B that of a block of them. The reference pose is the usual
configuration of a robot. The sampled configurations are this pose and 100 random ones.

``BodyShape`` is a collision body: a convex shape, or a mesh and its convex hull.
``_CollisionModel`` is the bodies of a robot and its surroundings, and the pairs that a task moves.
``Description`` is the content of a validated URDF as plain data.
"""

from __future__ import annotations

import warnings
from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterator, Sequence
from pathlib import Path
from threading import Lock, RLock
from typing import Any

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ..base.arguments import Array
from ..base.errors import InputError
from .body_bounds import APART, BodyBounds, KnownApart, strokes
from .body_shapes import BodyShape, UnusableShape, body_shape, collide, contains, transform
from .catalogue import disabled_pairs
from .model import fixed_placements, link_frames, origin
from .packages import find_mesh
from .task import Task
from .urdf import Description

Pair = tuple[str, str]
_Mask = NDArray[np.bool_]

_SAMPLES = 100
"""Number of random configurations at which pairs are tested for collisions."""

_FREE = np.pi
"""Maximum distance of the random configurations from the reference pose, rad or m per joint."""

_FUSED = 0.25
"""Share of sampled configurations in collision from which neighbouring bodies are not checked."""

_TOUCHING = 1e-12
"""Minimum penetration reported for colliding bodies, m, so that the distance is below 0."""

_TOLERANCE = 1e-7
"""Tolerance of coal's distances: a distance d, m, is at most 1e-7 (1 + d) m above the true one.

With coal's default, 1e-6, distances would exceed the error that ``APART`` allows.
"""

_NEAR = 0.01
"""Distance of surfaces beyond which their exact distance is not computed, m."""

_BLOCK = 64
"""Number of configurations per batch of bounds; the batch fits in the processor's cache."""

_MOST_BOUNDS = 1_000_000
"""Maximum number of bounds per batch, for robots with very many pairs."""

_MOST_PAIRS = 1_000_000
"""Maximum number of pairs of bodies."""

_KEPT = 8
"""Maximum number of cached collision models."""

_MODELS: OrderedDict[Hashable, _CollisionModel] = OrderedDict()
_MODELS_LOCK = RLock()


class _CollisionModel:
    """Bodies of a robot and its surroundings, and the pairs whose relative position a task changes.

    Tasks with the same joints share one model, and several threads can use it. Methods of one pair
    k, which have no argument q, use the placements that :meth:`_move` has set last.

    Parameters
    ----------
    task
        A task whose joints move; the other joints stay at the reference pose.

    Attributes
    ----------
    links : list of str
        Link of every body.
    standing : frozenset of str
        Links of the surroundings.
    unusable : dict of (str, str)
        For each unusable mesh or shape of the robot, by name: its link, and the cause.
    pairs : (P, 2) array
        Indices of the two bodies of each checked pair, measured or for collisions only; pairs of
        the robot's own bodies first.
    measured, only_contact : tuples of (str, str)
        Pairs of links whose distance is measured, and pairs checked for collisions only.
    adjacent, disabled, touching : tuples of (str, str)
        Pairs of links that are not checked. The first tuple has those that a joint connects, the
        second those that the SRDF disables, and the third those that collide at every sampled
        configuration. :class:`Bodies` has the details, and calls ``measured`` ``pairs``.
    """

    def __init__(self, task: Task) -> None:
        self._model, _ = task.bodies_model()
        self._data = self._model.createData()
        self._lock = Lock()
        self._joints = task.robot.joints
        self.links: list[str] = []
        self._bodies: list[BodyShape] = []
        self._joint: list[int] = []
        self._place: list[pin.SE3] = []
        self._shape_names: list[str] = []
        self.unusable = self._add_robot(task)
        self._own = len(self.links)
        self._add_surroundings(task)
        self.standing = frozenset(self.links[self._own :])
        self._shapes = pin.GeometryModel()
        for k in range(self._own):
            body = pin.GeometryObject(f"{k}", self._joint[k], self._place[k], self._bodies[k].hull)
            self._shapes.addGeometryObject(body)
        self._request = coal.DistanceRequest()
        _prepare([self._request])
        self._result = coal.DistanceResult()
        self._asked = 0.0
        self._transforms: dict[int, coal.Transform3s] = {}
        self._standing_transforms = [transform(place) for place in self._place[self._own :]]
        self._choose_pairs(task)

    def least(self, Q: Array, *, hulls: bool = False) -> tuple[Array, NDArray[np.intp]]:
        """Compute the minimum body distance and the index of its pair at every row of Q (K, N).

        Return distances (K,), m, and indices (K,) into ``pairs``; inf and −1 without a measured
        pair and without a collision.

        Parameters
        ----------
        Q
            Configurations of the model's N joints.
        hulls
            True to return the signed distance of the convex hulls: minus their penetration depth
            where they overlap. If False, the distance is 0 where hulls overlap but the bodies do
            not collide.
        """
        found = np.full(len(Q), np.inf)
        which = np.full(len(Q), -1)
        measure = self._of_hulls if hulls else self._exact
        if not len(self.pairs):
            return found, which
        for k, (q, bounds) in enumerate(self._with_bounds(Q)):
            with self._lock:
                found[k], which[k] = self._least(q, bounds, measure)
        return found, which

    def nearer(self, Q: Array, distance: float, among: _Mask | None = None) -> NDArray[np.bool_]:
        """Test at every row of Q (K, N) whether any two bodies are nearer than a distance, m: (K,).

        A collision-only pair counts only if it collides. This takes a fraction of the time of the
        minimum distances, because the first pair that is nearer ends the test. ``among`` (P,) is a
        mask of the pairs to test; by default, all are tested.
        """
        found = np.zeros(len(Q), bool)
        for start, block, bounds in self._bounded(Q) if len(self.pairs) else ():
            bounds = self._telling(bounds)
            below = bounds < distance if among is None else (bounds < distance) & among
            nearest_first = np.argsort(np.where(below, bounds, np.inf), axis=1)
            counts = below.sum(axis=1)
            with self._lock:
                self._ask(distance)
                for k in np.flatnonzero(counts).tolist():
                    self._move(block[k])
                    for i in nearest_first[k, : counts[k]].tolist():
                        if self._is_nearer(i, distance):
                            found[start + k] = True
                            break
        return found

    def bounds(self, Q: Array) -> Array:
        """Compute a lower bound on the minimum distance at every row of Q (K, N): (K,), m."""
        blocks = (
            self._telling(block).min(axis=1, initial=np.inf) for *_, block in self._bounded(Q)
        )
        return np.concatenate([np.zeros(0), *blocks])

    def lowest(self, Q: Array) -> Array:
        """Compute lower bounds on the distances of all pairs at Q (K, N): (K, P), m.

        The bound of a collision-only pair is inf.
        """
        bounds = [block for _, _, block in self._bounded(Q)]
        found = np.concatenate(bounds) if bounds else np.zeros((0, len(self.pairs)))
        return np.where(self._only_contact, np.inf, found)

    def reach(self, strokes: Array | None = None) -> Array:
        """Bound how fast each joint changes the distance of each pair: (P, N), m per rad or m.

        The bound holds while prismatic joints are within ±``strokes`` (N,), m; by default, within
        their limits.
        """
        return self._bounds.reach(self._joints, self._strokes if strokes is None else strokes)

    @property
    def tables(self) -> Any:
        """Struct :data:`BODY_TABLES` with the joints, bodies and pairs, for the native library."""
        return self._bounds.tables

    def kept(self, distance: float) -> Array:
        """Return the distance that each pair must keep: (P,), m.

        It is ``distance`` for a measured pair, and 0 for a collision-only pair, whose bodies are
        always close.
        """
        return np.where(self._only_contact, 0.0, distance)

    def some_distances(
        self, q: Array, pairs: NDArray[np.intp], *, exact: bool = False, outside: bool = False
    ) -> Array:
        """Compute lower bounds on the distances of K pairs at one configuration q (N,): (K,), m.

        A pair whose bound is above 0 does not collide. The bound is the signed distance of the
        hulls, negative if these overlap. For a collision-only pair whose hulls overlap, the bound
        is the distance of the exact shapes instead, negative in a collision.

        Parameters
        ----------
        q
            Configuration, a value per joint of the model.
        pairs
            Indices of K pairs.
        exact
            True to use the distance of the exact shapes for measured pairs, too, if their hulls
            overlap.
        outside
            True to assume that a body that does not touch the surface of a mesh is outside the
            mesh, which makes the computation far faster. Only collision-only pairs whose hulls
            overlap, or are less than 1 cm apart, get other bounds: the larger of two values, the
            distance of the hulls, and that of the exact surfaces but at most 1 cm. Along a path on
            which all bounds are above 0, the assumption holds if it holds at the start of the path.
        """
        with self._lock:
            self._move(q)
            found = [self._apart(k) for k in pairs.tolist()]
            for i, k in enumerate(pairs.tolist()):
                if outside and self._only_contact[k] and found[i] < _NEAR:
                    found[i] = max(found[i], self._surfaces(k))
                elif found[i] <= 0 and (exact or self._only_contact[k]):
                    found[i] = self._exact_distance(k)
        return np.array(found)

    def pair_distances(self, Q: Array, pairs: NDArray[np.intp]) -> Array:
        """Compute a lower bound on the distance of one pair at each row of Q (K, N): (K,), m.

        ``pairs`` (K,) are the indices of these pairs, one per row. The bound is the signed distance
        of the hulls, negative if these overlap. For a collision-only pair whose hulls overlap, the
        bound is the distance of the exact shapes instead, negative in a collision.
        """
        found = np.empty(len(Q))
        with self._lock:
            for i, (q, k) in enumerate(zip(Q, pairs.tolist(), strict=True)):
                self._move(q)
                found[i] = self._apart(k)
                if found[i] <= 0 and self._only_contact[k]:
                    found[i] = self._exact_distance(k)
        return found

    def blocks(self, Q: Array) -> Iterator[tuple[int, Array, Array]]:
        """Yield (index of the first row, bounds, distances) for blocks of B rows of Q (K, N).

        ``bounds`` (B, P) are lower bounds on the distances of all pairs, m. ``distances`` (B,) are
        the minimum distances, m, over the measured pairs only: a collision of a collision-only pair
        does not count. Without a measured pair they are inf.
        """
        for start, block, bounds in self._bounded(Q):
            found = np.full(len(block), np.inf)
            tight = self._bounds.tighten(block, np.where(self._only_contact, np.inf, bounds))
            for k, q in enumerate(block if self.measured else ()):
                with self._lock:
                    found[k], _ = self._least(q, tight[k], self._exact)
            yield start, bounds, found

    def names(self, pair: int) -> Pair:
        """Return the names of the two links of a pair, given by its index."""
        a, b = self.pairs[pair].tolist()
        return self.links[a], self.links[b]

    def named(self, which: _Mask) -> tuple[Pair, ...]:
        """Return the names of the two links of each pair in a mask (P,), without duplicates."""
        return tuple(dict.fromkeys(map(self.names, np.flatnonzero(which).tolist())))

    # ---- distances -----------------------------------------------------------------------------

    def _with_bounds(self, Q: Array) -> Iterator[tuple[Array, Array]]:
        """Yield each row (N,) of Q with lower bounds (P,) on the distances of all pairs, m.

        The bounds are tight for the pairs that can be the nearest. A collision-only pair has the
        bound inf if its lower bound excludes a collision.
        """
        for _, block, bounds in self._bounded(Q):
            yield from zip(block, self._bounds.tighten(block, bounds), strict=True)

    def _bounded(self, Q: Array) -> Iterator[tuple[int, Array, Array]]:
        """Yield (index of the first row, rows (B, N), bounds (B, P)) for blocks of Q (K, N).

        Bounds are lower bounds on the distances of all pairs, m, also of collision-only ones.
        """
        size = min(_BLOCK, max(1, _MOST_BOUNDS // max(len(self.pairs), self._bounds.size, 1)))
        for start in range(0, len(Q), size):
            block = Q[start : start + size]
            yield start, block, self._bounds(block)

    def _telling(self, bounds: Array) -> Array:
        """Replace the bounds of collision-only pairs by inf where they exclude a collision.

        ``bounds`` (B, P) are lower bounds on the distances of all pairs at B configurations, m.
        They exclude a collision if they are 0 or more. Return the bounds (B, P), those of measured
        pairs unchanged.
        """
        if not self._some_only_contact:
            return bounds
        return np.where(self._only_contact & (bounds >= 0), np.inf, bounds)

    def _least(self, q: Array, bounds: Array, measure: Callable[[int], float]) -> tuple[float, int]:
        """Compute the minimum distance at q (N,), m, and the index of its pair.

        ``measure`` is a function: index of a pair → its distance. Pairs are measured in order of
        their lower ``bounds`` (P,), until no bound is below the minimum found. ``bounds`` is
        changed: it becomes inf for each pair that is measured. If all distances are inf, return inf
        and −1.
        """
        self._move(q)
        best, at = np.inf, -1
        while bounds[k := int(bounds.argmin())] < best:
            distance = measure(k)
            bounds[k] = np.inf
            if distance < best:
                best, at = distance, k
        return best, at

    def _move(self, q: Array) -> None:
        """Update the placements of the robot's bodies to the model's configuration q (N,)."""
        self._q = q.copy()
        pin.updateGeometryPlacements(self._model, self._data, self._shapes, self._placed, q)
        self._transforms.clear()

    def _exact(self, k: int) -> float:
        """Compute the distance of pair k at the current placements, m; below 0 in a collision.

        The result is 0 if only the hulls overlap. It is inf for a collision-only pair that does not
        collide.
        """
        distance = self._apart(k)
        if distance <= 0:
            distance = min(distance, -_TOUCHING) if self._collide(k) else 0.0
        return np.inf if distance >= 0 and self._only_contact[k] else distance

    def _is_nearer(self, k: int, distance: float) -> bool:
        """Test whether pair k, at the current placements, is nearer than ``distance``, m.

        A collision-only pair is nearer only if it collides. Call :meth:`_ask` with the same
        distance first. The test of two hulls ends as soon as they are known to be farther apart,
        and takes half as long as computing their distance.
        """
        if distance > 0 and not self._only_contact[k]:
            if k < self._own_pairs:
                return bool(pin.computeCollision(self._shapes, self._placed, k))
            return self._apart(k) < distance
        return self._exact(k) < distance

    def _ask(self, distance: float) -> None:
        """Set the distance, m, below which :meth:`_is_nearer` finds two hulls too near."""
        if distance != self._asked:
            self._asked = float(distance)
            for request in self._placed.collisionRequests:
                request.security_margin = distance

    def _of_hulls(self, k: int) -> float:
        """Compute the signed distance, m, of the hulls of pair k, if it is a measured pair.

        For a collision-only pair, the result is that of :meth:`_exact`: negative in a collision,
        else inf. The bodies are at the current placements.
        """
        return self._exact(k) if self._only_contact[k] else self._apart(k)

    def _apart(self, k: int) -> float:
        """Compute the signed distance of pair k at the current placements, m.

        The robot's bodies are represented by their hulls, the surroundings by their exact shapes.
        A negative distance is minus the penetration depth or, for a body inside another one, minus
        the distance of their surfaces.
        """
        if k < self._own_pairs:
            return float(pin.computeDistance(self._shapes, self._placed, k).min_distance)
        a, b = self._both[k]
        here = self._transform(a)
        there = self._transform(b)
        other = self._bodies[b]
        self._result.clear()
        hull = self._bodies[a].hull
        distance = float(
            coal.distance(hull, here, other.measured, there, self._request, self._result)
        )
        return (
            -distance
            if distance > 0 and contains(other, there, self._bodies[a], here)
            else distance
        )

    def _collide(self, k: int) -> bool:
        """Test whether the two bodies of pair k, whose hulls overlap, collide.

        Two convex bodies whose hulls overlap collide. For meshes, the exact shapes are tested,
        unless a surface distance that was measured nearby excludes a collision.
        """
        a, b = self._both[k]
        one, other = self._bodies[a], self._bodies[b]
        if one.convex and other.convex:
            return True
        if self._known.knows(k, self._q):
            return False
        hit = collide(one, self._transform(a), other, self._transform(b))
        if self._known.pays(k, self._q) and not hit:
            self._known.note(k, self._q, self._between_surfaces(k))
        return hit

    def _exact_distance(self, k: int) -> float:
        """Compute the distance, m, of the exact shapes of pair k at the current placements.

        Call it only if the hulls of the pair overlap. In a collision, the result is −1e-12 m, not a
        penetration depth.
        """
        a, b = self._both[k]
        one, other = self._bodies[a], self._bodies[b]
        distance = self._between_surfaces(k)
        if distance <= APART or (one.convex and other.convex):
            return -_TOUCHING if self._collide(k) else distance
        # surfaces that are apart leave only the question whether one body contains the other
        if not self._known.knows(k, self._q):
            here, there = self._transform(a), self._transform(b)
            if contains(one, here, other, there) or contains(other, there, one, here):
                return -_TOUCHING
        self._known.note(k, self._q, distance)
        return distance

    def _between_surfaces(self, k: int) -> float:
        """Compute the distance of the surfaces of pair k at the current placements, m.

        It is 0 or less where they intersect, but positive if one body contains the other.
        """
        (a, b), result = self._both[k], coal.DistanceResult()
        one, other = self._bodies[a].exact, self._bodies[b].exact
        here, there = self._transform(a), self._transform(b)
        return float(coal.distance(one, here, other, there, self._request, result))

    def _surfaces(self, k: int) -> float:
        """Compute a lower bound, m, on the distance of the surfaces of pair k.

        The surfaces are at the current placements. The bound is their distance or, if they are more
        than 1 cm apart, 1 cm: a test for 1 cm is far faster than the distance. For two convex
        bodies, the result is −inf, which is no bound; use the distance of their hulls, which is
        exact.
        """
        (a, b), request = self._both[k], coal.CollisionRequest()
        one, other = self._bodies[a].exact, self._bodies[b].exact
        here, there = self._transform(a), self._transform(b)
        request.enable_contact = False
        if self._bodies[a].convex and self._bodies[b].convex:
            return -np.inf  # the hulls' distance is exact
        request.security_margin = _NEAR
        if not coal.collide(one, here, other, there, request, coal.CollisionResult()):
            return _NEAR
        return self._between_surfaces(k)

    def _transform(self, k: int) -> coal.Transform3s:
        """Return the current placement of body k as coal's Transform3s.

        Placements of the surroundings are constant; those of the robot are cached until it moves.
        """
        if k >= self._own:
            return self._standing_transforms[k - self._own]
        if k not in self._transforms:
            self._transforms[k] = transform(self._placed.oMg[k])
        return self._transforms[k]

    # ---- bodies --------------------------------------------------------------------------------

    def _add_robot(self, task: Task) -> dict[str, Pair]:
        """Add the robot's bodies; return a dict of its unusable shapes, which are left out.

        The key is the name of the mesh file, as in the URDF; for a box, sphere, cylinder or
        capsule, it is the name of the shape. The value is a pair of texts: (name of the link,
        cause).
        """
        description = task.robot.description
        links = link_frames(self._model)
        unusable = {}
        for solid in description.collisions:
            link = links[solid.link]
            try:
                body = body_shape(solid, description.path, task.robot.package_dirs)
            except UnusableShape as error:
                unusable[solid.filename or solid.name] = solid.link, str(error)
                continue
            self._add(
                body, link.parentJoint, link.placement * origin(solid), solid.link, solid.name
            )
        return unusable

    def _add_surroundings(self, task: Task) -> None:
        """Add the bodies of the surroundings, placed relative to the robot's root.

        A body gets the name of its link, with ``surroundings/`` before it if the robot has such a
        link. InputError is raised for an unusable shape: a missing obstacle would be dangerous.
        """
        around = task.robot.surroundings
        own = set(task.robot.description.links)
        if around is None:
            return
        places = fixed_placements(around)
        for solid in around.collisions:
            name = f"surroundings/{solid.link}" if solid.link in own else solid.link
            try:
                body = body_shape(solid, around.path, task.robot.package_dirs, standing=True)
            except UnusableShape as error:
                raise InputError(f"{around.path}: link {solid.link!r}: {error}") from error
            self._add(body, 0, places[solid.link] * origin(solid), name, solid.name)

    def _add(self, body: BodyShape, joint: int, place: pin.SE3, link: str, shape: str) -> None:
        self.links.append(link)
        self._bodies.append(body)
        self._joint.append(joint)
        self._place.append(place)
        self._shape_names.append(shape)

    # ---- pairs ---------------------------------------------------------------------------------

    def _choose_pairs(self, task: Task) -> None:
        """Choose the pairs to check, and set ``measured``, ``only_contact`` and the other lists.

        All shapes of two of the robot's own links are treated alike. A link of the surroundings
        often has shapes far apart, so its shapes are treated one by one.

        Two links that a joint of the URDF connects directly are not checked. Other pairs that the
        SRDF disables, or with one joint of the model between them, are checked for collisions only.
        Pairs of these two kinds are not checked at all if they collide at the reference pose, or at
        a quarter or more of the sampled configurations. See also :class:`Bodies`.
        """
        self._measure(self._moving_pairs(task.robot.description.path))
        joined = {frozenset((joint.parent, joint.child)) for joint in task.robot.description.joints}
        neighbours = self._are_in(joined)
        self.adjacent = self.named(neighbours)
        self._measure(self.pairs[~neighbours])

        entry = task.robot.entry
        ruled_out = self._are_in(
            disabled_pairs(entry.srdf) if entry is not None and entry.srdf is not None else set()
        )
        near = ruled_out | self._one_joint_between()
        at_reference, share, hulls_always = self._sampled_collisions(task, near)
        fused = near & (at_reference | (share >= _FUSED))
        always = share == 1
        self.disabled = self.named(ruled_out & fused)
        self.adjacent += self.named(near & ~ruled_out & fused)
        self.touching = self._named_apart(always & ~near)
        own = self.pairs[:, 1] < self._own
        only_contact = near | (hulls_always & own)
        left_out = fused | always
        self.measured = self.named(~only_contact & ~left_out)
        self.only_contact = self.named(only_contact & ~left_out)
        self._measure(self.pairs[~left_out], only_contact[~left_out])

    def _named_apart(self, always: _Mask) -> tuple[Pair, ...]:
        """Return the names of the links of the pairs that collide at all sampled configurations.

        ``always`` (P,) is a mask of these pairs. If only some shapes of a link of the surroundings
        always collide, the shape is named too.
        """
        partly = set(self.named(~always))
        found: dict[Pair, None] = {}
        for k in np.flatnonzero(always).tolist():
            one, other = self.names(k)
            if (one, other) in partly:
                other = f"{self._shape_names[self.pairs[k, 1]]} of {other}"
            found[one, other] = None
        return tuple(found)

    def _link_pairs(self) -> NDArray[np.intp]:
        """Number the pairs of links; return the number to which each pair of bodies belongs: (P,).

        A pair with a body of the surroundings has a number of its own.
        """
        numbers: dict[object, int] = {}
        keys = [
            frozenset(self.names(k)) if k < self._own_pairs else k for k in range(len(self.pairs))
        ]
        return np.array([numbers.setdefault(key, len(numbers)) for key in keys], np.intp)

    def _moving_pairs(self, path: object) -> NDArray[np.intp]:
        """Return the pairs (P, 2) of bodies with a moving joint between them.

        Pairs of the robot's own bodies come first. Pairs without a moving joint between them never
        change their distance. InputError is raised for over a million pairs; ``path`` is the URDF
        file, which its message names.
        """
        joint = np.array(self._joint, np.intp)
        own = self._own
        moving = np.flatnonzero(joint[:own])
        counts = np.bincount(joint[:own]) if own else np.zeros(1, int)
        count = (own**2 - (counts**2).sum()) // 2 + len(moving) * (len(joint) - own)
        if count > _MOST_PAIRS:
            raise InputError(
                f"{path}: {count} pairs of collision shapes, but the maximum is {_MOST_PAIRS}; "
                "merge the shapes of each link into one mesh"
            )
        a, b = np.triu_indices(own, 1)
        differ = joint[a] != joint[b]
        inner = np.stack([a[differ], b[differ]], axis=1)
        outer = np.stack(
            np.meshgrid(moving, np.arange(own, len(joint)), indexing="ij"), axis=-1
        ).reshape(-1, 2)
        return np.concatenate([inner, outer]).astype(np.intp)

    def _are_in(self, links: set[frozenset[str]]) -> _Mask:
        """Return a mask (P,) of the pairs of bodies whose two links are one of the sets ``links``.

        It is False for all pairs with the surroundings.
        """
        found = np.zeros(len(self.pairs), bool)
        if links:
            found[: self._own_pairs] = [
                frozenset(self.names(k)) in links for k in range(self._own_pairs)
            ]
        return found

    def _one_joint_between(self) -> _Mask:
        """Return a mask (P,) of the robot's own pairs with one joint of the model between them.

        Such bodies nearly touch by design, so their distance is no measure of danger.
        """
        parent = np.array([int(joint) for joint in self._model.parents])
        a, b = np.array(self._joint, np.intp)[self.pairs].T
        return ((parent[a] == b) | (parent[b] == a)) & (self.pairs[:, 1] < self._own)

    def _measure(self, pairs: NDArray[np.intp], only_contact: _Mask | None = None) -> None:
        """Set the pairs (P, 2) to check, and prepare their lower bounds.

        ``only_contact`` (P,) is a mask of the collision-only pairs; None means that there are none.
        Call this method again to leave out more pairs.
        """
        self.pairs, self._both = pairs, [(a, b) for a, b in pairs.tolist()]
        self._only_contact = np.zeros(len(pairs), bool) if only_contact is None else only_contact
        self._some_only_contact = bool(self._only_contact.any())
        self._own_pairs = int((pairs[:, 1] < self._own).sum())
        self._shapes.removeAllCollisionPairs()
        for a, b in self._both[: self._own_pairs]:
            self._shapes.addCollisionPair(pin.CollisionPair(a, b))
        self._placed = pin.GeometryData(self._shapes)
        self._asked = 0.0
        _prepare([*self._placed.distanceRequests, *self._placed.collisionRequests])
        measured = [body.measured for body in self._bodies]
        self._bounds = BodyBounds(
            self._model, self._joint, self._place, measured, pairs, self._only_contact
        )
        self._strokes = strokes(self._model, self._joints)
        self._known = KnownApart(self.reach(), self._strokes)

    def _sampled_collisions(self, task: Task, near: _Mask) -> tuple[_Mask, Array, _Mask]:
        """Test the pairs for collisions at the reference pose and at random configurations.

        Parameters
        ----------
        task
            Task whose reference pose is the first configuration.
        near
            Mask (P,) of the pairs to test at every configuration. Other pairs of links are tested
            only until a configuration is found at which their hulls do not overlap.

        Returns
        -------
        Three arrays (P,), each with one value per pair of links, repeated for all pairs of bodies
        on these links: whether the links collide at the reference pose, the share of configurations
        at which they were found to collide, and whether their hulls overlap at all configurations.
        For pairs that are not in ``near``, the share says only whether it is 1.
        """
        Q = _sample_configurations(task)
        link_pair = self._link_pairs()
        count = np.zeros(len(self.pairs))
        at_reference = np.zeros(len(self.pairs), bool)
        overlaps = ~at_reference
        for i, (q, bounds) in enumerate(self._with_bounds(Q) if len(self.pairs) else ()):
            self._move(q)
            overlap, hit = np.zeros((2, len(self.pairs)), bool)
            for k in np.flatnonzero((bounds < 0) & (near | overlaps)).tolist():
                number = link_pair[k]
                if not hit[number] and self._apart(k) <= 0:
                    overlap[number] = True
                    hit[number] = self._collide(k)
            count += hit[link_pair]
            overlaps &= overlap[link_pair]
            if i == 0:
                at_reference = count > 0
        return at_reference, count / len(Q), overlaps


def _prepare(requests: Sequence[Any]) -> None:
    """Set the tolerance of coal's requests, and make each test independent of earlier ones.

    By default, a test of Pinocchio begins where the last test of the same pair ended. This saves no
    time, and makes results depend on earlier ones.
    """
    with warnings.catch_warnings():
        # its successor, gjk_initial_guess, has no effect while this one is True
        warnings.simplefilter("ignore", DeprecationWarning)
        for request in requests:
            request.enable_cached_gjk_guess = False
            request.gjk_tolerance = _TOLERANCE


def _sample_configurations(task: Task) -> Array:
    """Return the reference pose, and 100 random configurations, of the model's joints: (101, N).

    The random ones are within the joint limits, and at most π rad (m) per joint from the reference
    pose. They are the same in each call.
    """
    q0 = task.reference
    low = np.maximum(task.lower, q0 - _FREE)
    high = np.minimum(task.upper, q0 + _FREE)
    Q = np.vstack([q0, np.random.default_rng(0).uniform(low, high, (_SAMPLES, task.n))])
    _, drive = task.bodies_model()
    return drive.joints(Q)


def collision_model(task: Task) -> _CollisionModel:
    """Return the collision model of a task, cached by robot, files and joints.

    Reading meshes and computing their hulls can take seconds. The last eight models are kept.
    """
    key = _key(task)
    with _MODELS_LOCK:
        if key not in _MODELS:
            _MODELS[key] = _CollisionModel(task)
            while len(_MODELS) > _KEPT:
                _MODELS.popitem(last=False)
        _MODELS.move_to_end(key)
        return _MODELS[key]


def _key(task: Task) -> Hashable:
    """Return the cache key of a task's collision model: all data on which the model depends.

    These are the URDFs, the mesh files with their times and sizes, and the joints.
    """
    robot = task.robot
    around, entry = robot.surroundings, robot.entry
    files = _mesh_files(robot.description, robot.package_dirs)
    files += [] if around is None else _mesh_files(around, robot.package_dirs)
    files += [] if entry is None else [entry.srdf]
    stamps = tuple(
        (path, path.stat().st_mtime_ns, path.stat().st_size) if path else None for path in files
    )
    model, _ = task.bodies_model()
    still = (robot.locked, robot.reference.tobytes(), tuple(model.names), task.joint_names)
    return robot.description, around, robot.package_dirs, stamps, still


def _mesh_files(description: Description, package_dirs: tuple[str, ...]) -> list[Path | None]:
    """List the collision mesh files of a URDF, each once; None for a missing file.

    ``package_dirs`` are folders in which packages are looked up.
    """
    names = dict.fromkeys(solid.filename for solid in description.collisions if solid.filename)
    return [find_mesh(name, description.path, package_dirs) for name in names]
