"""Search for the best configuration in the middle of a cell, from which a function is designed.

A cell is a box of poses. A ray is the motion of the arm, by the desired inverse G_d (such as J⁺),
along the straight line from the middle of the cell to a corner; face centres count as corners, see
:meth:`Cell.corners`. From the best configuration, the rays reach all corners with large margins.
Letters: n joints, K configurations or rays.

``Candidate`` is a configuration in the middle of a cell, with the share of corners that rays from
there reach, and its margins. ``Rays`` are the results of following K straight rays from the middle
of a cell: end poses, last configurations, fraction followed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ....base.arguments import Array, read_only, vector
from ....base.errors import InputError, RepctlError
from ....model.bodies import Bodies, bodies_of
from ....model.native_kinematics import placed
from ....model.task import unit_of
from ....motion import solve_ik
from ....motion.solve_ik import random_configurations
from ....redundancy.inverses import inverse_condition_number
from ....strategies import Pseudoinverse
from ....strategies.strategy import Inverse
from ....studies.problem import Problem
from ..evaluate.reach import EXACT, SINGULAR, Rays, rays, reached, unlike_rows
from ..evaluate.symmetric_coordinates import reduced
from ..geometry.cell import Cell
from ..geometry.kinematics import bases

_STARTS, _KEPT, _OFFERED = 128, 24, 4
_TESTED = 3
"""Maximum number of ends of rays with overlapping convex hulls, per configuration in the middle, at
which the bodies themselves are tested for collision."""

_APART = 0.3
"""Minimum distance, in joint space, between two configurations that are offered."""

_SINGULAR_MIDDLE = "the arm is at a singularity; move the cell, or turn it"
_ENOUGH, _ALIKE = 0.1, 0.02
"""Limit margin, rad or m, above which a larger margin is no longer an advantage; and difference of
margins below which two margins count as equal."""

_AS_QUICK = 1.2
"""Ratio of mean squared joint speeds up to which configurations count as equally fast; of these,
the nearest to the reference is chosen."""


def _in_the_middle(cell: Cell, Q: Array, *, inward: bool = False) -> tuple[Array, Array]:
    """Move configurations Q (K, n), of any poses, to the middle of a cell by inverse kinematics.

    Return the new configurations (K, n), rad or m, and the norms of the task errors that remain
    (K,), m and rad. With ``inward``, joints also move away from their limits along their
    self-motions.
    """
    return reached(cell, *cell.placements(np.zeros((len(Q), cell.k))), Q, inward=inward)


def given(cell: Cell, posture: ArrayLike) -> Array:
    """Move the user's configuration (n,) exactly to the middle of the cell; return the result.

    A design begins at the result.

    Raises
    ------
    InputError
        If the middle is not reached from there, or the result is singular or violates a limit.
    """
    task, where = cell.task, cell.where(np.zeros(cell.k))
    q = vector(posture, task.n, "the posture")
    Q, left = _in_the_middle(cell, q[None])
    if left[0] > EXACT:
        raise InputError(
            f"does not lead to the middle of the cell, {where}: inverse kinematics from it ends "
            f"{left[0]:.2g} m or rad away",
            argument="posture",
            remedy="choose a posture nearer to that pose, or omit it",
        )
    if not _regular(cell, Q)[0]:
        raise InputError(
            f": brought to {where}, {_SINGULAR_MIDDLE}",
            argument="posture",
            remedy="or choose another posture",
        )
    return task.check(Q[0], f"the posture, brought to {where},")


def searched(desired: Inverse, cell: Cell, seed: int = 0) -> list[Candidate]:
    """Search for configurations in the middle of the cell; return up to four, the best first.

    A design tries the configurations in this order. The norm of the difference of any two of them
    is above 0.3 (rad and m). The candidates come in groups: configurations found by inverse
    kinematics, then, three times, configurations near the best candidate so far. In each group,
    candidates with a collision in the middle are dropped, unless all have one. From each remaining
    candidate, the arm moves along rays to the corners.

    The criteria of the order are, one after the other: most corners reached, no collision in the
    middle and at these corners, largest joint-limit margin (above 0.1 rad or m counts as 0.1),
    smallest joint speed. The first configuration is an exception: among the candidates that are
    nearly equal to the best one, it is the nearest to the task's reference configuration, see
    :func:`chosen`. ``seed`` is the random seed of the starts of inverse kinematics.

    Raises
    ------
    InputError
        If the middle is out of reach, reached only outside the joint limits, or only at
        singularities.
    """
    task = cell.task
    candidates = judged(desired, cell, _spread(_configurations(cell, seed), _KEPT))
    for size in (0.3, 0.15, 0.07):
        q = chosen(candidates, task.reference).q
        N = bases(task.jacobian(q)[None])[1][0]
        Q, left = _in_the_middle(cell, q + size * np.concatenate([N.T, -N.T]))
        good = (left < EXACT) & (_margins(cell, Q) > 0) & _regular(cell, Q)
        candidates += judged(desired, cell, Q[good]) if good.any() else []
    first = chosen(candidates, task.reference)
    candidates.sort(key=lambda c: (-c.share, c.body_distance < 0, -min(c.margin, _ENOUGH), c.speed))
    ordered = [first, *(c for c in candidates if c is not first)]
    Q = np.array([c.q for c in ordered])
    return [ordered[i] for i in unlike_rows(Q, _APART, _OFFERED, norm=2)]


def _configurations(cell: Cell, seed: int) -> Array:
    """Find configurations (K, n) in a cell's middle: not singular, and within the joint limits.

    Inverse kinematics starts from the task's reference and from random configurations.

    Raises
    ------
    InputError
        If there are none; the message gives the reason.
    """
    task, where = cell.task, f"the middle of the cell, {cell.where(np.zeros(cell.k))},"
    drawn = random_configurations(task, _STARTS, np.random.default_rng(seed))
    Q, left = _in_the_middle(cell, np.concatenate([task.reference[None], drawn]), inward=True)
    there = left < EXACT
    if not there.any():
        raise InputError(
            f"{where} is out of reach: the smallest task error found for {task.frame!r} is "
            f"{left.min():.3g} m or rad; move the cell nearer to the arm, or turn it"
        )
    Q = _unwound(cell, Q[there])
    margins = _margins(cell, Q)
    if not margins.max() > 0:
        own = task.limit_margin(Q[margins.argmax()])
        j = int(own.argmin())
        beyond = f"{-own[j]:.3g} {unit_of(task.revolute[j : j + 1])}"
        raise InputError(
            f"{where} is reached only outside the limits of "
            f"{task.joint_names[j]!r}, by {beyond} in the best configuration found; move the "
            "cell, or turn it"
        )
    Q = Q[(margins > 0) & _regular(cell, Q)]
    if not len(Q):
        raise InputError(f"in {where} {_SINGULAR_MIDDLE}")
    return Q


def _margins(cell: Cell, Q: Array) -> Array:
    """Evaluate the smallest joint-limit margin (K,) at configurations Q (K, n), rad or m.

    The configurations are in the middle of the cell. A joint that alone moves the frame along a
    removed coordinate must also move by the half-width of this coordinate to either side. So the
    half-width is subtracted from the margin of this joint.
    """
    return np.asarray(cell.limit_margin(Q).min(axis=1))


@dataclass(frozen=True, eq=False)
@read_only
class Candidate:
    """A configuration in the middle of a cell, and how well rays from there reach the corners.

    Attributes
    ----------
    q : (n,) array
        The configuration.
    share : float
        Fraction of the corners that are reached.
    margin : float
        Minimum joint-limit margin on the rays that reach their corners, rad or m; infinite if no
        ray does.
    body_distance : float
        Minimum body distance in the middle and at the corners reached, m. At corners where the
        bodies' convex hulls do not overlap, the distance of the hulls is used, a lower bound. Where
        the hulls overlap, the bodies themselves are measured, but at three corners at most, so the
        minimum can be too large. It serves to compare candidates; a design measures its own.
    speed : float
        Mean squared joint speed per unit of task speed at the corners reached: ``‖G_d E C‖_F²``
        with the desired inverse G_d, E = ∂x/∂u in the cell's coordinates u, and C = (EᵀE)^(−1/2).
    """

    q: Array
    share: float
    margin: float
    body_distance: float
    speed: float


def judged(desired: Inverse, cell: Cell, Q: Array) -> list[Candidate]:
    """Evaluate configurations Q (K, n) in the middle of a cell by their rays to its corners.

    Return the candidates in the order of Q. Configurations in which bodies collide are left out,
    unless bodies collide in all of them.
    """
    bodies, corners = bodies_of(cell.task), cell.corners()
    distances = bodies.distances(Q)
    separate = (distances >= 0) | (distances < 0).all()
    Q, distances = Q[separate], distances[separate]
    U = np.tile(corners, (len(Q), 1))
    ends = rays(desired, cell, Q.repeat(len(corners), axis=0), U, steps=10)
    good = ends.reached == 1
    speeds, nearest = _at_corners(desired, cell, ends, good)
    of_one = len(Q), len(corners)
    good, speed = good.reshape(of_one), speeds.reshape(of_one).sum(axis=1)
    Q_ends, least = ends.Q.reshape(*of_one, -1), ends.least.reshape(of_one)
    for i, hulls in enumerate(nearest.reshape(of_one)):
        distances[i] = min(distances[i], _least_distance(bodies, hulls, Q_ends[i]))
    share = good.mean(axis=1)
    margin = np.where(good, least, np.inf).min(axis=1)
    count = good.sum(axis=1)
    speed = np.where(count, speed / np.maximum(count, 1), np.inf)
    figures = np.stack([share, margin, distances, speed], axis=1).tolist()
    return [Candidate(q, *each) for q, each in zip(Q, figures, strict=True)]


def _at_corners(
    desired: Inverse, cell: Cell, ends: Rays, good: NDArray[np.bool_]
) -> tuple[Array, Array]:
    """Evaluate squared joint speeds, and distances of the bodies' convex hulls, m, at ends of rays.

    Return two arrays (K,), for K rays. ``good`` (K,) is True for rays that reached their corners.
    For the other rays, the speed is 0 and the distance infinite. The squared speed, per unit of
    task speed, is ``‖G_d E C‖_F²``, with E = ∂x/∂u and C = (EᵀE)^(−1/2).
    """
    speeds, nearest = np.zeros(len(good)), np.full(len(good), np.inf)
    if good.any():
        U, Q = ends.U[good], ends.Q[good]
        _, R, J = placed(cell.task, Q)
        own = desired.batch(Q, J) @ cell.twists(U, R) @ cell.speeds(U)
        speeds[good] = (own**2).sum(axis=(1, 2))
        nearest[good] = bodies_of(cell.task).hull_distances(Q)
    return speeds, nearest


def _least_distance(bodies: Bodies, hulls: Array, Q: Array) -> float:
    """Compute the smallest body distance over configurations Q (K, n), m.

    ``hulls`` (K,), m, are the distances of the bodies' convex hulls. Where a hull distance is
    positive, it is used as the body distance. Where hulls overlap, the bodies themselves are
    measured, but only at the three configurations with the deepest overlap.
    """
    deepest = np.argsort(hulls)[:_TESTED]
    deepest = deepest[hulls[deepest] < 0]
    least = float(np.where(hulls < 0, np.inf, hulls).min(initial=np.inf))
    tested = bodies.distances(Q[deepest]).min() if len(deepest) else np.inf
    return min(least, float(tested))


def chosen(candidates: list[Candidate], reference: Array) -> Candidate:
    """Choose the best candidate, with which a design begins.

    The criteria are, in this order: most corners reached; no collision, or the largest body
    distance if all collide; largest joint-limit margin, where margins above 0.1 rad or m count as
    0.1; squared joint speed at most 20 % above the minimum; smallest distance from the
    configuration ``reference`` (n,).
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
        (c for c in candidates if c.speed <= quick), key=lambda c: np.linalg.norm(c.q - reference)
    )


