"""Joint polynomials that follow a frame's motion on a leaf, for the plans of the governor."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ...arguments import Array
from ...errors import InputError, SingularityError
from ...strategies.repeatable import RepeatableInverse
from .course import Course
from .frame_motion import FrameMotion
from .status import Status

_LONGEST, _EXACT, _ITERATIONS = 0.3, 1e-6, 6
"""Newton's method: longest step, rad or m; step below which it has converged; number of steps."""

_ACCURATE = 3e-11
"""Maximum last Chebyshev coefficient, rad or m; a polynomial's error is about a tenth of it."""

MOST_PIECES = 24
"""Maximum number of polynomials of a plan."""

SHORT, LONG = 4, 10
"""Degrees of the polynomials: for motions of a few ticks, and for longer ones."""


class _Nodes(NamedTuple):
    """Tables for polynomial interpolation of degree d at Chebyshev–Lobatto nodes.

    Attributes
    ----------
    share : (d + 1,) array
        The nodes, as fractions from 0 to 1 of the interval.
    ahead : (d + 1, d + 1) array
        Row j extrapolates to node j from the values at the nodes before it, columns 0 to j − 1, and
        from the derivative with respect to ``share`` at node 0, column j.
    monomials : (d + 1, d + 1) array
        Coefficients of 1, u, …, u^d from values at the nodes, u = 2 share − 1.
    """

    share: Array
    ahead: Array
    monomials: Array


def _nodes_of(degree: int) -> _Nodes:
    """Compute the tables for a degree."""
    share = (1 - np.cos(np.pi * np.arange(degree + 1) / degree)) / 2
    ahead = np.zeros((degree + 1, degree + 1))
    for j in range(1, degree + 1):
        known = np.vander(share[:j], j + 1, increasing=True)
        slope = np.eye(j + 1)[1]
        ahead[j, : j + 1] = np.linalg.solve(
            np.vstack([known, slope]).T, share[j] ** np.arange(j + 1)
        )
    u = 2 * share - 1
    return _Nodes(
        share, ahead, np.asarray(np.linalg.inv(np.vander(u, increasing=True)), float)
    )


NODES = {SHORT: _nodes_of(SHORT), LONG: _nodes_of(LONG)}


class _JointPolynomial(NamedTuple):
    """Joint polynomial ``q(t) = Σ_k C[k] u^k``, u from −1 at ``begin`` to 1 at ``end``, s."""

    begin: float
    end: float
    C: Array

    def at(self, t: float | Array) -> Array:
        """Evaluate q at one time (n,), or several (K, n)."""
        u = (2 * t - (self.begin + self.end)) / (self.end - self.begin)
        if isinstance(u, np.ndarray):
            u = u[:, None]
        q = self.C[-1]
        for c in self.C[-2::-1]:
            q = q * u + c
        return q

    def derivatives(self, t: float) -> tuple[Array, Array]:
        """Evaluate q̇ and q̈ (n,) at a time."""
        scale = 2 / (self.end - self.begin)
        u = (2 * t - (self.begin + self.end)) / (self.end - self.begin)
        d = len(self.C) - 1
        first, second = d * self.C[d], d * (d - 1) * self.C[d]
        for k in range(d - 1, 0, -1):
            first = first * u + k * self.C[k]
            if k > 1:
                second = second * u + k * (k - 1) * self.C[k]
        return first * scale, second * scale**2


class Plan:
    """Sequence of frame motions that ends at rest, and the joint polynomials that follow it.

    Parameters
    ----------
    q, qdot : (n,) arrays
        Joint positions and velocities at the beginning.
    start : Course
        Course at the beginning.
    lands
        True if the plan ends at a target.

    Attributes
    ----------
    q, qdot : (n,) arrays
        Joint positions and velocities at the present end of the plan.
    motions, begins : lists
        Motions of the frame, and the time at which each begins, s.
    pieces : list of JointPolynomial
        Polynomials of the joints, in order.
    time : float
        Duration, s.
    """

    def __init__(
        self, q: Array, qdot: Array, start: Course, *, lands: bool = False
    ) -> None:
        self.q, self.qdot, self.lands, self.time = q, qdot, lands, 0.0
        self._start = start
        self.motions: list[FrameMotion] = []
        self.begins: list[float] = []
        self.pieces: list[_JointPolynomial] = []

    def copy(self) -> Plan:
        """Copy the plan, to append to it."""
        plan = Plan(self.q, self.qdot, self._start, lands=self.lands)
        plan.motions, plan.begins = [*self.motions], [*self.begins]
        plan.pieces, plan.time = [*self.pieces], self.time
        return plan

    def at(self, t: float) -> Array:
        """Evaluate the configuration (n,) at a time from the plan's beginning, s."""
        for piece in self.pieces:
            if t <= piece.end:
                return piece.at(t)
        return self.q

    def derivatives(self, t: float) -> tuple[Array, Array]:
        """Evaluate q̇ and q̈ (n,) at a time."""
        for piece in self.pieces:
            if t <= piece.end:
                return piece.derivatives(t)
        return np.zeros_like(self.q), np.zeros_like(self.q)

    def rates(self, t: float) -> tuple[Array, Array]:
        """Evaluate ξ and its derivative ξ̇, (6,) each, at a time."""
        for begin, motion in zip(self.begins, self.motions, strict=True):
            if t <= begin + motion.duration:
                return motion.rates(t - begin)
        return np.zeros(6), np.zeros(6)

    def course(self, t: float) -> Course:
        """Evaluate the course at a time."""
        course = self._start
        for begin, motion in zip(self.begins, self.motions, strict=True):
            if t <= begin + motion.duration:
                return motion.course(t - begin)
            course = motion.course(motion.duration)
        return course

    def samples(self, dt: float, first: int, last: int) -> Array:
        """Evaluate the configurations at ticks ``first`` to ``last`` − 1: (last − first, n)."""
        t = np.asarray(np.arange(first, last) * dt, float)
        Q = np.tile(self.q, (len(t), 1))
        begin = 0
        for piece in self.pieces:
            end = int(np.searchsorted(t, piece.end, side="right"))
            Q[begin:end] = piece.at(t[begin:end])
            begin = end
        return Q


