r"""Body distances kept along the plans of a governor, between its samples too.

A pair's distance d changes by at most ρ·|q − q'| from q to q', with ρ_j a bound on how far joint j
moves the points of the two bodies against each other, m per rad. So a distance that was measured
at one configuration bounds it at others, and between two samples of a plan

.. math:: d \ge \tfrac{1}{2} (d_k + d_{k+1} - \rho \cdot s),

with s the ways of the joints from one to the other. Distances are measured only for the pairs and
at the samples where these bounds do not decide.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...base.arguments import Array, require_type
from ...base.errors import InputError
from ...model.bodies import Bodies, named_links
from ...model.task import Task

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

_ANCHORS = 12
"""Number of configurations whose distances are remembered."""

_AT_ONCE = 3
"""Maximum number of them that a plan replaces."""

_MOST = 100
"""Maximum number of distances measured in a tick; a plan that needs more is not allowed."""


class BodyGuard:
    """Tell a governor whether all pairs of bodies keep a distance along a plan.

    A plan is the motion of the next ticks that ends at rest; the governor follows it only if this
    allows it. The distances of a few configurations are remembered, with lower bounds that follow
    from them elsewhere, so that few are measured per tick.

    Parameters
    ----------
    bodies
        Bodies of the robot and its surroundings.
    task
        Task of the governor.
    distance
        Distance to keep, m; pairs that are checked for collisions only keep 0.
    unchecked
        Accept links without a body.

    Attributes
    ----------
    nearest : (str, str) or None
        Links of the two bodies that did not allow the last plan that was refused.
    """

    def __init__(self, bodies: Bodies, task: Task, distance: float, *, unchecked: bool) -> None:
        self._bodies = _bodies_of(bodies, task, unchecked)
        self._distance = distance
        self.nearest: tuple[str, str] | None = None
        self._connect()

    def _connect(self) -> None:
        """Find the collision model, which a copy of the guard cannot contain."""
        from ...model.collision_model import collision_model

        self._model = collision_model(self._bodies.task)
        self._drive = self._bodies.task.bodies_model()[1]
        self._reach = self._model.reach()
        self._kept = self._model.kept(self._distance)
        self._left = _MOST

    def __getstate__(self) -> dict[str, Any]:
        """Return what a copy needs; the collision model, which cannot be copied, is found again."""
        own = ("_model", "_drive", "_reach", "_kept")
        return {name: value for name, value in vars(self).items() if name not in own}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._connect()

    def start(self, q: Array) -> None:
        """Begin at q (n,), at rest; measure and remember all distances there.

        Raises
        ------
        InputError
            If two bodies are closer than the distance to keep.
        """
        q = self._drive.joints(q)
        found = self._model.some_distances(q, np.arange(len(self._reach)))
        worst = int(np.argmin(found - self._kept))
        if found[worst] < self._kept[worst] + _START:
            self._refuse_start(worst, 1e3 * max(float(found[worst]), 0.0))
        self._rest = np.minimum(self._kept + _STOP, found)
        self._anchors = np.repeat(q[None], _ANCHORS, axis=0)
        self._bounds = np.repeat(found[None], _ANCHORS, axis=0)
        self._next = 0
        self.nearest = None

    def keeps(self, Q: Array) -> bool:
        """Tell whether all distances are kept along samples Q (K, n) of a motion of another origin.

        Between two samples the joints move on a straight line. As many distances are measured as
        needed.
        """
        S = np.vstack([np.zeros(Q.shape[1]), np.abs(np.diff(Q, axis=0)).cumsum(axis=0)])
        for k in range(0, max(len(Q) - 1, 1), ROOM - 1):
            self._left = ROOM * len(self._reach)
            if not self.allows(Q[k : k + ROOM], S[k : k + ROOM]):
                return False
        return True

    def _refuse_start(self, pair: int, distance: float) -> None:
        """Raise the InputError for a start at which a pair (its index) is too near, mm."""
        one, other = self._model.names(pair)
        asked, remedy = 1e3 * (self._kept[pair] + _START), "start farther away"
        if self._kept[pair]:
            remedy += ", or use a smaller body_distance"
        raise InputError(
            f"the start is too near to a collision: {one} and {other} are {distance:.3g} mm "
            f"from each other, and {asked:.3g} mm are required",
            remedy=remedy,
        )

    def begin_tick(self) -> None:
        """Begin a tick of the control loop: allow 100 more distances to be measured."""
        self._left = _MOST

    def allows(self, Q: Array, S: Array) -> bool:
        """Tell whether a plan, the motion of the next ticks to rest, keeps all body distances.

        If not, the pair that is too near is :attr:`nearest`. It is also not allowed if too many
        distances would have to be measured in this tick.

        Parameters
        ----------
        Q
            Samples (K, n) of the plan, from the present to rest. From tick to tick the joints move
            on a straight line.
        S
            Distance (K, n), rad or m, that each joint has moved, there and back, from the first
            sample to each sample. It bounds how far the bodies move between samples.
        """
        if not self._drive.identity:
            Q, S = self._drive.joints(Q), S @ np.abs(self._drive.S).T
        pairs = self._undecided(Q, S)
        if not len(pairs):
            return True
        reach, kept = self._reach[pairs], self._kept[pairs]
        least = np.tile(self._rest[pairs] - _NOISE, (len(Q), 1))
        least[-1] = self._rest[pairs]
        way = np.diff(S, axis=0) @ reach.T  # (K - 1, P)
        lower = self._known(Q, pairs)  # (K, P)
        exact = np.zeros(lower.shape, bool)
        while True:
            failed = ~(lower >= least)
            between = ~(lower[:-1] + lower[1:] - way >= 2 * kept)
            failed[:-1] |= between
            failed[1:] |= between
            unsure = failed & ~exact
            if not unsure.any() or (failed & exact)[-1].any():
                break
            k = len(Q) - 1
            if not unsure[k].any():
                k = int(np.argmin(np.where(unsure, lower - kept, np.inf)) // len(pairs))
            which = np.flatnonzero(unsure[k])
            self._left -= len(which)
            if self._left < 0:
                break
            found = self._model.some_distances(Q[k], pairs[which])
            exact[k, which] = True
            moved = np.abs(Q - Q[k]) @ reach[which].T
            lower[:, which] = np.maximum(lower[:, which], found - moved)
        self._remember(Q, pairs, lower, np.flatnonzero(exact.any(axis=1))[::-1])
        if not failed.any():
            return True
        worst = int(np.argmin(np.where(failed, lower - kept, np.inf)))
        self.nearest = self._model.names(int(pairs[worst % len(pairs)]))
        return False

    def _undecided(self, Q: Array, S: Array) -> NDArray[np.intp]:
        """Find the pairs, by index, that no remembered configuration shows to keep their distance.

        Q and S are the samples and ways of a plan, as for :meth:`allows`. Only these pairs need a
        closer look; usually there are few.
        """
        low, high = Q.min(axis=0), Q.max(axis=0)
        moved = np.maximum(high - self._anchors, self._anchors - low)
        lower = (self._bounds - moved @ self._reach.T).max(axis=0)
        way = (np.diff(S, axis=0).max(axis=0, initial=0.0) @ self._reach.T) / 2
        return np.flatnonzero(~(lower >= self._kept + np.maximum(way, _STOP)))

    def _known(self, Q: Array, pairs: NDArray[np.intp]) -> Array:
        """Bound the distances of pairs from below at all samples, by remembered ones: (K, P), m.

        A distance decreases by at most the reach ρ of each joint times the way to the sample.
        """
        moved = np.abs(Q[:, None] - self._anchors) @ self._reach[pairs].T
        known: Array = (self._bounds[:, pairs] - moved).max(axis=1)
        return known

    def _remember(
        self, Q: Array, pairs: NDArray[np.intp], lower: Array, measured: NDArray[np.intp]
    ) -> None:
        """Remember the bounds at some samples of a plan, in place of the oldest remembered ones.

        ``pairs`` have the bounds ``lower`` (K, P), m, at all samples; those of other pairs follow
        from remembered configurations. ``measured`` are the numbers of samples at which distances
        were measured.
        """
        some = measured[:: max(1, len(measured) // _AT_ONCE)][:_AT_ONCE]
        bounds = self._known(Q[some], np.arange(len(self._reach)))
        bounds[:, pairs] = np.maximum(bounds[:, pairs], lower[some])
        at = (self._next + np.arange(len(some))) % _ANCHORS
        self._anchors[at], self._bounds[at] = Q[some], bounds
        self._next = (self._next + len(some)) % _ANCHORS


def _bodies_of(bodies: Bodies, task: Task, unchecked: bool) -> Bodies:
    """Check that bodies are those of the task's robot and joints, and some; return them.

    With ``unchecked``, links without a body are accepted.
    """
    require_type(bodies, Bodies, "bodies", "rp.Bodies(task)")
    own = bodies.task
    if own.joint_names != task.joint_names or own.robot.description != task.robot.description:
        raise InputError(
            f"the bodies are of {own!r}, but the governor moves {task!r}",
            remedy="use rp.Bodies of the task of the inverse",
        )
    if not bodies.pairs and not bodies.only_contact:
        raise InputError(
            "there are no bodies whose distance can be kept: the URDF has no collision geometry "
            "that moves, and there are no surroundings",
            remedy="give surroundings=, or leave bodies out",
        )
    if bodies.unchecked and not unchecked:
        raise InputError(
            f"{bodies.not_checked.split(';')[0]}, so that their collisions are not detected: "
            f"{named_links(bodies.unchecked)}",
            remedy='give the missing shapes (package_dirs=), or set unchecked to "allow"',
        )
    return bodies