def _unwound(cell: Cell, Q: Array) -> Array:
    """Remove full turns from revolute joints of configurations Q (K, n) in a cell's middle.

    Each joint gets the equivalent angle nearest to the task's reference, if that angle is inside
    the joint's limits. A row is unchanged if the new angles would change the pose.
    """
    task = cell.task
    turns = np.rint((Q - task.reference) / (2 * np.pi)) * task.revolute
    near = Q - 2 * np.pi * turns
    near = np.where((near > task.lower) & (near < task.upper), near, Q)
    p, R, _ = placed(task, near)
    goal = cell.placements(np.zeros((len(Q), cell.k)))
    off = np.linalg.norm(cell.errors(*goal, p, R), axis=1)
    same = off < EXACT  # a joint that drives others may turn them less
    return np.where(same[:, None], near, Q)


def _regular(cell: Cell, Q: Array) -> NDArray[np.bool_]:
    """Test which configurations Q (K, n) are far enough from singularities to begin rays: (K,).

    σ_min / σ_max of J must be above :data:`SINGULAR`.
    """
    return inverse_condition_number(placed(cell.task, Q)[2]) > SINGULAR


def _spread(Q: Array, count: int) -> Array:
    """Select at most ``count`` rows of Q (K, n), each as far as possible from those before.

    The selected rows represent all configurations, whose evaluation would take too long. A row
    closer than 0.05 rad or m to a selected row is not selected.
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


def fitting_start(
    problem: Problem, cell_of: Callable[[Problem], Cell]
) -> tuple[Problem, Cell, bool]:
    """Choose the first of a problem's possible starts at which a cell fits.

    The start is the configuration in which a motion begins. A cell fits if J⁺ reaches the middle of
    the cell and, from there, every corner along a straight ray, without a fault. There are two
    faults: a joint leaves its limits on a ray, and bodies collide in the middle or at a corner. If
    there is no start at which a cell fits, the start with the most reached corners is chosen; among
    starts with equally many, the start with the fewest faults.

    Parameters
    ----------
    problem
        The problem. If the user gave its start, this is the only one that is tried.
    cell_of
        Function that makes the cell of a problem, around the pose at its start or around its path.

    Returns
    -------
    problem : Problem
        The problem with the chosen start.
    cell : Cell
        The cell of that problem.
    fits : bool
        True if the cell fits.

    Raises
    ------
    InputError
        If ``cell_of`` fails with every start; the error is that of the first start.
    """
    failure: InputError | None = None
    best: tuple[tuple[float, int], Problem, Cell] | None = None
    for tried in problem.alternatives():
        try:
            cell = cell_of(tried)
        except InputError as error:
            failure = failure or error
            continue
        share, faults = _reached(tried, cell)
        if best is None or (share, -faults) > best[0]:
            best = (share, -faults), tried, cell
        if (share, faults) == (1.0, 0):
            break
    if best is None:
        assert failure is not None  # there is always a start to try
        raise failure
    merit, chosen, cell = best
    return chosen, cell, merit == (1.0, 0)


def _reached(problem: Problem, cell: Cell) -> tuple[float, int]:
    """Return the share of a cell's corners that J⁺ reaches from its middle, and a count of faults.

    ``problem`` has the task, and the start from which inverse kinematics solves for the middle. The
    share is from 0 to 1, or −1 if the middle is not reached. The faults count from 0 to 2: one if a
    joint limit is violated on the way to a corner, and one if bodies collide in the middle or at a
    corner.
    """
    desired = Pseudoinverse(problem.task)
    try:
        q = solve_ik(problem.task, problem.start, cell.placement)
    except RepctlError:
        return -1.0, 0
    found = judged(desired, reduced(cell, desired), q[None])[0]
    return found.share, (found.margin < 0) + (found.body_distance < 0)
