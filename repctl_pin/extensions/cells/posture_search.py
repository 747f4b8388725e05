"""Search for the best configuration in the middle of a cell: one from which straight rays reach all
corners of the cell with large margins."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...arguments import Array, read_only, vector
from ...errors import InputError
from ...model.bodies import bodies_of
from ...motion.solve_ik import random_configurations
from ...redundancy.inverses import inverse_condition_number
from ...solvers import newton_rows
from ...strategies.strategy import Inverse
from .cell import Cell
from .kinematics import bases, placed
from .reference import SINGULAR, rays

_STARTS, _KEPT, _OFFERED = 128, 24, 4
_TESTED = 3
"""Maximum number of ends of rays with overlapping convex hulls, per configuration in the middle, at
which the bodies themselves are tested for collision."""

_STEP = 0.4
"""Longest Newton step of any joint, rad or m."""

_SINGULAR_MIDDLE = "the arm is at a singularity; move the cell, or turn it"
_ENOUGH, _ALIKE = 0.1, 0.02
"""Limit margin, rad or m, above which a larger margin is no longer an advantage; and difference of
margins below which two margins count as equal."""

_AS_QUICK = 1.2
"""Ratio of mean squared joint speeds up to which configurations count as equally fast; of these,
the nearest to the reference is chosen."""


def reached(
    cell: Cell, Q: Array, u: Array, *, push: float = 0.0, iterations: int = 60
) -> tuple[Array, Array]:
    """Solve the inverse kinematics of one pose from K configurations, by Newton's method with J⁺.

    Parameters
    ----------
    cell, Q
        The cell, and the initial configurations (K, n).
    u : (k,) array
        The pose, in coordinates of the cell.
    push
        Gain of a null-space motion that moves joints away from their limits.

    Returns
    -------
    Q : (K, n) array
        Final configurations.
    left : (K,) array
        Norm of the remaining task error, m and rad.
    """
    task = cell.task
    goal = cell.placements(np.tile(u, (len(Q), 1)))

    def correction(Q: Array, on: NDArray[np.intp]) -> Array:
        p, R, J = placed(task, Q)
        e = cell.errors(goal[0][on], goal[1][on], p, R)
        G, N, _ = bases(J, np.zeros((len(Q), task.n, task.r)))
        dQ = np.einsum("Knm,Km->Kn", G, e)
        if push:
            back = np.maximum(0.0, task.lower + 0.1 - Q) - np.maximum(
                0.0, Q - task.upper + 0.1
            )
            dQ += push * np.einsum("Knr,Klr,Kl->Kn", N, N, back)
        return dQ

    Q, _ = newton_rows(
        correction, Q, longest=_STEP, tolerance=0.0, iterations=iterations
    )
    p, R, _ = placed(task, Q)
    return Q, np.linalg.norm(cell.errors(*goal, p, R), axis=1)


def given(cell: Cell, posture: ArrayLike) -> Array:
    """Move a configuration that the user gives exactly to the middle of the cell; return it (n,).

    Raises
    ------
    InputError
        If the middle is not reached from it, or the result is singular or violates a limit.
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


