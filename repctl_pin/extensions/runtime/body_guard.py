r"""Guard of body distances along the plans of a governor, also between samples.

Let d be the distance between two bodies, and ρ_j, m per rad, a bound on how far joint j moves their
points relative to each other. From q to q', d changes by at most ρ·|q − q'|. So a distance measured
at one configuration bounds d at others, and between two samples of a plan

.. math:: d \ge \tfrac{1}{2} (d_k + d_{k+1} - \rho \cdot s),

with s the distances that the joints move between the two samples. If d changes by at most w on a
part of a plan, the part is safe if d, in its middle, is at least w plus the distance to keep;
otherwise the part is halved. At a sample, d is bounded by spheres, boxes, and remembered distances.
Distances are measured only for pairs and samples that these bounds do not decide. The C code is
body_guard.c.

A plan is the motion of the next ticks, which ends at rest. A pair is a pair of bodies, numbered
from 0. Letters: K samples of n joints. The work of a tick is at most 30 measured distances, or
other computations that take as long. It is counted, not timed, so that equal ticks give equal
motions.
"""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np

from ...base.arguments import Array, require_type
from ...base.errors import InputError
from ...model.bodies import Bodies, named_links
from ...model.body_bounds import TELLING
from ...model.task import Task
from ...native import BODY_GUARD, filled_struct, required_library

ROOM = 32
"""Maximum number of samples of a plan at which distances are bounded."""

_STOP = 1e-3
"""Distance beyond the kept one at which the samples of a plan stay, m. The bounds between samples
use it up, so that an arm that was stopped can leave."""

_START = 1e-4
"""The same at a start, m."""

_NOISE = 5e-6
"""Error of a measured distance that is allowed on the way, m: a plan from rest to rest that leads
away is not refused for it."""

_ANCHORS = 8
"""Number of configurations whose distances are remembered."""

_AT_ONCE = 2
"""Maximum number of them that a plan replaces."""

_WORK = 30
"""Work of a tick, in measured distances; a plan that needs more is not allowed."""

_MOVE = 2, 0.1
"""Work of each sample at which distances are measured, because the bodies are placed there: of the
call, and per body."""

_NODES = 1500
"""Maximum number of bounds of a plan that are computed one by one; a plan that needs more is not
allowed."""

_OPEN = 128
"""Maximum number of pairs that a plan can bring near each other; a plan of more is not allowed."""

_ENDLESS = 2**31 - 1
"""Work of a motion that is judged outside the loop."""

_MEASURE = ctypes.PYFUNCTYPE(ctypes.c_int, ctypes.c_int, ctypes.c_int)
"""Function of Python that C calls for the distances of some pairs at a sample."""

_KNOWN = ("rest", "anchor", "bound")
"""Arrays of the struct that a copy needs."""


