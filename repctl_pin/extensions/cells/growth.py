"""Boxes of poses that grow from many middles at once, as far as J⁺ leads to all their corners."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...arguments import Array
from ...solvers import newton_rows
from .cell import Cell
from .kinematics import bases, placed
from .reference import SINGULAR

STEPS = 10
"""Number of sizes through which a box grows; the last one is its own."""

_LONGEST, _ITERATIONS, _REACHED = 0.4, 40, 1e-9
_PUSH, _ROOM = 0.3, 0.1
"""Gain of the null-space motion away from the joint limits, and margin at which it begins: rad, m,
or the share of the joint's range if that is less."""


class Grown(NamedTuple):
    """K middles of a box, and how far the box grows around each.

    Attributes
    ----------
    p, Q : (K, 3) and (K, n) arrays
        Positions of the middles, m, and configurations there.
    steps : (K,) array
        Number of steps by which the box grew; :data:`STEPS` is its own size.
    margin : (K,) array
        Smallest limit margin on the ways to its corners, rad or m.
    swing : (K,) array
        Largest joint motion from the middle to a corner, rad or m.
    """

    p: Array
    Q: Array
    steps: NDArray[np.intp]
    margin: Array
    swing: Array

    def rows(self, which: NDArray[np.intp] | NDArray[np.bool_] | slice) -> Grown:
        """Select some of the middles."""
        return Grown(*(part[which] for part in self))

    def joined(self, other: Grown) -> Grown:
        """Join two sets of middles."""
        return Grown(*map(np.concatenate, zip(self, other, strict=True)))


def grown(box: Cell, p: Array, Q: Array) -> Grown:
    """Let a box grow around positions p (K, 3), which are solved for from configurations Q (K, n).

    Positions that are not reached inside the joint limits are left out. J⁺ leads from each middle
    straight to all corners at once, by steps ``Δq = J⁺ (x_next − f(q))``. The box stops growing
    where one corner meets a singularity, or one joint a limit.
    """
    task, n = box.task, box.task.n
    p, Q = _reached(box, p, Q)
    corners, R = box.placements(box.corners())
    offsets, C = corners - box.placement.translation, len(corners)
    steps = np.zeros(len(p), int)
    margin = task.limit_margin(Q).min(axis=1)
    ends = np.repeat(Q[:, None], C, axis=1)
    on = np.arange(len(p))
    for step in range(1, STEPS + 1):
        now = ends[on].reshape(-1, n)
        goals = p[on, None] + step / STEPS * offsets
        p_now, R_now, J = placed(task, now)
        G, _, s = bases(J, np.zeros((len(now), n, task.r)))
        turns = np.tile(R, (len(on), 1, 1))
        error = box.errors(goals.reshape(-1, 3), turns, p_now, R_now)
        dQ = np.einsum("Knm,Km->Kn", G, error)
        least = task.limit_margin(now + dQ).min(axis=1)
        regular = s[:, -1] > SINGULAR * s[:, 0]
        good = regular & (np.abs(dQ).max(axis=1) < _LONGEST) & (least > 0)
        together = good.reshape(-1, C).all(axis=1)
        on = on[together]
        if not len(on):
            break
        ends[on] = (now + dQ).reshape(-1, C, n)[together]
        margin[on] = np.minimum(margin[on], least.reshape(-1, C)[together].min(axis=1))
        steps[on] = step
    swing = np.abs(ends - Q[:, None]).max(axis=(1, 2), initial=0.0)
    return Grown(p, Q, steps, margin, swing)


def _reached(box: Cell, p: Array, Q: Array) -> tuple[Array, Array]:
    """Solve for positions p (K, 3) in the orientation of a box, by Newton's method from Q (K, n).

    Return those that are reached inside the joint limits, and their configurations.
    """
    task = box.task
    R = np.broadcast_to(box.placement.rotation, (len(p), 3, 3))
    room = _ROOM * np.minimum(1.0, task.upper - task.lower)

    def correction(Q: Array, on: NDArray[np.intp]) -> Array:
        p_now, R_now, J = placed(task, Q)
        e = box.errors(p[on], R[on], p_now, R_now)
        G, N, _ = bases(J, np.zeros((len(Q), task.n, task.r)))
        low = np.maximum(0.0, task.lower + room - Q)
        back = low - np.maximum(0.0, Q - task.upper + room)
        free = np.einsum("Knr,Klr,Kl->Kn", N, N, back)
        return np.asarray(np.einsum("Knm,Km->Kn", G, e) + _PUSH * free)

    Q, _ = newton_rows(
        correction,
        Q,
        longest=_LONGEST,
        tolerance=_REACHED / 10,
        iterations=_ITERATIONS,
    )
    p_now, R_now, _ = placed(task, Q)
    left = np.linalg.norm(box.errors(p, R, p_now, R_now), axis=1)
    inside = (left < _REACHED) & (task.limit_margin(Q).min(axis=1) > 0)
    return p[inside], Q[inside]