def searched(desired: Inverse, cell: Cell, seed: int = 0) -> list[Candidate]:
    """Search for configurations in the middle of the cell; return the best four, the best first.

    If some candidates are free of collisions, the others are dropped. From each remaining one, the
    arm moves along straight rays to the corners of the cell. The order is: most corners reached, no
    collision, largest joint-limit margin (up to 0.1 rad or m), smallest joint speed. Among nearly
    equal ones, the first is the nearest to the task's reference configuration.

    Raises
    ------
    InputError
        If the middle is out of reach, reached only outside the joint limits, or only at
        singularities.
    """
    task, u = cell.task, np.zeros(cell.k)
    rng = np.random.default_rng(seed)
    starts = np.concatenate(
        [task.reference[None], random_configurations(task, _STARTS, rng)]
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
        best = int(
            np.argmax(np.where(there, cell.limit_margin(Q).min(axis=1), -np.inf))
        )
        joint = task.joint_names[int(np.argmin(task.limit_margin(Q[best])))]
        beyond = -task.limit_margin(Q[best]).min()
        raise InputError(
            f"the middle of the cell, {cell.where(u)}, is reached only outside the limits of "
            f"{joint!r}, {beyond:.3g} beyond them at best; move the cell, or turn it"
        )
    regular = inside & _regular(cell, Q)
    if not regular.any():
        raise InputError(
            f"in the middle of the cell, {cell.where(u)}, {_SINGULAR_MIDDLE}"
        )
    candidates = judged(desired, cell, _spread(Q[regular], _KEPT))
    for size in (0.3, 0.15, 0.07):
        q = chosen(candidates, task.reference).q
        N = bases(task.jacobian(q)[None], np.zeros((1, task.n, task.r)))[1][0]
        beside = q + size * np.concatenate([N.T, -N.T])
        Q, left = reached(cell, beside, u, iterations=8)
        good = (
            (left < 1e-9) & (cell.limit_margin(Q).min(axis=1) > 0) & _regular(cell, Q)
        )
        candidates += judged(desired, cell, Q[good]) if good.any() else []
    first = chosen(candidates, task.reference)
    candidates.sort(
        key=lambda c: (-c.share, c.body_distance < 0, -min(c.margin, _ENOUGH), c.speed)
    )
    return _apart([first, *(c for c in candidates if c is not first)], _OFFERED)


@dataclass(frozen=True, eq=False)
@read_only
class Candidate:
    """A configuration in the middle of a cell, and figures of the rays from there to the corners.

    Attributes
    ----------
    q : (n,) array
        The configuration.
    share : float
        Fraction of the corners that are reached.
    margin : float
        Minimum joint-limit margin on the rays that reach their corners, rad or m.
    body_distance : float
        Minimum body distance in the middle and at the corners reached, m.
    speed : float
        Mean squared joint speed per unit of task speed at the corners reached,
        ``mean ‖G_d E C‖_F²`` with E = ∂x/∂u and C = (EᵀE)^(−1/2).
    """

    q: Array
    share: float
    margin: float
    body_distance: float
    speed: float


def judged(desired: Inverse, cell: Cell, Q: Array) -> list[Candidate]:
    """Evaluate configurations Q (L, n) in the middle of a cell by rays to its corners.

    If some of them are free of collisions, those with collisions are left out.
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
        E, C = (
            cell.twists(U[good], R),
            np.tile(cell.speeds(corners), (len(Q), 1, 1))[good],
        )
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
    """Choose the best candidate.

    The criteria are, in this order: most corners reached; no collision, or the largest body
    distance if all collide; joint-limit margin up to 0.1; joint speed, within 20 % of the squared
    minimum; distance from the configuration ``reference`` (n,).
    """
    most = max(c.share for c in candidates)
    candidates = [c for c in candidates if c.share > most - 1e-9]
    farthest = max(c.body_distance for c in candidates)
    least = 0.0 if farthest >= 0 else farthest - _ALIKE
    candidates = [c for c in candidates if c.body_distance >= least]
    best = max(min(c.margin, _ENOUGH) for c in candidates)
    candidates = [c for c in candidates if min(c.margin, _ENOUGH) > best - _ALIKE]
    quick = _AS_QUICK * min(c.speed for c in candidates)
    return min(
        (c for c in candidates if c.speed <= quick),
        key=lambda c: np.linalg.norm(c.q - reference),
    )


def _unwound(cell: Cell, q: Array) -> Array:
    """Remove full turns from the revolute joints of a configuration q (n,).

    Each joint gets the value nearest to the task's reference, if that is inside its limits. If the
    pose would change, q is returned unchanged.
    """
    task = cell.task
    near = q - 2 * np.pi * np.rint((q - task.reference) / (2 * np.pi)) * task.revolute
    near = np.where((near > task.lower) & (near < task.upper), near, q)
    same = task.placement(near).isApprox(
        task.placement(q), 1e-9
    )  # a joint that drives others may turn them less
    return near if same else q


def _regular(cell: Cell, Q: Array) -> NDArray[np.bool_]:
    """Test which configurations Q (K, n) are far enough from a singularity to start rays: (K,)."""
    return inverse_condition_number(placed(cell.task, Q)[2]) > SINGULAR


def _apart(candidates: list[Candidate], count: int) -> list[Candidate]:
    """Return the first ``count`` candidates, without those close to an earlier one."""
    kept: list[Candidate] = []
    for c in candidates:
        if len(kept) < count and all(
            np.linalg.norm(c.q - other.q) > 0.3 for other in kept
        ):
            kept.append(c)
    return kept


def _spread(Q: Array, count: int) -> Array:
    """Return at most ``count`` rows of Q (K, n), each as far as possible from those before it.

    Rows closer than 0.05 to a selected one are left out.
    """
    kept = [0]
    distance = np.linalg.norm(Q - Q[0], axis=1)
    while len(kept) < min(count, len(Q)):
        at = int(np.argmax(distance))
        if distance[at] < 0.05:
            break
        kept.append(at)
        distance = np.minimum(distance, np.linalg.norm(Q - Q[at], axis=1))
    return Q[kept]
