"""The posture in the middle of a cell: the self-motion there, elbow up and elbow down, searched for
the most room."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arguments import Array, vector
from ..errors import InputError
from ..redundancy.inverses import inverse_condition_number
from ..robot.bodies import bodies_of
from ..strategies.strategy import Batched
from .cell import Cell
from .kinematics import bases, bounded, placed
from .reference import SINGULAR, rays

_STARTS, _KEPT, _OFFERED = 128, 24, 6
_SINGULAR_MIDDLE = "the arm is at a singularity; move the cell, or turn it"
_ENOUGH, _ALIKE = 0.1, 0.02
"""A limit margin, rad or m, beyond which more room is worth less than speed; and margins that count
as alike."""

_AS_QUICK = 1.2
"""Mean squares of joint speed that count as alike; of those the posture nearest to the reference is
taken."""


def reached(
    cell: Cell, Q: Array, u: Array, *, push: float = 0.0, iterations: int = 60
) -> tuple[Array, Array]:
    """Bring configurations Q (K, n) to one pose of a cell by Newton's method with J⁺, joint limits
    aside.

    Parameters
    ----------
    cell, Q
        The cell, and where to start.
    u : (k,) array
        The pose.
    push
        How strongly joints beyond their limits are pushed back along the null space.

    Returns
    -------
    Q : (K, n) array
    left : (K,) array
        The task error that is left, m and rad.
    """
    task, Q = cell.task, Q.copy()
    goal = cell.placements(np.tile(u, (len(Q), 1)))
    for _ in range(iterations):
        p, R, J = placed(task, Q)
        e = cell.errors(*goal, p, R)
        G, N, _ = bases(J, np.zeros((len(Q), task.n, task.r)))
        dQ = np.einsum("Knm,Km->Kn", G, e)
        if push:
            back = np.maximum(0.0, task.lower + 0.1 - Q) - np.maximum(0.0, Q - task.upper + 0.1)
            dQ += push * np.einsum("Knr,Klr,Kl->Kn", N, N, back)
        Q += bounded(dQ, 0.4)
    p, R, _ = placed(task, Q)
    return Q, np.linalg.norm(cell.errors(*goal, p, R), axis=1)


def given(cell: Cell, posture: ArrayLike) -> Array:
    """Take a posture that a person gave, brought exactly to the middle of the cell.

    Raises
    ------
    InputError
        If it does not lead there, or not within the limits.
    """
    task, u = cell.task, np.zeros(cell.k)
    q = vector(posture, task.n, "the posture")
    Q, left = reached(cell, q[None], u)
    if left[0] > 1e-9:
        raise InputError(
            f"does not lead to the middle of the cell, {cell.where(u)}",
            argument="posture",
            remedy="omit it",
        )
    if not _regular(cell, Q)[0]:
        raise InputError(
            f": brought to {cell.where(u)}, {_SINGULAR_MIDDLE}",
            argument="posture",
            remedy="choose another",
        )
    return task.check(Q[0], f"the posture, brought to {cell.where(u)},")


def searched(desired: Batched, cell: Cell, seed: int = 0) -> Array:
    """Find postures (K, n) in the middle from which the cell is reached with the most room, the
    best first.

    Every candidate drives the arm along rays to the corners of the cell. Those that reach most
    corners count, of them those whose bodies do not touch, with the largest joint-limit margin (up
    to 0.1 rad), and of them the quickest, near the reference.

    Raises
    ------
    InputError
        If the middle is out of reach, or only within reach outside the joint limits.
    """
    task, u = cell.task, np.zeros(cell.k)
    rng = np.random.default_rng(seed)
    low = np.where(np.isfinite(task.lower), task.lower, task.reference - np.pi)
    high = np.where(np.isfinite(task.upper), task.upper, task.reference + np.pi)
    starts = np.concatenate(
        [task.reference[None], low + (high - low) * rng.random((_STARTS, task.n))]
    )
    Q, left = reached(cell, starts, u, push=0.3)
    Q = np.array([_unwound(cell, q) for q in Q])
    there = left < 1e-9
    if not there.any():
        raise InputError(
            f"the middle of the cell, {cell.where(u)}, is out of reach: {task.frame!r} stays "
            f"{left.min():.3g} m or rad short of it; move the cell nearer"
        )
    inside = there & (task.limit_margin(Q).min(axis=1) > 0)
    if not inside.any():
        best = int(np.argmax(np.where(there, task.limit_margin(Q).min(axis=1), -np.inf)))
        joint = task.joint_names[int(np.argmin(task.limit_margin(Q[best])))]
        raise InputError(
            f"the middle of the cell, {cell.where(u)}, is reached only outside the limits of {joint!r}, "
            f"{-task.limit_margin(Q[best]).min():.3g} beyond them at best; move the cell, or turn it"
        )
    regular = inside & _regular(cell, Q)
    if not regular.any():
        raise InputError(f"in the middle of the cell, {cell.where(u)}, {_SINGULAR_MIDDLE}")
    candidates = [judged(desired, cell, q) for q in _spread(Q[regular], _KEPT)]
    for size in (0.3, 0.15, 0.07):
        q = chosen(candidates, task.reference).q
        N = bases(task.jacobian(q)[None], np.zeros((1, task.n, task.r)))[1][0]
        beside = q + size * np.concatenate([N.T, -N.T])
        Q, left = reached(cell, beside, u, iterations=8)
        good = (left < 1e-9) & (task.limit_margin(Q).min(axis=1) > 0) & _regular(cell, Q)
        candidates += [judged(desired, cell, q) for q in Q[good]]
    first = chosen(candidates, task.reference)
    candidates.sort(key=lambda c: (-c.share, c.apart < 0, -min(c.margin, _ENOUGH), c.speed))
    return _apart(np.array([first.q, *(c.q for c in candidates if c is not first)]), _OFFERED)


@dataclass(frozen=True)
class Candidate:
    """A posture in the middle, and what the rays from there have shown.

    Attributes
    ----------
    q : (n,) array
    share : float
        Of the corners reached.
    margin : float
        The least joint-limit margin on the rays, rad or m.
    apart : float
        The least distance between bodies in the middle and at the ends of the rays, m.
    speed : float
        ``mean ‖G_d E C‖²`` at the ends of the rays.
    """

    q: Array
    share: float
    margin: float
    apart: float
    speed: float


def judged(desired: Batched, cell: Cell, q: Array) -> Candidate:
    """Drive the arm to the corners of the cell from a posture."""
    U = cell.corners()
    ends = rays(desired, cell, q, U, steps=10)
    good = ends.reached == 1
    speed = np.inf
    if good.any():
        _, R, J = placed(cell.task, ends.Q[good])
        G = desired.batch(ends.Q[good], J)
        speed = float(
            ((G @ cell.twists(U[good], R) @ cell.speeds(U[good])) ** 2).sum() / good.sum()
        )
    apart = bodies_of(cell.task).distances(np.concatenate([q[None], ends.Q[good]])).min()
    return Candidate(
        q, float(good.mean()), float(ends.least[good].min(initial=np.inf)), float(apart), speed
    )


def chosen(candidates: list[Candidate], reference: Array) -> Candidate:
    """Choose by share, then bodies that do not touch, then margin, speed, and the distance from a
    reference."""
    most = max(c.share for c in candidates)
    candidates = [c for c in candidates if c.share > most - 1e-9]
    candidates = [c for c in candidates if c.apart >= 0] or candidates
    best = max(min(c.margin, _ENOUGH) for c in candidates)
    candidates = [c for c in candidates if min(c.margin, _ENOUGH) > best - _ALIKE]
    quick = _AS_QUICK * min(c.speed for c in candidates)
    return min(
        (c for c in candidates if c.speed <= quick), key=lambda c: np.linalg.norm(c.q - reference)
    )


def _unwound(cell: Cell, q: Array) -> Array:
    """Take whole turns out of revolute joints: the values nearest to the reference, where limits
    allow them."""
    task = cell.task
    near = q - 2 * np.pi * np.rint((q - task.reference) / (2 * np.pi)) * task.revolute
    near = np.where((near > task.lower) & (near < task.upper), near, q)
    same = task.placement(near).isApprox(
        task.placement(q), 1e-9
    )  # a joint that drives others may turn them less
    return near if same else q


def _regular(cell: Cell, Q: Array) -> NDArray[np.bool_]:
    """Say which configurations (K, n) are far enough from a singularity to begin at."""
    return inverse_condition_number(placed(cell.task, Q)[2]) > SINGULAR


def _apart(Q: Array, count: int) -> Array:
    """Take the first rows of Q that differ from those before them."""
    kept: list[Array] = []
    for q in Q:
        if len(kept) < count and all(np.linalg.norm(q - other) > 0.3 for other in kept):
            kept.append(q)
    return np.array(kept)


def _spread(Q: Array, count: int) -> Array:
    """Choose at most so many of the rows of Q, each as far from those before it as can be."""
    kept = [0]
    distance = np.linalg.norm(Q - Q[0], axis=1)
    while len(kept) < min(count, len(Q)):
        at = int(np.argmax(distance))
        if distance[at] < 0.05:
            break
        kept.append(at)
        distance = np.minimum(distance, np.linalg.norm(Q - Q[at], axis=1))
    return Q[kept]
