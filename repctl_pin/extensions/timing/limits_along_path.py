"""Limits of acceleration and torque along a joint path, as bounds on s̈ and ṡ².

s is the length of the joint path q(s), and ′ = d/ds, so that ``q̈ = q′ s̈ + q″ ṡ²``. A *strip* is
the set of points (s̈, x), with x = ṡ², that satisfy ``low ≤ along s̈ + across x ≤ high``: what one
joint allows at one of the K *stages*, points of the path at which the limits are imposed. n is the
number of joints.

``JointLimits`` are maximum joint speeds and accelerations (n,) and, if given, torques and jerks, as
numbers.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...base.arguments import Array
from ...motion.limits import JointLimits

_TOUCHING = 1e-9
"""Tolerance with which the bound of a limit counts as touched by what the others allow."""


def strips(
    limits: JointLimits, Q: Array, slope: Array, bend: Array
) -> tuple[Array, Array, Array, Array]:
    """Convert the limits of acceleration and torque to strips ``low ≤ along s̈ + across x ≤ high``.

    A strip is the set of points (s̈, x), with x = ṡ², that satisfy this inequality for one joint at
    one stage. Return (along, across, low, high), each (K, n). With limits of torque, each is
    (K, 2 n): the limits of acceleration of all joints, then those of torque. ``Q``, ``slope`` and
    ``bend`` (K, n) are q, q′ and q″ at the stages.
    """
    ones = np.ones_like(slope)
    kinds = [(slope / limits.acceleration, bend / limits.acceleration, -ones, ones)]
    effort = torques_along(limits, Q, slope, bend)
    if effort is not None and limits.torque is not None:
        turning, moving, still = (part / limits.torque for part in effort)
        kinds.append((turning, moving, -1 - still, 1 - still))
    along, across, low, high = (np.hstack(parts) for parts in zip(*kinds, strict=True))
    return along, across, low, high


def torques_along(
    limits: JointLimits, Q: Array, slope: Array, bend: Array
) -> tuple[Array, Array, Array] | None:
    """Compute a, b and g (K, n) of the torques ``τ = a s̈ + b ṡ² + g``, N m or N, along a path.

    ``Q``, ``slope`` and ``bend`` (K, n) are q, q′ and q″ at K points of the path. Return (a, b, g),
    or None without torque limits.
    """
    if limits.torque is None or limits.dynamics is None:
        return None
    rnea, still = limits.dynamics, np.zeros(Q.shape[1])
    g = np.array([rnea(q, still, still) for q in Q])
    a = np.array([rnea(q, still, v) for q, v in zip(Q, slope, strict=True)]) - g
    b = np.array([rnea(q, v, w) for q, v, w in zip(Q, slope, bend, strict=True)]) - g
    return a, b, g


def sides_that_bound(
    along: Array, across: Array, low: Array, high: Array, most: Array
) -> NDArray[np.bool_]:
    """Find the sides of strips ``low ≤ along u + across x ≤ high`` that bound their intersection.

    ``along``, ``across``, ``low`` and ``high`` are (K, n): n strips in the plane of (u, x) for each
    of K stages. There, x is from 0 to ``most`` (K,), and u is s̈ up to a factor. Return a mask
    (K, n, 2): True for a low side, ``[..., 0]``, or a high side, ``[..., 1]``, that touches the
    intersection of all strips of its stage. All other sides can be left out. All are False for a
    stage whose intersection is empty.
    """
    zero, one, top = np.zeros((len(low), 1)), np.ones((len(low), 1)), most[:, None]
    a, b, low, high = map(np.hstack, ((along, zero), (across, one), (low, zero), (high, top)))
    size = np.maximum(np.hypot(a, b), 1e-300)
    touches = np.zeros((*along.shape, 2), bool)
    for side, bound in enumerate((low, high)):
        for j in range(along.shape[1]):
            # A point of the side at τ is foot + τ way.
            n_u, n_x = a[:, [j]] / size[:, [j]], b[:, [j]] / size[:, [j]]
            foot = (a * n_u + b * n_x) * bound[:, [j]] / size[:, [j]]
            way = b * n_u - a * n_x
            first, last = _inside_strips(foot, way, low, high, size)
            touches[:, j, side] = first - last <= _TOUCHING * (1 + np.minimum(np.abs(last), 1e300))
    return touches & (size[:, :-1, None] > 1e-300)


def _inside_strips(
    foot: Array, way: Array, low: Array, high: Array, size: Array
) -> tuple[Array, Array]:
    """Find the part of a line that lies inside all n strips, one line for each of K stages.

    λ is the position on the line. Strip j bounds a quantity that is ``foot_j`` at λ = 0 and changes
    by ``way_j`` per unit of λ: ``low_j ≤ foot_j + λ way_j ≤ high_j``; all arguments are (K, n).
    ``size`` is the largest |way| that a line of any direction can have. A line counts as parallel
    to a strip if its |way| is below 1e-12 times ``size``; then ``foot`` decides whether all of the
    line or nothing lies inside the strip. Return the range of λ as (first, last), (K,) each; no
    part of the line lies inside all strips if first > last.
    """
    parallel = np.abs(way) < 1e-12 * size
    inside = (foot >= low - _TOUCHING) & (foot <= high + _TOUCHING)
    everywhere = np.where(parallel & inside, np.inf, -np.inf)
    safe = np.where(parallel, 1.0, way)
    ends = np.stack([(low - foot) / safe, (high - foot) / safe])
    first = np.where(parallel, -everywhere, ends.min(axis=0)).max(axis=1)
    return first, np.where(parallel, everywhere, ends.max(axis=0)).min(axis=1)
