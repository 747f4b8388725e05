"""A motion in its own times, from rest to rest: its law of time smoothed just enough for the
limits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline, PPoly

from ..arguments import Array, read_only
from ..errors import InputError
from .profile import Limits, Segment, most_used

_LONGER = 1.5
"""Ratio of two smoothing times that are tried one after the other."""

_HALVINGS = 6
"""How often the way back to the last that was too short is halved."""

_SHORTEST = 1e-3
"""Shortest smoothing time, s."""

_KEPT = 1 + 1e-9
"""Limits count as kept up to this factor."""

_BETWEEN = np.array([0.0, 0.25, 0.5, 0.75, 1.0 - 1e-9])
"""Where limits are checked between two breaks of the law, as shares of the time."""


@dataclass(frozen=True, eq=False)
@read_only
class OwnTimes(Segment):
    """A smooth part of a joint path in its own times, from rest to rest.

    ``s(t)`` is the path's own law, at rest before and after, convolved with a triangle of width r:
    that rounds the beginning, the end and every jump of speed, never exceeds the law's own speed,
    and leaves it as it is r/2 away.

    Attributes
    ----------
    smooth : PPoly
        s(t).
    """

    smooth: Any

    def at(self, t: Array) -> Array:
        """Find s at times (T,) from the segment's start."""
        return np.clip(self.smooth(t), 0.0, self.s[-1])

    def law(self, t: Array) -> tuple[Array, Array, Array, Array]:
        """Evaluate s, ṡ, s̈ and s⃛ at times (T,) from the segment's start."""
        return self.at(t), self.smooth(t, 1), self.smooth(t, 2), self.smooth(t, 3)

    def excess(self, limits: Limits) -> float:
        """Leave the times as they are: the smoothing was chosen for the limits to hold."""
        return 1.0


def with_own_times(
    Q: Array, clock: Array, limits: Limits, *, added: int, most: float, joints: Sequence[str]
) -> OwnTimes:
    """Run a smooth joint path in its own times, smoothed over the shortest time that keeps the
    limits.

    Parameters
    ----------
    Q : (T, n) array
        The path.
    clock : (T,) array
        When each of its points is passed, s.
    limits
        Those to keep.
    added
        At how many of its two ends time may be added; at the others the law is run a little faster
        instead.
    most
        Longest smoothing time, s.
    joints
        Their names, for messages.

    Raises
    ------
    InputError
        If the motion's own times do not keep the limits.
    """
    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(Q, axis=0), axis=1))])
    curve = CubicSpline(s, Q, bc_type="not-a-knot")
    own = clock - clock[0]
    D = float(own[-1])
    fastest = curve(s, 1) * np.gradient(s, own)[:, None]
    r = float((np.abs(fastest[[0, -1]]) / limits.acceleration).max())
    if limits.jerk is not None:
        r = max(r, 2 * float(np.sqrt((np.abs(fastest[[0, -1]]) / limits.jerk).max())))
    most = min(most, D * (0.5 if added < 2 else 1.0))
    short, r, nearest, why = 0.0, min(max(r, _SHORTEST), most), np.inf, ""

    def tried(r: float) -> OwnTimes | None:
        nonlocal nearest, why
        segment = _smoothed(curve, s, own, r, added)
        t = segment.smooth.x
        t = (t[:-1, None] + np.diff(t)[:, None] * _BETWEEN).ravel()
        moved = segment.derivatives(t)
        used = most_used(limits, *moved)
        if used > _KEPT and used < nearest:
            nearest, why = used, _worst(limits, moved, t + float(clock[0]), joints)
        return segment if used <= _KEPT else None

    found = None
    while r <= most and (found := tried(r)) is None:
        short, r = r, r * _LONGER
    if found is None:
        raise InputError(
            f"the times of the path exceed the limits: {why}; "
            "give the path more time, or omit keep_times="
        )
    for _ in range(_HALVINGS if short else 0):
        between = (short + r) / 2
        if (shorter := tried(between)) is None:
            short = between
        else:
            r, found = between, shorter
    return found


def _worst(limits: Limits, moved: tuple[Array, ...], t: Array, joints: Sequence[str]) -> str:
    """Name the limit that is exceeded most, and when."""
    found = []
    for what, values, limit in zip(
        ("speed", "acceleration", "jerk"),
        moved[1:],
        (limits.velocity, limits.acceleration, limits.jerk),
        strict=True,
    ):
        if limit is not None:
            used = np.abs(values) / limit
            k, j = divmod(int(np.argmax(used)), used.shape[1])
            found.append(
                (
                    float(used[k, j]),
                    f"{joints[j]} would need {used[k, j]:.4g} times its {what} at {t[k]:.3g} s",
                )
            )
    if limits.tool is not None:
        used = limits.tool(moved[0], moved[1])
        k = int(np.argmax(used))
        found.append(
            (float(used[k]), f"the tool would need {used[k]:.4g} times its speed at {t[k]:.3g} s")
        )
    share, words = max(found)
    return words if share > 1 else "a torque would exceed its limit"


def _smoothed(curve: Any, s: Array, own: Array, r: float, added: int) -> OwnTimes:
    """Convolve the law (own, s), rest before and after, with a triangle of width r.

    ``s̈ = (s(t + h) − 2 s(t) + s(t − h)) / h²`` of the law itself, h = r/2: linear between its
    shifted points."""
    h, D = r / 2, own[-1]
    T = D + added * h
    own = own * ((T - r) / D)  # begins at h and ends at T − h
    breaks = np.unique(np.concatenate([own, own + h, own + r]))
    breaks = breaks[np.concatenate([[True], np.diff(breaks) > 1e-12 * T])]
    breaks[[0, -1]] = 0.0, T

    def law(t: Array) -> Array:
        return np.interp(t - h, own, s)

    push = (law(breaks + h) - 2 * law(breaks) + law(breaks - h)) / h**2
    dt = np.diff(breaks)
    jerk = np.diff(push) / dt
    speed = np.concatenate([[0.0], np.cumsum((push[1:] + push[:-1]) / 2 * dt)])
    way = np.concatenate(
        [[0.0], np.cumsum(speed[:-1] * dt + push[:-1] * dt**2 / 2 + jerk * dt**3 / 6)]
    )
    smooth = PPoly(np.stack([jerk / 6, push[:-1] / 2, speed[:-1], way[:-1]]), breaks)
    t = own + h
    t[[0, -1]] = 0.0, T
    rate = np.maximum(smooth(t, 1), 0.0)
    return OwnTimes(curve, smooth(t), rate, t, t, smooth)