class BodyGuard:
    """Test that all pairs of bodies keep a distance along each plan of a governor.

    A plan is the motion of the next ticks, which ends at rest; the governor follows it only if the
    guard allows it. The distances at a few configurations are remembered. They bound the distances
    at other configurations, so that only a few are measured per tick.

    Parameters
    ----------
    bodies
        Bodies of the robot and its surroundings.
    task
        Task of the governor.
    distance
        Distance to keep, m; pairs that are only checked for collisions keep 0.
    unchecked
        True to accept links without a body, whose collisions are not detected; False to raise an
        InputError for such links.

    Attributes
    ----------
    nearest : (str, str) or None
        Links of the two bodies that were too near along the last refused plan; None if no plan was
        refused yet.
    """

    def __init__(self, bodies: Bodies, task: Task, distance: float, *, unchecked: bool) -> None:
        self._bodies = _bodies_of(bodies, task, unchecked)
        self._distance = distance
        self.nearest: tuple[str, str] | None = None
        self._connect()

    def _connect(self) -> None:
        """Get the collision model of the bodies, and fill the struct of body_guard.c."""
        from ...model.collision_model import collision_model

        self._model = collision_model(self._bodies.task)
        self._drive = self._bodies.task.bodies_model()[1]
        self._reach = self._model.reach()
        self._kept = self._model.kept(self._distance)
        self._outside = False
        self._measure = _MEASURE(self._measured)
        self._error: BaseException = RuntimeError("no distance was measured")
        self._own = filled_struct(BODY_GUARD, *self._arrays(), self._scalars())[0]
        self._address = ctypes.addressof(self._own)
        self._native = required_library("a governor with bodies", holds=True)

    def _arrays(self) -> tuple[dict[str, Array], dict[str, Array]]:
        """Create the arrays of the C struct by name: one dict for integers, and one for floats."""
        pairs, joints = self._reach.shape
        most = min(pairs, _OPEN)
        ints = {"best": np.zeros(pairs), "open": np.zeros(pairs), "which": np.zeros(most)}
        ints |= {"exact": np.zeros((most, ROOM)), "failed": np.zeros((most, ROOM))}
        ints |= {"settled": np.zeros(most)}
        reals = {"reach": self._reach, "turned": self._reach.T}
        reals |= {"kept": self._kept, "rest": self._kept.copy()}
        reals |= {"anchor": np.zeros((_ANCHORS, joints)), "bound": np.zeros((_ANCHORS, pairs))}
        reals |= {"far": np.zeros(pairs), "found": np.zeros(pairs)}
        reals |= {"lower": np.zeros((most, ROOM)), "way": np.zeros((most, ROOM))}
        reals |= {"rows": np.zeros(pairs)}
        return ints, reals

    def _scalars(self) -> dict[str, Any]:
        """Collect the sizes and constants of the C struct by name, and the callback of C."""
        pairs, joints = self._reach.shape
        move = int(_MOVE[0] + _MOVE[1] * self._model.tables.bodies)
        scalars: dict[str, Any] = {"pairs": pairs, "joints": joints, "anchors": _ANCHORS}
        scalars |= {"room": ROOM, "most": min(pairs, _OPEN), "at_once": _AT_ONCE, "move": move}
        scalars |= {"nodes": _NODES, "stop": _STOP, "noise": _NOISE, "telling": TELLING}
        scalars |= {"tables": ctypes.addressof(self._model.tables)}
        return scalars | {"measure": ctypes.cast(self._measure, ctypes.c_void_p)}

    def __getstate__(self) -> dict[str, Any]:
        """Return the state for a copy, without the collision model, which the copy gets anew."""
        kept = {name: vars(self)[name] for name in ("_bodies", "_distance")}
        return kept | {"remembered": self.remembered()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        remembered = state.pop("remembered")
        vars(self).update(state)
        self._connect()
        self.recall(remembered)

    def remembered(self) -> dict[str, Any]:
        """Copy the distances that the guard remembers, and its state, for :meth:`recall`."""
        known = {name: self._own.held[name].copy() for name in _KNOWN}
        numbers = {"next": self._own.next, "left": self._own.left}
        return {"known": known, "nearest": self.nearest} | numbers

    def recall(self, remembered: dict[str, Any]) -> None:
        """Return to the state ``remembered``, which :meth:`remembered` copied.

        This dict has four keys: ``known`` has the remembered distances by name of their array,
        ``nearest`` the links of :attr:`nearest`, ``next`` the index of the remembered configuration
        to replace next, and ``left`` the work that is left in the tick, in measured distances.
        """
        for name, values in remembered["known"].items():
            self._own.held[name][...] = values
        self._own.next, self._own.left = remembered["next"], remembered["left"]
        self.nearest = remembered["nearest"]

    def start(self, q: Array) -> None:
        """Begin at rest at q (n,); measure and remember all distances there.

        Raises
        ------
        InputError
            If two bodies are closer than the distance to keep, plus 0.1 mm.
        """
        q = self._drive.joints(q)
        found = self._model.some_distances(q, np.arange(len(self._reach)))
        worst = int(np.argmin(found - self._kept))
        if found[worst] < self._kept[worst] + _START:
            self._refuse_start(worst, 1e3 * max(float(found[worst]), 0.0))
        held = self._own.held
        held["rest"][...] = np.minimum(self._kept + _STOP, found)
        held["anchor"][...], held["bound"][...] = q, found
        self._own.next = 0
        self.nearest = None

    def keeps(self, Q: Array) -> bool:
        """Test whether all distances are kept along any motion Q (K, n), not only a plan.

        Between two samples the joints move on a straight line. The number of measured distances is
        not limited, and what the guard remembers does not change.
        """
        S = np.vstack([np.zeros(Q.shape[1]), np.abs(np.diff(Q, axis=0)).cumsum(axis=0)])
        own, before = self._own, self.remembered()
        # what is remembered holds for ways from the present; here nothing is known
        own.held["bound"][...] = -np.inf
        own.nodes, self._outside = _ENDLESS, False
        try:
            parts = range(0, max(len(Q) - 1, 1), ROOM - 1)
            return all(self._keeps_part(Q[k : k + ROOM], S[k : k + ROOM]) for k in parts)
        finally:
            self.recall(before)
            own.nodes = _NODES

    def _keeps_part(self, Q: Array, S: Array) -> bool:
        """Test whether all distances are kept along at most 32 samples of a motion.

        If the test of all samples takes too much work, each half of the motion is tested in the
        same way. Q (K, n) are the samples. S (K, n) is the travel of each joint from the motion's
        first sample to each sample, rad or m.
        """
        self._own.left = _ENDLESS
        if self.allows(Q, S):
            return True
        middle = len(Q) // 2
        return (
            len(Q) > 2
            and self._own.excess == 1
            and self._keeps_part(Q[: middle + 1], S[: middle + 1])
            and self._keeps_part(Q[middle:], S[middle:])
        )

    def _refuse_start(self, pair: int, distance: float) -> None:
        """Raise the InputError for a start at which the pair number ``pair`` is too near.

        ``distance`` is the distance of the two bodies, mm.
        """
        one, other = self._model.names(pair)
        asked, remedy = 1e3 * (self._kept[pair] + _START), "start farther away"
        if self._kept[pair]:
            remedy += ", or use a smaller body_distance"
        raise InputError(
            f"the start is too near to a collision: {one} and {other} are {distance:.3g} mm "
            f"apart, but {asked:.3g} mm are required",
            remedy=remedy,
        )

    def begin_tick(self) -> None:
        """Begin a new tick, in which calls of :meth:`allows` may measure 30 distances in all."""
        self._own.left, self._outside = _WORK, True

    def allows(self, Q: Array, S: Array) -> bool:
        """Test whether a plan, the motion of the next ticks to rest, keeps all body distances.

        If not, :attr:`nearest` is the pair that is too near. A plan is also refused if its test
        would measure more distances than a tick may. The arm then follows the previous plan, which
        ends at rest.

        Parameters
        ----------
        Q
            Samples (K, n) of the plan, from the present to rest. From tick to tick the joints move
            on a straight line.
        S
            Travel (K, n), rad or m, of each joint from the first sample to each sample: the sum of
            its absolute motions. It bounds how far the bodies move between samples.
        """
        if not self._drive.identity:
            Q, S = self._drive.joints(Q), S @ np.abs(self._drive.S).T
        Q, S = np.ascontiguousarray(Q), np.ascontiguousarray(S)
        own, self._samples = self._own, Q
        at = (ctypes.c_void_p(address) for address in (self._address, Q.ctypes.data, S.ctypes.data))
        guard, samples, ways = at
        allowed = self._native.body_guard_allows(guard, ctypes.c_int(len(Q)), samples, ways)
        if allowed < 0:
            raise self._error
        if not allowed:
            self.nearest = self._model.names(own.nearest)
        return allowed == 1

    def _measured(self, sample: int, count: int) -> int:
        """Measure the distances of the ``count`` pairs that C chose, at a plan's sample ``sample``.

        C calls this, and reads the distances from its struct. Return 1, or 0 after an error. An
        exception must not pass through C; :meth:`allows` raises it later.
        """
        try:
            held = self._own.held
            pairs, q = held["which"][:count], self._samples[sample]
            found = self._model.some_distances(q, pairs, outside=self._outside)
            held["found"][:count] = found
            return 1
        except BaseException as error:
            self._error = error
            return 0


def _bodies_of(bodies: Bodies, task: Task, unchecked: bool) -> Bodies:
    """Check that ``bodies`` fit the governor's task, and return them.

    InputError is raised if the bodies are of another robot or of other joints than ``task``; if
    there is no pair of bodies; or if a link has no body, unless ``unchecked`` is True.
    """
    require_type(bodies, Bodies, "bodies", "rp.Bodies(task)")
    own = bodies.task
    if own.joint_names != task.joint_names or own.robot.description != task.robot.description:
        raise InputError(
            f"the bodies are of {own!r}, but the governor moves {task!r}",
            remedy="use rp.Bodies(inverse.task)",
        )
    if not bodies.pairs and not bodies.only_contact:
        raise InputError(
            "there is no pair of bodies whose distance can change: the model has no collision "
            "geometry that moves, and there are no surroundings",
            remedy="give surroundings=, or omit bodies=",
        )
    if bodies.unchecked and not unchecked:
        raise InputError(
            f"{bodies.not_checked.split(';')[0]}, so that their collisions are not detected: "
            f"{named_links(bodies.unchecked)}",
            remedy='give the missing shapes (package_dirs=), or set unchecked to "allow"',
        )
    return bodies
