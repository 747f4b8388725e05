"""How near a robot's own bodies come to each other, and to its surroundings."""

from __future__ import annotations

from dataclasses import dataclass
from threading import Lock
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arguments import Array, as_configurations, require_type, vector
from ..urdf.validate import MAX_SHAPES
from .collision_model import Pair, collision_model
from .task import Task

_NAMED = 3
"""Pairs of links that a note names, at most."""

_MADE: WeakKeyDictionary[Task, Bodies] = WeakKeyDictionary()
_MADE_LOCK = Lock()


@dataclass(frozen=True)
class Nearest:
    """The two bodies that are nearest to each other.

    Attributes
    ----------
    distance : float
        m; below 0 they touch, at 0 only their hulls do. inf if there is no distance to measure.
    links : (str, str)
        Whose they are.
    """

    distance: float
    links: Pair


class Bodies:
    """The collision bodies of a robot and of its surroundings, and the pairs that a task's joints
    move.

    A mesh of the robot is replaced by its convex hull, so no distance is larger than that of the
    mesh; if hulls overlap but the bodies do not touch, it is 0. A body inside a mesh touches it. A
    mesh of the surroundings (``rp.Robot.load(…, surroundings=)``) counts as it is, so an arm may
    move inside a room; where it is closed, it is solid on the inner side of its faces.

    Only contact counts, and no distance, between the robot's own bodies that its SRDF rules out,
    that only one joint moves against each other, or whose hulls overlap at every configuration
    tried. Left out are links that a joint connects; of the pairs of the first two kinds, those that
    touch at the reference pose or at a quarter of the configurations tried; and pairs that touch at
    every one.

    Bodies of the same files and joints are made once. Threads may share them.

    Parameters
    ----------
    task
        The task whose joints move; the other joints stay at the reference pose.

    Attributes
    ----------
    pairs : tuple of (str, str)
        Links between which distances are measured.
    only_contact : tuple of (str, str)
        Links between which only contact counts.
    adjacent : tuple of (str, str)
        Pairs left out because a joint connects them, or because only one joint moves them against
        each other and they touch at the reference pose, or often.
    disabled : tuple of (str, str)
        Pairs left out because the SRDF rules them out and they touch at the reference pose, or
        often.
    touching : tuple of (str, str)
        Pairs left out because they touch at every configuration tried.
    missing : tuple of str
        Meshes of the robot, as the URDF writes them, and other shapes that cannot be measured: a
        mesh that was not found, a shape without a size. Those links have no body.
    standing : frozenset of str
        Links of the surroundings; if the robot has a link of the same name, it is called
        ``surroundings/name``.

    Raises
    ------
    InputError
        If what is given is not a task, a shape of the surroundings cannot be measured, or there are
        too many pairs.

    Examples
    --------
    >>> bodies = rp.Bodies(panda)
    >>> len(bodies.pairs) > 10
    True
    >>> bodies.nearest(panda.reference).distance > 0.05  # m
    True
    """

    def __init__(self, task: Task) -> None:
        self.task = require_type(
            task, Task, "task", "a task, such as rp.Robot.load('panda').task()"
        )
        _, self._drive = task.bodies_model()
        model = self._model = collision_model(task)
        self.pairs, self.only_contact = model.measured, model.only_contact
        self.adjacent, self.disabled, self.touching = model.adjacent, model.disabled, model.touching
        self.standing = model.standing
        self.missing = tuple(model.unusable)

    def __reduce__(self) -> tuple[type[Bodies], tuple[Task]]:
        """Pickle the task: its bodies are made again."""
        return type(self), (self.task,)

    def __repr__(self) -> str:
        measured = f"{len(self.pairs)} pairs measured, {len(self.only_contact)} for contact only"
        left_out = f"{len(self.adjacent)} adjacent, {len(self.disabled)} disabled by the SRDF"
        return f"<Bodies of {self.task.robot.name}: {measured}; left out: {left_out}, {len(self.touching)} touching>"

    @property
    def notes(self) -> list[str]:
        """What a user should know: which bodies are missing, and which pairs are not looked at."""
        notes = []
        if unusable := self._model.unusable:
            link, why = next(iter(unusable.values()))
            more = f" (and {len(unusable) - 1} more like it)" if len(unusable) > 1 else ""
            notes.append(f"collisions of {link} are not detected: {why}{more}")
        elif not self.task.robot.description.collisions:
            notes.append(
                "the URDF has no collision geometry, so collisions of the robot are not detected"
            )
        around = self.task.robot.surroundings
        if around is not None and len(around.collisions) > MAX_SHAPES:
            count = len(around.collisions)
            notes.append(
                f"{count} shapes of the surroundings: all are measured, the first {MAX_SHAPES} are drawn"
            )
        overlap = [pair for pair in self.touching if self.standing & {*pair}]
        if overlap:
            notes.append(
                f"{_listed(overlap)} overlap at every sampled configuration; they are not checked"
            )
        inside = [pair for pair in self.touching if not self.standing & {*pair}]
        if inside:
            notes.append(
                f"{_listed(inside)} overlap at every sampled configuration; they are not checked"
            )
        if self.disabled:
            which = _listed([*self.disabled])
            notes.append(
                f"{which} overlap in ordinary poses, and the SRDF rules them out; they are not checked"
            )
        return notes

    def nearest(self, q: ArrayLike) -> Nearest:
        """Find the two bodies nearest to each other at q (n,)."""
        distances, which = self._all(vector(q, self.task.n, "q")[None])
        links = ("", "") if which[0] < 0 else self._model.names(int(which[0]))
        return Nearest(float(distances[0]), links)

    def distances(self, Q: ArrayLike) -> Array:
        """Measure the smallest distance between bodies at every row of Q (K, n): (K,), m; below 0
        they touch."""
        return self._all(Q)[0]

    def hull_distances(self, Q: ArrayLike) -> Array:
        """Measure the smallest distance between convex hulls at every row of Q (K, n): (K,), m.

        Below 0 it is how deep the hulls overlap, whether or not the bodies touch: its slope says
        what moves them apart."""
        return self._all(Q, hulls=True)[0]

    def _all(self, Q: ArrayLike, *, hulls: bool = False) -> tuple[Array, NDArray[np.intp]]:
        """Least distance and its pair at every row of Q: (K,), (K,)."""
        Q = as_configurations(Q, self.task.n, repr(self.task))
        return self._model.least(Q if self._drive is None else self._drive.joints(Q), hulls=hulls)


def _listed(pairs: list[Pair]) -> str:
    """Name a few pairs of links."""
    few = ", ".join(" and ".join(pair) for pair in pairs[:_NAMED])
    return few if len(pairs) <= _NAMED else f"{few} and {len(pairs) - _NAMED} more pairs"


def bodies_of(task: Task) -> Bodies:
    """Make the bodies of a task, once."""
    with _MADE_LOCK:
        if task not in _MADE:
            _MADE[task] = Bodies(task)
        return _MADE[task]
