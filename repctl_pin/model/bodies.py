"""Minimum distances between a robot's collision bodies, and to its surroundings.

A pair is two bodies, one of them on a link of the robot. A measured pair has a distance; other
pairs are checked for collisions only, or not at all. The P pairs that are checked are numbered from
0. n is the number of joints of the task, N that of the collision model, mimic joints included. K is
the number of configurations, the rows of Q. The reference pose is the usual configuration of a
robot. The sampled configurations are this pose and 100 random ones within the joint limits.

``Nearest`` is the closest pair of bodies at a configuration, and its distance, m. ``Clearance`` is
the minimum body distance of a motion, and its first collision. ``_CollisionModel`` has the bodies
and the pairs that a task moves. ``_NoBodies`` replaces a collision model where there are no
collision bodies.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..base.arguments import Array, as_configurations, require_type, vector
from .clearance import Clearance, clearance
from .model import link_frames
from .robot import read_surroundings
from .task import Task
from .urdf import MAX_SHAPES

if TYPE_CHECKING:
    from .collision_model import Pair

_NAMED = 3
"""Maximum number of links, or of pairs of them, that a note names."""

_MADE_LOCK = Lock()


@dataclass(frozen=True)
class Nearest:
    """The closest pair of bodies at a configuration, and its distance.

    Attributes
    ----------
    distance : float
        Body distance, m: below 0 in a collision, 0 if only the convex hulls of the two bodies
        overlap, inf if the task has no pair to measure and no pair collides.
    links : (str, str)
        The links of the two bodies; two empty texts if the distance is inf.
    """

    distance: float
    links: Pair


class Bodies:
    """Collision bodies of a robot and its surroundings, and the pairs that a task moves.

    A mesh of the robot is replaced by its convex hull, so distances are never overestimated; where
    hulls overlap but the bodies do not collide, the distance is 0. A body inside a mesh collides
    with it. A mesh of the surroundings (``rp.Robot.load(…, surroundings=)``) is not replaced, so
    that an arm can move inside a room. A closed mesh is solid on the inner side of its faces.

    Two links that a joint of the URDF connects directly, as parent and child, are not checked.
    Three kinds of the robot's other pairs are checked for collisions only, without a distance: (1)
    pairs that the SRDF disables; (2) pairs of links between which the task moves only one joint;
    (3) pairs whose hulls overlap at every sampled configuration. Pairs of kinds 1 and 2 are not
    checked at all if they collide at the reference pose, or at a quarter or more of the sampled
    configurations. Any pair that collides at all sampled configurations is not checked either. The
    decision is made for each pair of links of the robot, with all of their shapes, and for each
    single shape of the surroundings.

    Objects made from the same files and joints share their geometry. Several threads can use one
    object.

    Parameters
    ----------
    task
        The task whose joints move; the other joints stay at the reference pose.
    surroundings
        URDF of the surroundings, instead of the robot's own; see :meth:`Robot.load`.

    Attributes
    ----------
    pairs : tuple of (str, str)
        Links between which distances are measured.
    only_contact : tuple of (str, str)
        Links that are checked for collisions only.
    adjacent : tuple of (str, str)
        Pairs not checked because a joint of the URDF connects the two links directly, or because
        only one joint that the task moves lies between them and they collide at the reference pose
        or at a quarter or more of the sampled configurations.
    disabled : tuple of (str, str)
        Pairs not checked because the SRDF disables them and they collide at the reference pose or
        at a quarter or more of the sampled configurations.
    touching : tuple of (str, str)
        Pairs not checked because they collide at every sampled configuration. If only some shapes
        of a link of the surroundings always collide, the second name is ``shape of link``.
    missing : tuple of str
        Unusable shapes of the robot: meshes that are missing or unreadable, named as in the URDF,
        and shapes without a size. These shapes have no body.
    unchecked : tuple of str
        Links of the robot that are drawn, or have an unusable shape, but have no body, so that
        their collisions are not detected. Links that no joint moves against each other are one
        group, of which one link is listed. If the URDF has no collision geometry, every group is
        listed.
    standing : frozenset of str
        Links of the surroundings, called ``surroundings/name`` if the robot has a link of the same
        name.

    Raises
    ------
    InputError
        If the argument is not a task, a shape of the surroundings is unusable, or there are too
        many pairs.

    Examples
    --------
    >>> bodies = rp.Bodies(panda)
    >>> len(bodies.pairs) > 10
    True
    >>> bodies.nearest(panda.reference).distance > 0.05  # m
    True
    """

    def __init__(self, task: Task, *, surroundings: str | Path | None = None) -> None:
        require_type(task, Task, "task", "a task, such as rp.Robot.load('panda').task()")
        if surroundings is not None:
            task = _beside(task, surroundings)
        self.task = task
        _, self._drive = task.bodies_model()
        model = self._model = _model_of(task)
        self.pairs = model.measured
        self.only_contact = model.only_contact
        self.adjacent = model.adjacent
        self.disabled = model.disabled
        self.touching = model.touching
        self.standing = model.standing
        self.missing = tuple(model.unusable)
        self.unchecked = _without_shape(task, set(model.links))

    def __reduce__(self) -> tuple[type[Bodies], tuple[Task]]:
        """Pickle the task only; the bodies are created again."""
        return type(self), (self.task,)

    def __repr__(self) -> str:
        checked = f"{len(self.pairs)} pairs measured, {len(self.only_contact)} for collisions only"
        not_checked = ", ".join(
            (
                f"{len(self.adjacent)} adjacent",
                f"{len(self.disabled)} disabled by the SRDF",
                f"{len(self.touching)} overlapping",
            )
        )
        return f"<Bodies of {self.task.robot.name}: {checked}; not checked: {not_checked}>"

    @property
    def notes(self) -> list[str]:
        """Sentences on links without a body, and on pairs that are not checked; a list of texts."""
        notes = []
        if unusable := self._model.unusable:
            link, why = next(iter(unusable.values()))
            more = f" (and {len(unusable) - 1} more like it)" if len(unusable) > 1 else ""
            notes.append(f"collisions of {link} are not detected: {why}{more}")
        elif not self.task.robot.description.collisions:
            notes.append(
                "the model has no collision geometry, so collisions of the robot are not detected"
            )
        around = self.task.robot.surroundings
        if around is not None and len(around.collisions) > MAX_SHAPES:
            count = len(around.collisions)
            notes.append(
                f"the surroundings have {count} shapes: "
                f"all are measured, the first {MAX_SHAPES} are drawn"
            )
        own = set(self.task.robot.description.links)
        outer = [pair for pair in self.touching if not own.issuperset(pair)]
        inner = [pair for pair in self.touching if own.issuperset(pair)]
        notes += [
            f"{_listed(pairs)} overlap at every sampled configuration; they are not checked"
            for pairs in (outer, inner)
            if pairs
        ]
        if self.disabled:
            count = len(self.disabled)
            pairs = "1 pair of links overlaps and is" if count == 1 else ""
            pairs = pairs or f"{count} pairs of links overlap and are"
            notes.append(f"{pairs} not checked: the SRDF disables {'it' if count == 1 else 'them'}")
        return notes

    def nearest(self, q: ArrayLike) -> Nearest:
        """Find the closest pair of bodies at q (n,).

        Without a pair to measure, and without a collision, the distance is inf. A warning says so
        if no pair is checked at all.
        """
        self._warn_if_empty()
        distances, which = self._all(vector(q, self.task.n, "q")[None])
        links = ("", "") if which[0] < 0 else self._model.names(int(which[0]))
        return Nearest(float(distances[0]), links)

    def distances(self, Q: ArrayLike) -> Array:
        """Compute the minimum body distance at every row of Q (K, n): (K,), m.

        A negative distance is a collision. Without a pair to measure, the distances are inf except
        in a collision. A warning says so if no pair is checked at all.
        """
        self._warn_if_empty()
        return self._all(Q)[0]

    def _warn_if_empty(self) -> None:
        """Warn the user if there is no pair to check, so that every distance is inf.

        Objects for internal use do not warn: results that use them state what is not checked.
        """
        if self.pairs or self.only_contact or self is self.task.shared_bodies:
            return
        count = len(self.unchecked)
        cause = f": no shape of {named_links(self.unchecked)}" if count else ""
        warnings.warn(
            f"no pair of bodies is checked, so the distance is inf{cause}",
            UserWarning,
            stacklevel=3,
        )

    def _along(self, Q: Array, rows: NDArray[np.intp]) -> Clearance:
        """Find the minimum body distance and the first collision of a motion, see :mod:`clearance`.

        Parameters
        ----------
        Q
            Samples (K, n) of the motion; between two samples, the joints move on a straight line.
        rows
            Indices of R samples, 0 and K − 1 included, at which distances are measured first, see
            :func:`clearance`.
        """
        if not (self.pairs or self.only_contact):
            free = np.full(len(rows), np.inf)
            return Clearance(np.inf, 0.0, ("", ""), None, 0.0, free, 0, between=True)
        return clearance(self._model, self._drive.joints(Q), rows)

    @property
    def not_checked(self) -> str:
        """Text on the number of links without a body, and the remedy; empty without such links."""
        count = len(self.unchecked)
        if not count:
            return ""
        lost = any("/" in name for name in self.missing)
        remedy = "; meshes missing: --package-dir DIR" if lost else ""
        return f"{count} {'body' if count == 1 else 'bodies'} without a collision shape{remedy}"

    def hull_distances(self, Q: ArrayLike) -> Array:
        """Compute the minimum distance of the convex hulls of pairs at rows of Q (K, n): (K,), m.

        The minimum is over the measured pairs, and over the other checked pairs that collide. For a
        body of the surroundings, its exact shape takes the place of its hull. A negative distance
        is minus the penetration depth of the hulls, whether or not the bodies collide. The gradient
        of this distance shows which motion separates the hulls.
        """
        return self._all(Q, hulls=True)[0]

    def _nearer(
        self, Q: ArrayLike, distance: float, among: NDArray[np.bool_] | None = None
    ) -> NDArray[np.bool_]:
        """Test at every row of Q (K, n) whether a body distance is below ``distance``, m: (K,).

        ``among`` (P,) is a mask of the pairs to test; by default, all pairs are tested.
        """
        Q = as_configurations(Q, self.task.n, repr(self.task))
        return np.asarray(self._model.nearer(self._drive.joints(Q), distance, among))

    def _hull_bounds(self, Q: Array) -> Array:
        """Compute a lower bound on :meth:`hull_distances` at every row of Q (K, n): (K,), m."""
        return np.asarray(self._model.bounds(self._drive.joints(Q)))

    def _pair_bounds(self, Q: Array) -> Array:
        """Compute lower bounds on the distances of all P pairs at Q (K, n): (K, P), m.

        The bound of a pair that is checked for collisions only is inf.
        """
        return np.asarray(self._model.lowest(self._drive.joints(Q)))

    def _of_pairs(self, Q: Array, pairs: NDArray[np.intp]) -> Array:
        """Compute a lower bound on the distance of one pair at each row of Q (K, n): (K,), m.

        ``pairs`` (K,) are the indices of these pairs, one per row. The bound is the signed distance
        of the hulls. If they overlap, and the pair is checked for collisions but not measured, the
        bound is the distance of the exact shapes instead.
        """
        return np.asarray(self._model.pair_distances(self._drive.joints(Q), pairs))

    def _moved_by(self, joint: int) -> NDArray[np.bool_]:
        """Return a mask (P,) of the pairs whose two bodies a joint moves relative to each other.

        ``joint`` is the index of the joint in q.
        """
        if isinstance(self._model, _NoBodies):
            return np.zeros(0, bool)
        turning = self._drive.S[:, joint] != 0
        return np.asarray((self._model.reach()[:, turning] > 0).any(axis=1))

    def _all(self, Q: ArrayLike, *, hulls: bool = False) -> tuple[Array, NDArray[np.intp]]:
        """Compute the minimum body distance and the index of its pair at every row of Q (K, n).

        Return distances (K,), m, and indices (K,); inf and −1 without a pair to measure. A distance
        is negative in a collision, and 0 where only the hulls overlap. With ``hulls``, distances
        are those of the convex hulls, negative where these overlap.
        """
        Q = as_configurations(Q, self.task.n, repr(self.task))
        return self._model.least(self._drive.joints(Q), hulls=hulls)


def _beside(task: Task, surroundings: str | Path) -> Task:
    """Return a copy of a task with other surroundings; the task itself is not changed.

    ``surroundings`` is a URDF file of fixed shapes, such as a table.
    """
    moved, robot = copy(task), copy(task.robot)
    around, folders = read_surroundings(surroundings, robot.package_dirs)
    robot.surroundings = around
    robot.package_dirs = (*robot.package_dirs, *map(str, folders))
    moved.robot = robot
    return moved


@dataclass(frozen=True)
class _NoBodies:
    """Collision model of a robot without collision geometry and surroundings: it has no pairs.

    It replaces :class:`_CollisionModel`, which needs coal, a library that takes long to import. The
    attributes and methods are those of that class.
    """

    links: tuple[str, ...] = ()
    standing: frozenset[str] = frozenset()
    unusable: Mapping[str, Pair] = field(default_factory=dict)
    measured: tuple[Pair, ...] = ()
    only_contact: tuple[Pair, ...] = ()
    adjacent: tuple[Pair, ...] = ()
    disabled: tuple[Pair, ...] = ()
    touching: tuple[Pair, ...] = ()

    def least(self, Q: Array, *, hulls: bool = False) -> tuple[Array, NDArray[np.intp]]:
        """Return the distance inf and the pair −1 for every row of Q (K, N)."""
        return np.full(len(Q), np.inf), np.full(len(Q), -1)

    def bounds(self, Q: Array) -> Array:
        """Return the lower bound inf of the body distance for every row of Q (K, N)."""
        return np.full(len(Q), np.inf)

    def lowest(self, Q: Array) -> Array:
        """Return lower bounds on the distances of all pairs, of which there are none: (K, 0).

        Q (K, N) are configurations.
        """
        return np.zeros((len(Q), 0))

    def pair_distances(self, Q: Array, pairs: NDArray[np.intp]) -> Array:
        """Return an empty array (0,): without pairs, Q (0, N) and ``pairs`` are empty too."""
        return np.zeros(0)

    def nearer(self, Q: Array, distance: float, among: Any = None) -> NDArray[np.bool_]:
        """Return False for every row of Q (K, N): no body is near another."""
        return np.zeros(len(Q), bool)


def _model_of(task: Task) -> Any:
    """Return the collision model of a task; without collision shapes, one without pairs.

    The library coal, which a model with pairs needs, is imported only if the robot or its
    surroundings have collision shapes.
    """
    robot = task.robot
    if not robot.description.collisions and robot.surroundings is None:
        return _NoBodies()
    from .collision_model import collision_model

    return collision_model(task)


def _without_shape(task: Task, with_body: set[str]) -> tuple[str, ...]:
    """List :attr:`Bodies.unchecked`: the links that have a shape in the URDF, but no body.

    ``with_body`` are the links that have a body. Links that no joint separates are one group: only
    its first link is listed, and none if a link of the group has a body. If the URDF has no
    collision shapes, links without any shape are listed too.
    """
    description = task.robot.description
    frames = link_frames(task.robot.model)
    joint = {link: frames[link].parentJoint for link in description.links}
    found = {joint[link] for link in with_body if link in joint}
    meant = [solid.link for solid in (*description.collisions, *description.shapes)]
    first: dict[int, str] = {}
    for link in meant if description.collisions else description.links:
        if joint[link] not in found:
            first.setdefault(joint[link], link)
    return tuple(first.values())


def named_links(links: Sequence[str]) -> str:
    """Format names of links as text for a message: the first three, and how many more."""
    few, more = ", ".join(links[:_NAMED]), len(links) - _NAMED
    return few if more <= 0 else f"{few} and {more} more link{'s' * (more > 1)}"


def _listed(pairs: list[Pair]) -> str:
    """Format pairs of links as text for a note: the first three, and the number of the others.

    The text reads ``a and b, c and d, e and f and 4 more pairs``.
    """
    few = ", ".join(" and ".join(pair) for pair in pairs[:_NAMED])
    more = len(pairs) - _NAMED
    return few if more <= 0 else f"{few} and {more} more pair{'s' * (more > 1)}"


def bodies_of(task: Task) -> Bodies:
    """Return the cached :class:`Bodies` of a task; the first call creates them.

    Creating the bodies takes long, so all motions of a task share them.
    """
    with _MADE_LOCK:
        if task.shared_bodies is None:
            task.shared_bodies = Bodies(task)
        return task.shared_bodies
