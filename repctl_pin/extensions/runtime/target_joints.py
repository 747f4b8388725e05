"""Target configuration on a leaf: the end of the straight line of the frame from the start."""

from __future__ import annotations

from math import inf

import numpy as np
import pinocchio as pin

from ...arguments import Array
from ...errors import InputError, SingularityError
from ...strategies.repeatable import RepeatableInverse
from .course import course_of
from .frame_motion import FrameMotion, straight
from .governor_law import CommandLimits

LONGEST_STEP = 0.1
"""Maximum motion of a joint per step of the continuation, rad or m."""

CONTRACTION = 0.25
"""Maximum ratio of a Newton step to the one before; a larger ratio could lead to a different branch
of the inverse kinematics."""

MOST_AT_ONCE = 40
"""Maximum number of evaluations of the inverse per call of :meth:`TargetJoints.look_for`."""

_EXACT, _ITERATIONS, _SHORTEST = 1e-6, 6, 1e-3
"""Newton step, rad or m, below which Newton's method has converged; maximum number of Newton
steps; minimum step of the continuation, as a fraction of the line."""


class TargetJoints:
    """Target configuration ``F(x; c)``, by continuation on a straight line from start to target.

    The line of the frame is a displacement with a rotation about one axis, by at most 180°; in a
    cell, it is straight in the cell's coordinates. The result does not depend on where the arm is
    at present, so that the configuration at rest is a function of the target.

    Parameters
    ----------
    inverse
        The repeatable inverse.
    bounds
        Limits of the joints.

    Attributes
    ----------
    target : pinocchio.SE3, optional
        Target that is looked for.
    found : (n,) array, optional
        Configuration at the target. None if it is not known yet, or if the line leads beyond a
        limit, out of the region, or to a singularity.
    known : bool
        True if ``found`` is final.
    """

    def __init__(self, inverse: RepeatableInverse, bounds: CommandLimits) -> None:
        self._inverse, self._bounds = inverse, bounds

    def start(self, q: Array, leaf: Array) -> None:
        """Set the configuration and the leaf from which all lines begin; forget the target."""
        self._start, self._leaf = q, leaf
        self._course = course_of(self._inverse.task, self._inverse.region, q)
        self.target: pin.SE3 | None = None

    def look_for(self, target: pin.SE3) -> None:
        """Continue the search for a target's configuration, by a limited number of evaluations."""
        if self.target is None or target != self.target:
            self._begin(target)
        self._left = MOST_AT_ONCE
        while not self.known and self._left > 0:
            self._continue()

    def _begin(self, target: pin.SE3) -> None:
        self.target, self.known = target, False
        self.found: Array | None = None
        self._q, self._share, self._step = self._start, 0.0, 1.0
        way = self._course.way(target)
        self._line: FrameMotion = straight(self._course, way)

    def _continue(self) -> None:
        """Take one step of the continuation along the line; if it fails, halve the next one."""
        end = min(self._share + self._step, 1.0)
        q = self._solved(self._q, self._line.placement(end))
        if q is None:
            self._step /= 2
            self.known = self._step < _SHORTEST
            return
        self._q, self._share, self._step = q, end, 2 * self._step
        if end == 1.0:
            self.found, self.known = q, True

    def _solved(self, q: Array, target: pin.SE3) -> Array | None:
        """Solve f(q) = x, h(q) = c near the guess q; None without a solution in all limits."""
        before = inf
        for _ in range(_ITERATIONS):
            self._left -= 1
            try:
                following = self._inverse.step(q, target, 1.0, leaf=self._leaf)
            except (InputError, SingularityError):
                return None
            size = float(np.abs(following - q).max())
            q = following
            if not size <= max(min(LONGEST_STEP, CONTRACTION * before), _EXACT):
                return None
            if size < _EXACT:
                return q if self._allowed(q) else None
            before = size
        return None

    def _allowed(self, q: Array) -> bool:
        region = self._inverse.region
        if region is not None and not region.ratio(q[None])[0] <= 1 + 1e-9:
            return False
        return bool(((q >= self._bounds.lower) & (q <= self._bounds.upper)).all())
