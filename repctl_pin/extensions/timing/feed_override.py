"""Feed override of a timed motion: stop, resume and reverse along its path, within its limits.

The override o is the speed on the motion's clock: 1 as timed, 0 at rest, -1 backwards. A cycle is
one traversal of the motion's closed path. A change of the override is a curve o(t) from one value
to another. n is the number of joints.

``_Change`` is K alternative changes of the override over time, of which one is chosen.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ...base.arguments import Array, finite, positive, read_only, require_type, shown, vector
from ...base.errors import InputError
from ...motion.timed_motion import TimedMotion

_TOLERANCE = 1.005
"""Factor up to which a limit may be exceeded and count as kept; a time-optimal motion meets one of
its limits at nearly every moment."""

_COARSE = np.linspace(0.0, 1.0, 33)
"""Points at which a change of the override is checked first, as fractions of its duration."""

_FINE = 5e-4
"""Time between the points at which the chosen change is checked, s."""

_MOST_POINTS = 2000
"""Maximum number of points at which the chosen change is checked."""

_LONGER = 1.3 ** np.arange(10)
"""Durations of a change that are tried, as multiples of the shortest one within the acceleration
and jerk limits at its start."""

_SHARES: Array = 0.5 ** np.arange(1.0, 6.0)
"""Fractions of a change that are tried if the whole change would exceed the limits."""

_QUICKEST = 1e-3
"""Minimum duration of a change of the override, s."""

_AGAIN = 0.005
"""Time between attempts to change the override to the requested value, s."""

_NEAR = 1e-3
"""Maximum distance of a start from the path, rad or m."""


@dataclass(frozen=True, eq=False)
@read_only
class _Change:
    """K alternative changes of the override o(t), of which the shortest within limits is chosen.

    All changes begin with the same o and ȯ. In each, o is a cubic polynomial in time until it
    reaches its goal with ȯ = 0, and constant afterwards.

    Attributes
    ----------
    begin : float
        Time on the motion's clock at which the changes begin, s.
    override, rate : float
        o and ȯ, 1/s, at the beginning.
    goal, time : (K,) arrays
        Value of o at the end, and duration, s, of each change.
    """

    begin: float
    override: float
    rate: float
    goal: Array
    time: Array

    def at(self, t: Array) -> tuple[Array, Array, Array, Array]:
        """Evaluate ∫o dt, o, ȯ and ö of the K changes at times t since the beginning, s.

        The last axis of ``t`` has one entry per change, or a single entry for all changes. ∫o dt is
        the time by which the motion's clock has advanced since the beginning, s. Return (∫o dt, o,
        ȯ, ö), each (..., K).
        """
        W = np.maximum(self.time, 1e-12)
        u = np.clip(t / W, 0.0, 1.0)
        o = self.override
        r = self.rate * W
        d = self.goal - self.override
        inside = t < self.time
        way = W * (o * u + r * (u**2 / 2 - 2 * u**3 / 3 + u**4 / 4) + d * (u**3 - u**4 / 2))
        value = o + r * u * (1 - u) ** 2 + d * u**2 * (3 - 2 * u)
        first = (r * (1 - 4 * u + 3 * u**2) + d * 6 * u * (1 - u)) / W
        second = (r * (6 * u - 4) + d * (6 - 12 * u)) / W**2
        return (
            way + self.goal * (t - W * u),
            value,
            np.where(inside, first, 0.0),
            np.where(inside, second, 0.0),
        )


class Run:
    """Run a timed motion with a feed override that may change at any time.

    The override 1 runs the motion as timed, 0 stops, and -1 runs it backwards.

    The joints stay on the motion's joint path q(τ), where the motion's clock τ advances by
    ``dτ/dt = o``. The override o reaches the requested value by cubic polynomials in time, as
    quickly as the motion's limits of speed, acceleration and jerk allow: ``q̈ = q″ o² + q′ ȯ``,
    ``q⃛ = q‴ o³ + 3 q″ o ȯ + q′ ö``, with ′ = d/dτ. A change is begun only if these limits hold to
    its end.

    Parameters
    ----------
    timed
        Result of :func:`timed`.
    q : (n,) array, optional
        Configuration at which to begin, which must lie on the first cycle, such as the end of
        ``approach(..., to="nearest")``; by default the motion's first configuration.

    Attributes
    ----------
    t : float
        Time reached on the clock of ``timed.t``, s.
    override : float
        Present value of the override.

    Raises
    ------
    InputError
        If q is more than 0.001 rad or m away from the first cycle.

    Examples
    --------
    >>> run = rp.Run(rp.timed(motion, rp.Limits(acceleration=5.0)))
    >>> for _ in range(500):
    ...     q, qdot = run.step(0.001)
    >>> for _ in range(500):
    ...     q, qdot = run.step(0.001, override=0)
    >>> run.override, bool(abs(qdot).max() == 0)
    (0.0, True)
    """

    def __init__(self, timed: TimedMotion, *, q: ArrayLike | None = None) -> None:
        require_type(timed, TimedMotion, "timed", "a timed motion, such as rp.timed makes")
        if timed.trajectory is None:
            raise InputError("timed has no trajectory; give a result of rp.timed()")
        self._timed, self._trajectory = timed, timed.trajectory
        self._end = float(timed.t[-1])
        begin = 0.0 if q is None else self._nearest(vector(q, len(timed.joints), "q"))
        self._t = begin
        self._override = 0.0
        self._rate = 0.0
        self._since = 0.0
        self._change = _Change(begin, 0.0, 0.0, np.zeros(1), np.zeros(1))
        self._wish, self._looked = 0.0, 0.0

    def __repr__(self) -> str:
        return f"<Run at {self._t:.3g} of {self._end:.3g} s, override {self._override:.3g}>"

    @property
    def t(self) -> float:
        """Time reached on the clock of ``timed.t``, s."""
        return self._t

    @property
    def override(self) -> float:
        """Present value of the override, the speed on the motion's clock: 1 as timed, 0 at rest."""
        return self._override

    def step(self, dt: float, override: float = 1.0) -> tuple[Array, Array]:
        """Advance by a time step, and return the next positions and velocities.

        Parameters
        ----------
        dt
            Time step, s.
        override
            Requested override, from -1 to 1.

        Returns
        -------
        q, qdot : (n,) arrays
            Positions of the robot's joints and their velocities, rad and rad/s (m and m/s).

        Raises
        ------
        InputError
            If dt is not above 0 or the override is beyond ±1.
        """
        dt = positive(dt, "dt", "s")
        override = finite(override, "override")
        if not -1 <= override <= 1:
            raise InputError(
                f"override must be from -1 to 1, not {shown(override)}; "
                "use rp.timed() for a faster motion"
            )
        self._aim(override)
        self._since += dt
        way, o, rate, _ = (float(part[0]) for part in self._change.at(np.array([self._since])))
        self._t = min(max(self._change.begin + way, 0.0), self._end)
        self._override, self._rate = o, rate
        if self._t in (0.0, self._end):
            self._hold(self._t, o)
        q, slope = self._trajectory.derivatives(np.array([self._t]))[:2, 0]
        return q, slope * o

    def _hold(self, t: float, override: float) -> None:
        """Set the motion's clock to ``t``, s, and the override to a value that stays constant."""
        self._t = t
        self._override = override
        self._rate = 0.0
        self._since = 0.0
        self._change = _Change(t, override, 0.0, np.array([override]), np.zeros(1))
        self._wish, self._looked = override, 0.0

    def _aim(self, wish: float) -> None:
        """Begin a change of the override o to the requested value ``wish``, if one is needed.

        If the limits do not allow the whole change, o changes to a value between the present one
        and ``wish``. Until ``wish`` is reached, a better change is sought every 5 ms. A change to
        ``wish`` that is under way is replaced only by one that ends at least 5 % sooner. Before and
        after the motion, where the arm rests, o is set to ``wish`` at once.
        """
        change, left = self._change, float(self._change.time[0]) - self._since
        if wish == self._wish and (
            (left <= 0 and change.goal[0] == wish) or self._since - self._looked < _AGAIN
        ):
            return
        if not self._timed.starts[0] < self._t < self._timed.starts[-1]:  # at rest
            self._hold(self._t, wish)
            return
        self._wish, self._looked = wish, self._since
        found = self._quickest(np.array([wish]))
        if found is None and change.goal[0] != wish:
            found = self._quickest(
                np.asarray(self._override + (wish - self._override) * _SHARES, float)
            )
        if found is not None and not (change.goal[0] == wish and found.time[0] > 0.95 * left):
            self._change = found
            self._since = 0.0
            self._looked = 0.0

    def _quickest(self, goals: Array) -> _Change | None:
        """Find the first of the overrides ``goals`` (G,) that can be reached within the limits.

        The goals are tried in their order, each with a few durations, the shortest first. Return
        the first change within the limits, as a :class:`_Change` with K = 1; None if there is none.
        """
        slope = np.abs(self._trajectory.derivatives(np.array([self._t]))[1, 0])
        far = np.abs(goals - self._override)
        shortest = 1.5 * far * np.max(slope / self._timed.acceleration)
        if self._timed.jerk is not None:
            shortest = np.maximum(shortest, np.sqrt(6 * far * np.max(slope / self._timed.jerk)))
        times = (np.maximum(shortest, _QUICKEST)[:, None] * _LONGER).ravel()
        changes = _Change(
            self._t, self._override, self._rate, np.repeat(goals, len(_LONGER)), times
        )
        for k in np.flatnonzero(self._kept(changes, _COARSE)):
            one = _Change(
                self._t, self._override, self._rate, changes.goal[k : k + 1], times[k : k + 1]
            )
            if self._kept(one, np.linspace(0.0, 1.0, int(min(times[k] / _FINE, _MOST_POINTS)) + 2))[
                0
            ]:
                return one
        return None

    def _kept(self, change: _Change, shares: Array) -> Array:
        """Test which of K changes stay within the joint limits of speed, acceleration and jerk.

        Return a mask (K,). The limits are checked at the fractions ``shares`` (S,) of each change's
        duration.
        """
        way, o, rate, push = change.at(shares[:, None] * change.time)
        clock = np.clip(change.begin + way, 0.0, self._end)
        q = self._trajectory.derivatives(clock.ravel()).reshape(4, *clock.shape, -1)
        o, rate, push = (part[..., None] for part in (o, rate, push))
        timed = self._timed
        used = np.abs(q[1] * o) / timed.velocity
        used = np.maximum(used, np.abs(q[2] * o**2 + q[1] * rate) / timed.acceleration)
        if timed.jerk is not None:
            used = np.maximum(
                used, np.abs(q[3] * o**3 + 3 * q[2] * o * rate + q[1] * push) / timed.jerk
            )
        return np.asarray(used.max(axis=(0, 2)) <= _TOLERANCE)

    def _nearest(self, q: Array) -> float:
        """Find the time, s, on the motion's clock at which the first cycle passes q (n,).

        InputError is raised if the cycle stays more than 0.001 rad or m away from q.
        """
        timed = self._timed
        first = timed.t <= timed.starts[1]
        k = int(np.argmin(np.linalg.norm(timed.q[first] - q, axis=1)))
        ends = max(timed.t[max(k - 1, 0)], 0.0), timed.t[min(k + 1, len(timed.t) - 1)]

        def away(t: float) -> float:
            return float(np.linalg.norm(self._trajectory.derivatives(np.array([t]))[0, 0] - q))

        from scipy.optimize import minimize_scalar  # slow to import

        found = minimize_scalar(away, bounds=ends, method="bounded", options={"xatol": 1e-12})
        t = float(found.x) if found.fun < away(float(timed.t[k])) else float(timed.t[k])
        if not away(t) < _NEAR:
            raise InputError(
                f"q is {away(t):.3g} rad (or m) away from the path; "
                'move the arm to the path with rp.approach(q, motion, limits, to="nearest")'
            )
        return t
