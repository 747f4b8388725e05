"""Self-motion to another leaf: the frame stays at rest, the joints stay within their limits.

A leaf is the set h(q) = c on which a repeatable inverse keeps the arm. On another leaf, the same
pose of the frame has another elbow position.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ...base.arguments import Array
from ...base.errors import InputError
from ...motion.limits import JointLimits
from ...strategies.repeatable import RepeatableInverse

_PIECE = 0.1
"""Maximum motion of a joint per call, from rest to rest, rad or m; a stop takes effect after it."""

_PEAKS = (1.875, 5.774, 60.0)
"""Maximum absolute first, second and third derivative of 10s³ − 15s⁴ + 6s⁵ on 0 ≤ s ≤ 1."""

_STEPS, _EXACT = 6, 1e-9
"""Maximum number of Newton steps per sample, and length of a step, rad or m, below which it is the
last; the error is of the order of its square."""

_ALLOWED = 0.98
"""Fraction of the limits that the motion is planned to use."""


def leaf_change(
    inverse: RepeatableInverse, q: ArrayLike, leaf: ArrayLike, limits: JointLimits, dt: float
) -> Array:
    """Sample a self-motion towards another leaf: f(q) constant, h(q) on a straight line to c.

    The frame rests at f(q) while the potentials h move to the level c, so that the elbow goes to
    another place. The motion goes from rest to rest, and the differences of its samples divided by
    dt, dt² and dt³ keep the limits. No joint moves by more than 0.1 rad (m): call it again until
    the leaf is reached. The last sample is repeated, three in all, so that the arm is at rest for
    the next motion.

    Parameters
    ----------
    inverse
        The repeatable inverse, with h; if it has a region Ω, the motion stays inside.
    q : (n,) array
        Start, at rest.
    leaf : (r,) array
        Level c of the other leaf.
    limits
        Limits of speed, acceleration and, if given, jerk.
    dt
        Time step, s.

    Returns
    -------
    (T, n) array
        Samples at the time steps, beginning with the one after q.

    Raises
    ------
    InputError
        If a sample has no solution, or lies outside a joint limit or Ω.
    SingularityError
        If J_V is singular on the way.
    """
    q = np.asarray(q, float)
    begin, place = inverse.leaf(q), inverse.task.placement(q)
    way = np.asarray(leaf, float) - begin
    end = inverse.solve(place, q, leaf=begin + way)
    while (travel := np.abs(end - q)).max() > _PIECE:
        way = way / 2
        end = inverse.solve(place, q, leaf=begin + way)
    ticks = _least_ticks(travel, limits, dt)
    while True:
        Q, s = np.tile(q, (ticks + 1, 1)), np.arange(ticks + 1) / ticks
        sigma = s**3 * (10 - 15 * s + 6 * s**2)
        for k in range(1, ticks + 1):
            Q[k] = _refined(inverse, place, Q[k - 1], begin + sigma[k] * way)
        share = _share_used(Q, limits, dt)
        if share <= 1:
            break
        ticks = max(ticks + 1, int(ticks * min(share, 2.0)))
    _check(inverse, Q)
    return np.vstack([Q[1:], Q[-1], Q[-1]])  # all differences are 0 when the next motion begins


def _refined(inverse: RepeatableInverse, place: pin.SE3, q: Array, leaf: Array) -> Array:
    """Solve for the next sample by Newton's method, from the previous one q (n,).

    The sample has the frame at ``place`` and the level ``leaf`` (r,). InputError is raised if six
    steps do not reach it.
    """
    for _ in range(_STEPS):
        last, q = q, inverse.step(q, place, 1.0, leaf=leaf)
        if np.abs(q - last).max() <= _EXACT:
            return q
    raise InputError(
        "no continuous motion to the leaf was found; choose a level nearer to the present one"
    )


def _least_ticks(travel: Array, limits: JointLimits, dt: float) -> int:
    """Compute the number of time steps in which a quintic over ``travel`` (n,) keeps the limits.

    A quintic goes from rest to rest without a jump of acceleration. As the self-motion is no
    straight line, this number is a first guess, at least 4.
    """
    bounds = (limits.velocity, limits.acceleration, limits.jerk)
    times = [
        float(np.max(peak * travel / (_ALLOWED * most)) ** (1 / k))
        for k, (peak, most) in enumerate(zip(_PEAKS, bounds, strict=True), 1)
        if most is not None
    ]
    return max(int(np.ceil(max(times) / dt)), 4)


def _share_used(Q: Array, limits: JointLimits, dt: float) -> float:
    """Evaluate the largest fraction of a limit that samples Q (T, n) use, with rest at both ends.

    Above 1, the motion needs more time steps.
    """
    Q = np.concatenate([np.tile(Q[0], (3, 1)), Q, np.tile(Q[-1], (3, 1))])
    bounds = (limits.velocity, limits.acceleration, limits.jerk)
    return max(
        float((np.abs(np.diff(Q, k, axis=0)) / dt**k / most).max())
        for k, most in enumerate(bounds, 1)
        if most is not None
    )


def _check(inverse: RepeatableInverse, Q: Array) -> None:
    """Raise InputError if a sample of Q (T, n) is outside a joint limit or Ω, the region."""
    margin = inverse.task.limit_margin(Q)
    if margin.min() < 0:
        joint = inverse.task.joint_names[int(np.argmin(margin.min(axis=0)))]
        raise InputError(
            f"the motion to the leaf would leave the limits of {joint!r}",
            remedy="choose a level nearer to the present one",
        )
    if inverse.region is not None and not inverse.region.ratio(Q).max() <= 1 + 1e-9:
        raise InputError(
            "the motion to the leaf would leave Ω",
            remedy="choose a level nearer to the present one",
        )