class LeafInterpolation:
    """Polynomial interpolation of ``q(t) = F(x(t); c)`` on a leaf, exact at its nodes.

    Parameters
    ----------
    inverse
        The repeatable inverse, whose region the nodes must not leave.

    Attributes
    ----------
    left : int
        Number of evaluations of the inverse that are left in this tick, which its owner sets when
        the tick begins; negative if there were too few.
    outside : bool
        True if the last failure was a node outside the region.
    """

    def __init__(self, inverse: RepeatableInverse) -> None:
        self._inverse = inverse
        self.left, self.outside = 0, False
        self.leaf = np.zeros(inverse.task.r)

    def failure(self) -> Status:
        """Return the status that explains why the last motion was not added."""
        if self.left < 0:
            return Status.SLOWED
        return Status.OUTSIDE if self.outside else Status.SINGULAR

    def add(self, plan: Plan, motion: FrameMotion, degree: int, count: int = 1) -> int:
        """Append a motion of the frame to a plan, in ``count`` or more polynomials.

        Returns their number, or 0 if the motion cannot be followed; the plan must then be
        discarded.
        """
        begin, T, done = plan.time, motion.duration, 0.0
        width = T / count
        shortest, made = T / 64, 0
        while done < T:
            if len(plan.pieces) == MOST_PIECES:
                return 0
            end = T if T - done < 1.3 * width else done + width
            C = self._coefficients(motion, done, end, plan, degree)
            if C is None:
                return 0
            last = np.abs(C[-1]).max() * 2.0 ** (1 - degree)
            if not last <= _ACCURATE:
                width = (end - done) / 2
                if width < shortest:
                    return 0
                continue
            plan.pieces.append(_JointPolynomial(begin + done, begin + end, C))
            plan.q, plan.qdot = self._end, plan.pieces[-1].derivatives(begin + end)[0]
            done, made = end, made + 1
        plan.motions.append(motion)
        plan.begins.append(begin)
        plan.time = begin + T
        return made

    def _coefficients(
        self, motion: FrameMotion, begin: float, end: float, plan: Plan, degree: int
    ) -> Array | None:
        """Interpolate the joints between two times of a motion: coefficients (degree + 1, n).

        Returns None if a node has no solution.
        """
        table = NODES[degree]
        Q = np.empty((degree + 1, len(plan.q)))
        Q[0], slope = plan.q, (end - begin) * plan.qdot
        for j in range(1, degree + 1):
            guess = table.ahead[j, :j] @ Q[:j] + table.ahead[j, j] * slope
            at = motion.placement(begin + table.share[j] * (end - begin))
            found = self._solved(guess, at)
            if found is None:
                return None
            Q[j] = found
        self._end = Q[-1]
        return table.monomials @ Q

    def _solved(self, q: Array, target: pin.SE3) -> Array | None:
        """Solve f(q) = x, h(q) = c from the guess q; None without a solution inside the region."""
        inverse = self._inverse
        self.outside = False
        for _ in range(_ITERATIONS):
            self.left -= 1
            if self.left < 0:
                return None
            try:
                following = inverse.step(q, target, 1.0, leaf=self.leaf)
            except (InputError, SingularityError):
                return None
            size = float(np.abs(following - q).max())
            q = following
            if not size < _LONGEST:
                return None
            if size < _EXACT:
                if inverse.region is not None:
                    self.outside = not inverse.region.ratio(q[None])[0] <= 1 + 1e-9
                return None if self.outside else q
        return None
