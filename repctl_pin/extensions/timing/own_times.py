"""Timing by a motion's own times, from rest to rest, smoothed no more than the limits require.

Own times are the times of the waypoints, such as the column ``time`` of a file. A robot that works
with another machine must keep them. They give s(t), the length of the joint path over time, whose
speed ṡ jumps, at least at both ends. So s(t) is smoothed: convolved with a triangle of width r, the
smoothing time. Letters: T points or times, n joints.

``JointLimits`` are maximum joint speeds and accelerations (n,) and, if given, torques and jerks, as
numbers. ``_OwnTimes`` is a smooth part of a joint path, timed as the motion itself was.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...base.arguments import Array, read_only
from ...base.errors import InputError
from ...motion.limits import JointLimits
from .speed_profile import Segment, most_used, used_fractions

_LONGER = 1.5
"""Ratio of successive smoothing times that are tried."""

_HALVINGS = 6
"""Number of bisections between the first smoothing time within the limits and the last one that
was too short."""

_SHORTEST = 1e-3
"""Shortest smoothing time, s."""

_KEPT = 1 + 1e-9
"""Factor up to which a limit may be exceeded and count as kept."""

_BETWEEN = np.array([0.0, 0.25, 0.5, 0.75, 1.0 - 1e-9])
"""Points at which limits are checked between two breaks of s(t), as fractions of the time."""


@dataclass(frozen=True, eq=False)
@read_only
class _OwnTimes(Segment):
    """A smooth part of a joint path, from rest to rest, in the motion's own times.

    Its s(t) is the motion's own s(t), with rest before and after, smoothed. Smoothing with the time
    r never raises the largest speed, and changes a constant speed only within r/2 of a jump.

    Attributes
    ----------
    smooth : PPoly
        s(t), a piecewise polynomial.
    """

    smooth: Any

    def law(self, t: Array) -> tuple[Array, Array, Array, Array]:
        """Evaluate the path length s and ṡ, s̈, s⃛, (T,) each, at times (T,), s, from the start."""
        s = np.clip(self.smooth(t), 0.0, self.s[-1])
        return s, self.smooth(t, 1), self.smooth(t, 2), self.smooth(t, 3)

    def excess(self, limits: JointLimits) -> float:
        """Return 1, the factor by which to stretch time: the smoothing made the limits hold."""
        return 1.0


def with_own_times(
    Q: Array, clock: Array, limits: JointLimits, *, added: int, most: float, joints: Sequence[str]
) -> _OwnTimes:
    """Time a smooth joint path by its own times, smoothed as little as the limits allow.

    Parameters
    ----------
    Q : (T, n) array
        Joint path: configurations.
    clock : (T,) array
        Time at which each point is passed, s.
    limits
        Limits to respect.
    added
        Number of ends of the path, 0 to 2, at which smoothing may make the motion longer, by half
        the smoothing time per end. For each other end, the whole path is traversed a little faster,
        so that this end adds no time.
    most
        Longest smoothing time allowed, s.
    joints
        Names of the joints, for messages.

    Raises
    ------
    InputError
        If the motion's own times exceed the limits.
    """
    # the path over its length, and the time at which it passes each point
    s = _summed(np.linalg.norm(np.diff(Q, axis=0), axis=1))
    from scipy.interpolate import CubicSpline  # slow to import

    curve = CubicSpline(s, Q, bc_type="not-a-knot")
    own = clock - clock[0]
    most = min(most, float(own[-1]) * (0.5 if added < 2 else 1.0))
    # smallest smoothing that the joint speeds at the ends allow
    r = _least_smoothing(curve(s, 1) * np.gradient(s, own)[:, None], limits)
    short, r, nearest, why = 0.0, min(max(r, _SHORTEST), most), np.inf, ""

    def tried(r: float) -> _OwnTimes | None:
        nonlocal nearest, why
        segment = _smoothed(curve, s, own, r, added)
        t = segment.smooth.x
        t = (t[:-1, None] + np.diff(t)[:, None] * _BETWEEN).ravel()
        moved = segment.derivatives(t)
        used = most_used(limits, moved)
        if used > _KEPT and used < nearest:
            nearest, why = used, _worst(limits, moved, t + float(clock[0]), joints)
        return segment if used <= _KEPT else None

    # longer smoothing until the limits are kept, then halve the interval
    found = None
    while r <= most and (found := tried(r)) is None:
        short, r = r, r * _LONGER
    if found is None:
        raise InputError(
            f"the times of the path exceed the limits: {why}; "
            "multiply the times by a factor above 1, or omit keep_times="
        )
    for _ in range(_HALVINGS if short else 0):
        between = (short + r) / 2
        if (shorter := tried(between)) is None:
            short = between
        else:
            r, found = between, shorter
    return found


def _least_smoothing(rates: Array, limits: JointLimits) -> float:
    """Compute a lower bound of the smoothing time, s, that joint speeds (T, n) require.

    Only the first and the last row of ``rates`` count: there, the speed jumps from or to 0.
    """
    ends = np.abs(rates[[0, -1]])
    r = float((ends / limits.acceleration).max())
    if limits.jerk is not None:
        r = max(r, 2 * float(np.sqrt((ends / limits.jerk).max())))
    return r


def _worst(limits: JointLimits, moved: tuple[Array, ...], t: Array, joints: Sequence[str]) -> str:
    """Write, for an error message, which limit is exceeded most, by which joint, and when.

    ``moved`` are q, q̇, q̈ and q⃛, each (T, n), at the times t (T,), s; ``joints`` are names.
    """
    found = []
    for what, _, used in used_fractions(limits, moved):
        k, j = divmod(int(np.argmax(used)), used.shape[1])
        share = float(used[k, j])
        found.append(
            (share, f"{joints[j]} would need {share:.4g} times its {what} at {t[k]:.3g} s")
        )
    if limits.tool is not None:
        used = limits.tool(moved[0], moved[1])
        k = int(np.argmax(used))
        share = float(used[k])
        found.append((share, f"the tool would need {share:.4g} times its speed at {t[k]:.3g} s"))
    share, words = max(found)
    return words if share > 1 else "a torque would exceed its limit"


def _smoothed(curve: Any, s: Array, own: Array, r: float, added: int) -> _OwnTimes:
    """Smooth s(t), at rest before and after, by convolution with a triangle of width r, in seconds.

    ``curve`` is q(s), and ``s`` (T,) are the values of s(t) at the times ``own`` (T,), s, linear in
    between. Smoothing makes the motion longer by r/2 at each end. At ``added`` of the two ends, it
    stays longer; for each other end, the whole motion is sped up to save r/2. With h = r/2, the
    smoothed acceleration is ``(s(t + h) − 2 s(t) + s(t − h)) / h²``, piecewise linear in t.
    """
    h = r / 2
    T = own[-1] + added * h
    own = own * ((T - r) / own[-1])  # begins at h and ends at T − h
    breaks = np.unique(np.concatenate([own, own + h, own + r]))
    breaks = breaks[np.concatenate([[True], np.diff(breaks) > 1e-12 * T])]
    breaks[[0, -1]] = 0.0, T

    def law(t: Array) -> Array:
        return np.interp(t - h, own, s)

    push = (law(breaks + h) - 2 * law(breaks) + law(breaks - h)) / h**2
    dt = np.diff(breaks)
    jerk = np.diff(push) / dt
    speed = _summed((push[1:] + push[:-1]) / 2 * dt)
    way = _summed(speed[:-1] * dt + push[:-1] * dt**2 / 2 + jerk * dt**3 / 6)
    from scipy.interpolate import PPoly

    smooth = PPoly(np.stack([jerk / 6, push[:-1] / 2, speed[:-1], way[:-1]]), breaks)
    t = own + h
    t[[0, -1]] = 0.0, T
    rate = np.maximum(smooth(t, 1), 0.0)
    return _OwnTimes(curve, smooth(t), rate, t, t, smooth)


def _summed(steps: Array) -> Array:
    """Compute the running sum of steps (T,), beginning with 0: (T + 1,)."""
    return np.concatenate([[0.0], np.cumsum(steps)])
