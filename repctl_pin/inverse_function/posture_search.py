"""Search for the configuration in the middle of a cell from which the cell is reached with the
largest margins."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arguments import Array, read_only, vector
from ..errors import InputError
from ..redundancy.inverses import inverse_condition_number
from ..robot.bodies import bodies_of
from ..solvers import newton_rows
from ..strategies.strategy import Batched
from .cell import Cell
from .kinematics import bases, placed
from .reference import SINGULAR, rays

_STARTS, _KEPT, _OFFERED = 128, 24, 6
_TESTED = 3
"""Ends of rays with overlapping hulls at which the bodies themselves are tested."""

_STEP = 0.4
"""Longest Newton step of any joint, rad or m."""

_SINGULAR_MIDDLE = "the arm is at a singularity; move the cell, or turn it"
_ENOUGH, _ALIKE = 0.1, 0.02
"""Limit margin, rad or m, above which speed counts more; and differences of margins that count as
none."""

_AS_QUICK = 1.2
"""Ratio of mean squared joint speeds that counts as 1; of those the configuration nearest to the
reference is taken."""


def reached(
    cell: Cell, Q: Array, u: Array, *, push: float = 0.0, iterations: int = 60
) -> tuple[Array, Array]:
    """Bring configurations Q (K, n) to one pose of a cell by Newton's method with J⁺.

    Parameters
    ----------
    cell, Q
        The cell, and the initial configurations.
    u : (k,) array
        The pose.
    push
        Gain with which joints beyond their limits are pushed back along the null space.

    Returns
    -------
    Q : (K, n) array
    left : (K,) array
        Remaining task error, m and rad.
    """
    task = cell.task
    goal = cell.placements(np.tile(u, (len(Q), 1)))

    def correction(Q: Array, on: NDArray[np.intp]) -> Array:
        p, R, J = placed(task, Q)
        e = cell.errors(goal[0][on], goal[1][on], p, R)
        G, N, _ = bases(J, np.zeros((len(Q), task.n, task.r)))
        dQ = np.einsum("Knm,Km->Kn", G, e)
        if push:
            back = np.maximum(0.0, task.lower + 0.1 - Q) - np.maximum(0.0, Q - task.upper + 0.1)
            dQ += push * np.einsum("Knr,Klr,Kl->Kn", N, N, back)
        return dQ

    Q, _ = newton_rows(correction, Q, longest=_STEP, tolerance=0.0, iterations=iterations)
    p, R, _ = placed(task, Q)
    return Q, np.linalg.norm(cell.errors(*goal, p, R), axis=1)


def given(cell: Cell, posture: ArrayLike) -> Array:
    """Bring a configuration given by the user exactly to the middle of the cell.

    Raises
    ------
    InputError
        If that fails, or violates a limit.
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


