"""Boxes of poses that grow from many middles at once, as far as J⁺ leads to all their corners."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...arguments import Array
from ...motion.solve_ik import random_configurations
from ...solvers import newton_rows
from .cell import Cell
from .kinematics import bases, placed
from .reference import SINGULAR

STEPS = 10
"""Number of sizes through which a box grows; the last one is its own."""

_LONGEST, _ITERATIONS, _REACHED = 0.4, 40, 1e-9
_NEAR = 0.3
"""Task error, as a share of a step, below which a step counts as made."""

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
    ends : (K, C, n) array
        Configurations at the corners and face centres of the box of that size.
    """

    p: Array
    Q: Array
    steps: NDArray[np.intp]
    margin: Array
    ends: Array

    def rows(
        self, which: NDArray[np.intp] | NDArray[np.bool_] | list[int] | slice
    ) -> Grown:
        """Select some of the middles."""
        return Grown(
            self.p[which],
            self.Q[which],
            self.steps[which],
            self.margin[which],
            self.ends[which],
        )

    def joined(self, other: Grown) -> Grown:
        """Join two sets of middles."""
        return Grown(
            np.concatenate([self.p, other.p]),
            np.concatenate([self.Q, other.Q]),
            np.concatenate([self.steps, other.steps]),
            np.concatenate([self.margin, other.margin]),
            np.concatenate([self.ends, other.ends]),
        )


def drawn(box: Cell, count: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Draw random configurations Q (K, n); return the positions p (K, 3) of the frame, and Q.

    Coordinates of the positions that the task does not command are those of the box.
    """
    task = box.task
    Q = random_configurations(task, count, rng)
    p = placed(task, Q)[0]
    still = np.setdiff1d(range(3), task.rows[: min(3, task.m)])
    p[:, still] = box.placement.translation[still]
    return p, Q


def grown(box: Cell, p: Array, Q: Array) -> Grown:
    """Let a box grow around positions p (K, 3), which are solved for from configurations Q (K, n).

    Positions that are not reached inside the joint limits are left out. J⁺ leads from each middle
    straight to all corners and face centres at once, by steps ``Δq = J⁺ (x_next − f(q))``. The box
    stops growing where one of them is not reached or is singular, or one joint leaves its limits.
    """
    task, n = box.task, box.task.n
    p, Q = _reached(box, p, Q)
    corners, R = box.placements(box.corners())
    offsets, C = corners - box.placement.translation, len(corners)
    near = _NEAR * np.linalg.norm(offsets, axis=1).max() / STEPS
    steps, margin = np.zeros(len(p), int), np.full(len(p), np.inf)
    ends = np.repeat(Q[:, None], C, axis=1)
    on, now = np.arange(len(p)), ends.reshape(-1, n)
    jumps = np.zeros(len(now), bool)
    for step in range(STEPS + 1):
        turns = np.tile(R, (len(on), 1, 1))
        p_now, R_now, J = placed(task, now)
        G, _, s = bases(J, np.zeros((len(now), n, task.r)))
        here, ahead = (
            box.errors(
                (p[on, None] + x / STEPS * offsets).reshape(-1, 3), turns, p_now, R_now
            )
            for x in (step, step + 1)
        )
        least = task.limit_margin(now).min(axis=1)
        good = (s[:, -1] > SINGULAR * s[:, 0]) & (least > 0) & ~jumps
        good &= np.linalg.norm(here, axis=1) < near
        together = good.reshape(-1, C).all(axis=1)
        rows = together.repeat(C)
        on, now = on[together], now[rows]
        if not len(on):
            break
        ends[on], steps[on] = now.reshape(-1, C, n), step
        margin[on] = np.minimum(margin[on], least[rows].reshape(-1, C).min(axis=1))
        dQ = np.einsum("Knm,Km->Kn", G[rows], ahead[rows])
        jumps = np.abs(dQ).max(axis=1) > _LONGEST
        now = now + dQ
    return Grown(p, Q, steps, margin, ends)


def _reached(box: Cell, p: Array, Q: Array) -> tuple[Array, Array]:
    """Solve for positions p (K, 3) in the orientation of a box, by Newton's method from Q (K, n).

    Return those that are reached inside the joint limits, and their configurations.
    """
    task = box.task
    R = np.broadcast_to(box.placement.rotation, (len(p), 3, 3))
    inner = _ROOM * np.minimum(1.0, task.upper - task.lower)

    def correction(Q: Array, on: NDArray[np.intp]) -> Array:
        p_now, R_now, J = placed(task, Q)
        e = box.errors(p[on], R[on], p_now, R_now)
        G, N, _ = bases(J, np.zeros((len(Q), task.n, task.r)))
        low = np.maximum(0.0, task.lower + inner - Q)
        back = low - np.maximum(0.0, Q - task.upper + inner)
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