def searched(desired: Batched, cell: Cell, seed: int = 0) -> list[Candidate]:
    """Find configurations in the middle from which the cell is reached, the best first.

    If bodies are apart at some candidates, those where bodies collide are dropped. From each other
    one the arm moves along rays to the corners of the cell. The order is: most corners reached, no
    collision, largest joint-limit margin (up to 0.1 rad), smallest joint speed, nearest to the
    reference.

    Raises
    ------
    InputError
        If the middle is out of reach, or only reached outside the joint limits.
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
    inside = there & (cell.limit_margin(Q).min(axis=1) > 0)
    if not inside.any():
        best = int(np.argmax(np.where(there, cell.limit_margin(Q).min(axis=1), -np.inf)))
        joint = task.joint_names[int(np.argmin(task.limit_margin(Q[best])))]
        beyond = -task.limit_margin(Q[best]).min()
        raise InputError(
            f"the middle of the cell, {cell.where(u)}, is reached only outside the limits of "
            f"{joint!r}, {beyond:.3g} beyond them at best; move the cell, or turn it"
        )
    regular = inside & _regular(cell, Q)
    if not regular.any():
        raise InputError(f"in the middle of the cell, {cell.where(u)}, {_SINGULAR_MIDDLE}")
    candidates = judged(desired, cell, _spread(Q[regular], _KEPT))
    for size in (0.3, 0.15, 0.07):
        q = chosen(candidates, task.reference).q
        N = bases(task.jacobian(q)[None], np.zeros((1, task.n, task.r)))[1][0]
        beside = q + size * np.concatenate([N.T, -N.T])
        Q, left = reached(cell, beside, u, iterations=8)
        good = (left < 1e-9) & (cell.limit_margin(Q).min(axis=1) > 0) & _regular(cell, Q)
        candidates += judged(desired, cell, Q[good]) if good.any() else []
    first = chosen(candidates, task.reference)
    candidates.sort(key=lambda c: (-c.share, c.body_distance < 0, -min(c.margin, _ENOUGH), c.speed))
    return _apart([first, *(c for c in candidates if c is not first)], _OFFERED)


@dataclass(frozen=True, eq=False)
@read_only
class Candidate:
    """A configuration in the middle, and figures of the rays from it.

    Attributes
    ----------
    q : (n,) array
    share : float
        Share of the corners reached.
    margin : float
        Minimum joint-limit margin on the rays, rad or m.
    body_distance : float
        Minimum body distance in the middle and at the ends of the rays, m.
    speed : float
        ``mean ‖G_d E C‖²`` at the ends of the rays.
    """

    q: Array
    share: float
    margin: float
    body_distance: float
    speed: float


def judged(desired: Batched, cell: Cell, Q: Array) -> list[Candidate]:
    """Evaluate configurations (L, n) in the middle by rays to the corners of the cell.

    If bodies are apart at some of them, those where bodies collide are left out.
    """
    bodies, corners = bodies_of(cell.task), cell.corners()
    middle = bodies.distances(Q)
    separate = (middle >= 0) | (middle < 0).all()
    Q, middle, K = Q[separate], middle[separate], len(corners)
    U = np.tile(corners, (len(Q), 1))
    ends = rays(desired, cell, np.repeat(Q, K, axis=0), U, steps=10)
    good = ends.reached == 1
    speeds, nearest = np.full(len(U), np.nan), np.full(len(U), np.inf)
    if good.any():
        _, R, J = placed(cell.task, ends.Q[good])
        E, C = cell.twists(U[good], R), np.tile(cell.speeds(corners), (len(Q), 1, 1))[good]
        speeds[good] = ((desired.batch(ends.Q[good], J) @ E @ C) ** 2).sum(axis=(1, 2))
        nearest[good] = bodies.hull_distances(ends.Q[good])
    for i, at in enumerate(_parts(len(Q), K)):
        overlap = at.start + np.flatnonzero(nearest[at] < 0)
        if len(overlap):
            some = overlap[np.argsort(nearest[overlap])[:_TESTED]]
            nearest[overlap] = bodies.distances(ends.Q[some]).min()
        middle[i] = min(middle[i], nearest[at].min())
    return [
        Candidate(
            q,
            float(good[at].mean()),
            float(ends.least[at][good[at]].min(initial=np.inf)),
            float(distance),
            float(speeds[at][good[at]].mean()) if good[at].any() else np.inf,
        )
        for q, distance, at in zip(Q, middle, _parts(len(Q), K), strict=True)
    ]


def _parts(count: int, length: int) -> list[slice]:
    return [slice(i * length, (i + 1) * length) for i in range(count)]


def chosen(candidates: list[Candidate], reference: Array) -> Candidate:
    """Select by share, then no collision or the shallowest, margin, speed, distance from a
    reference."""
    most = max(c.share for c in candidates)
    candidates = [c for c in candidates if c.share > most - 1e-9]
    farthest = max(c.body_distance for c in candidates)
    least = 0.0 if farthest >= 0 else farthest - _ALIKE
    candidates = [c for c in candidates if c.body_distance >= least]
    best = max(min(c.margin, _ENOUGH) for c in candidates)
    candidates = [c for c in candidates if min(c.margin, _ENOUGH) > best - _ALIKE]
    quick = _AS_QUICK * min(c.speed for c in candidates)
    return min(
        (c for c in candidates if c.speed <= quick), key=lambda c: np.linalg.norm(c.q - reference)
    )


def _unwound(cell: Cell, q: Array) -> Array:
    """Remove whole turns from revolute joints: take the values nearest to the reference that limits
    allow."""
    task = cell.task
    near = q - 2 * np.pi * np.rint((q - task.reference) / (2 * np.pi)) * task.revolute
    near = np.where((near > task.lower) & (near < task.upper), near, q)
    same = task.placement(near).isApprox(
        task.placement(q), 1e-9
    )  # a joint that drives others may turn them less
    return near if same else q


def _regular(cell: Cell, Q: Array) -> NDArray[np.bool_]:
    """Whether each configuration (K, n) is far enough from a singularity to start at."""
    return inverse_condition_number(placed(cell.task, Q)[2]) > SINGULAR


def _apart(candidates: list[Candidate], count: int) -> list[Candidate]:
    """Select the first ``count`` candidates that differ from those before them."""
    kept: list[Candidate] = []
    for c in candidates:
        if len(kept) < count and all(np.linalg.norm(c.q - other.q) > 0.3 for other in kept):
            kept.append(c)
    return kept


def _spread(Q: Array, count: int) -> Array:
    """Select at most ``count`` rows of Q, each as far as possible from those before it."""
    kept = [0]
    distance = np.linalg.norm(Q - Q[0], axis=1)
    while len(kept) < min(count, len(Q)):
        at = int(np.argmax(distance))
        if distance[at] < 0.05:
            break
        kept.append(at)
        distance = np.minimum(distance, np.linalg.norm(Q - Q[at], axis=1))
    return Q[kept]
