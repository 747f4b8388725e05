"""Reach of an arm in a cell: single poses, straight rays from the middle, and growing boxes.

Poses are solved by Newton's method. A ray is the motion along a straight line from the middle of
the cell to a pose in it, with coordinates u (k,) from −1 to 1. Boxes grow around many middles at
once, from a point to their full size. The limit margin of a configuration is the smallest distance
of a joint from its limits, rad or m. G_d is the desired inverse, J⁺ the pseudoinverse of the task
Jacobian J.

Letters: n joints, m task coordinates, r = n − m, K poses, rays or middles.

``Rays`` are the results of following K straight rays from the middle of a cell: end poses, last
configurations, fraction followed. ``Grown`` is how far a box of poses grows around each of K
middles.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....base.arguments import Array
from ....model.native_kinematics import placed
from ....model.task import Task
from ....motion.solve_ik import random_configurations
from ....redundancy import nullspace
from ....solvers import newton_rows
from ....strategies.strategy import Inverse
from ..geometry.cell import Cell
from ..geometry.kinematics import inverses, null_bases, regular

EXACT = 1e-9
"""Norm of the task error, m and rad, below which a pose is reached."""

SINGULAR = 0.01
"""σ_min / σ_max of J at which following a ray is stopped."""

STEPS = 10
"""Number of sizes through which a box grows; the last one is its own."""

_LONGEST = 0.4
"""Longest Newton step of any joint, and longest step of a box that grows, rad or m."""

_PUSH, _ROOM = 0.3, 0.1
"""Gain of the null-space motion away from the joint limits, and margin at which it begins: rad, m,
or the share of the joint's range if that is less."""

_STEP = 0.5
"""Joint step, rad or m, between two points of a ray at which following the ray is stopped."""

_NEAR = 0.3
"""Task error, as a share of a step, below which a step of a box that grows counts as made."""


def reached(
    cell: Cell, p: Array, R: Array, Q: Array, *, inward: bool = False, iterations: int = 60
) -> tuple[Array, Array]:
    """Solve the inverse kinematics of K poses, by Newton's method with J⁺.

    No error is raised if a pose is not reached.

    Parameters
    ----------
    cell
        The cell, which has the task and measures task errors by :meth:`Cell.errors`.
    p, R, Q : (K, 3), (K, 3, 3) and (K, n) arrays
        Positions, m, and rotation matrices of the poses in the base frame, and the initial
        configurations.
    inward
        Move joints away from their limits in the null space, too.
    iterations
        Maximum number of steps.

    Returns
    -------
    Q : (K, n) array
        Final configurations.
    left : (K,) array
        Norm of the remaining task error, in m and rad; below :data:`EXACT` where the pose is
        reached.
    """
    task = cell.task
    inner = _ROOM * np.minimum(1.0, task.upper - task.lower)

    def correction(Q: Array, on: NDArray[np.intp]) -> Array:
        p_now, R_now, J = placed(task, Q)
        G, _ = inverses(J)
        e = cell.errors(p[on], R[on], p_now, R_now)
        dQ = np.einsum("Knm,Km->Kn", G, e)
        if inward:
            low = np.maximum(0.0, task.lower + inner - Q)
            back = low - np.maximum(0.0, Q - task.upper + inner)
            # in the null space, (I − J⁺ J) back
            dQ += _PUSH * (back - np.einsum("Knm,Kml,Kl->Kn", G, J, back, optimize=True))
        return dQ

    Q, _ = newton_rows(correction, Q, longest=_LONGEST, tolerance=EXACT / 10, iterations=iterations)
    p_now, R_now, _ = placed(task, Q)
    return Q, np.linalg.norm(cell.errors(p, R, p_now, R_now), axis=1)


def unlike_rows(rows: Array, distance: float, count: int, norm: float = np.inf) -> list[int]:
    """Select rows (K, ·) farther than ``distance`` from each other; return their indices.

    Distances have the unit of the rows. Rows are taken in order: a row is left out if it is too
    near to a row that was taken before. At most ``count`` rows are taken. ``norm`` is the order of
    the norm of the difference of two rows.
    """
    kept: list[int] = []
    left = np.arange(len(rows))
    while len(left) and len(kept) < count:
        kept.append(int(left[0]))
        left = left[np.linalg.norm(rows[left] - rows[left[0]], norm, axis=1) > distance]
    return kept


class Rays(NamedTuple):
    """Results of following K straight rays from the middle of a cell to poses in it.

    The last configurations are the data to which a chart of the cell, a polynomial, is fitted.

    Attributes
    ----------
    U : (K, k) array
        Poses to which the rays lead, in coordinates of the cell. A ray that stops early does not
        reach its pose.
    Q, N : (K, n) and (K, n, r) arrays
        Last configuration on each ray, and basis of the null space of J there. The bases of
        neighbouring points on a ray are chosen as similar as possible.
    reached : (K,) array
        Fraction of each ray that was followed; 1 means that its pose was reached.
    least : (K,) array
        Minimum joint-limit margin on each ray, rad or m.
    """

    U: NDArray[Any]
    Q: NDArray[Any]
    N: NDArray[Any]
    reached: NDArray[Any]
    least: NDArray[Any]


def rays(desired: Inverse, cell: Cell, q_middle: Array, U: Array, *, steps: int = 16) -> Rays:
    """Follow straight rays from the middle of a cell to poses U (K, k), all rays at once.

    A ray is the motion of the desired inverse G_d along a straight line in the cell's coordinates,
    by steps ``Δq = G_d (x_next − f(q))``. A ray stops at a singularity, or where a joint would move
    by 0.5 rad or m in one step.

    Parameters
    ----------
    desired
        G_d.
    cell, q_middle
        The cell, and the configuration (n,) in its middle; or one configuration per ray, (K, n).
    U : (K, k) array
        End poses of the rays, in coordinates of the cell.
    steps
        Number of points on each ray.
    """
    task, K = cell.task, len(U)
    Q, N = _starts_of_rays(task, np.broadcast_to(q_middle, (K, task.n)))
    reached, least = np.zeros(K), np.full(K, np.inf)
    on = np.arange(K)
    for ahead in [*np.linspace(0, 1, steps + 1)[1:], 1.0, 1.0, 1.0]:
        p, R, J = placed(task, Q[on])
        N[on] = null_bases(J, N[on])
        least[on] = np.minimum(least[on], cell.limit_margin(Q[on]).min(axis=1))
        good = regular(J, SINGULAR)
        on, p, R, J = on[good], p[good], R[good], J[good]
        if not len(on):
            break
        error = cell.errors(*cell.placements(U[on] * ahead), p, R)
        dQ = np.einsum("Knm,Km->Kn", desired.batch(Q[on], J), error)
        good = np.abs(dQ).max(axis=1) < _STEP
        on = on[good]
        Q[on] += dQ[good]
        reached[on] = ahead
    p, R, _ = placed(task, Q)
    missed = np.abs(cell.errors(*cell.placements(U), p, R)).max(axis=1) > 1e-6
    reached[missed] = np.minimum(reached[missed], 1 - 1 / steps)
    return Rays(U, Q, N, reached, least)


def _starts_of_rays(task: Task, Q: Array) -> tuple[Array, Array]:
    """Return the first configurations Q (K, n) of rays, and bases of the null space (K, n, r).

    Rays with the same configuration have the same basis.
    """
    starts, ray = np.unique(Q, axis=0, return_inverse=True)
    N = np.array([nullspace(task.jacobian(q)) for q in starts])
    return starts[ray], N[ray]


class Grown(NamedTuple):
    """K middles around which a box of poses was grown, and how far it grew around each.

    Where the arm reaches the whole box, the box grows to its full size.

    Attributes
    ----------
    p, Q : (K, 3) and (K, n) arrays
        Positions of the middles, m, and configurations there.
    steps : (K,) array
        Number of steps by which the box grew; :data:`STEPS` is its full size.
    margin : (K,) array
        Smallest limit margin, rad or m, over the corners, edge middles and face centres of the box
        at every size from a point to its final size.
    ends : (K, C, n) array
        Configurations at the C corners, edge middles and face centres of the grown box, in the
        order of :meth:`Cell.rim`.
    distance : (K,) array
        Smallest body distance at ``ends``, m; infinite where it was not computed.
    """

    p: NDArray[Any]
    Q: NDArray[Any]
    steps: NDArray[Any]
    margin: NDArray[Any]
    ends: NDArray[Any]
    distance: NDArray[Any]


def drawn(box: Cell, count: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Draw K = ``count`` configurations at random: positions (K, 3), m, configurations (K, n).

    The positions are those of the frame; a box of poses is then grown around each. If the task does
    not command a coordinate of the position, that coordinate is taken from the middle of ``box``.
    """
    task = box.task
    Q = random_configurations(task, count, rng)
    p = placed(task, Q)[0]
    still = np.setdiff1d(range(3), task.rows[: min(3, task.m)])
    p[:, still] = box.placement.translation[still]
    return p, Q


def grown(box: Cell, p: Array, Q: Array) -> Grown:
    """Grow a box around each of the positions p (K, 3), m, as far as the arm reaches the box.

    The positions, in base axes, are the middles. ``box`` gives the full size and the orientation.
    Inverse kinematics of the positions starts at Q (K, n). Positions that are not reached inside
    the joint limits are left out of the result. J⁺ moves the arm from each middle straight to all
    corners, edge middles and face centres, by steps ``Δq = J⁺ (x_next − f(q))``. The box stops
    growing if, at one of these points, the arm is singular, a joint leaves its limits, the point is
    not reached, or a joint would move by more than 0.4 rad or m in one step.
    """
    n, rim = box.task.n, _Rim(box)
    p, Q = _middles(box, p, Q)
    steps, margin = np.zeros(len(p), int), np.full(len(p), np.inf)
    ends = np.repeat(Q[:, None], rim.C, axis=1)
    on, now = np.arange(len(p)), ends.reshape(-1, n)
    jumps = np.zeros(len(now), bool)
    for step in range(STEPS + 1):
        # where the whole rim is reached, regular and inside the limits
        G, error, least, good = rim.evaluated(p[on], step / STEPS, now)
        together = (good & ~jumps).reshape(-1, rim.C).all(axis=1)
        rows = together.repeat(rim.C)
        on, now = on[together], now[rows]
        if not len(on):
            break
        ends[on], steps[on] = now.reshape(-1, rim.C, n), step
        margin[on] = np.minimum(margin[on], least[rows].reshape(-1, rim.C).min(axis=1))
        # one step outward
        dQ = rim.outward(G[rows], error[rows])
        jumps = np.abs(dQ).max(axis=1) > _LONGEST
        now = now + dQ
    return Grown(p, Q, steps, margin, ends, np.full(len(p), np.inf))


class _Rim:
    """The C corners, edge middles and face centres of a box that grows around K middles.

    ``box`` has the full size, the orientation and the task. Arrays over all points of all rims have
    K C rows: the C points around the first middle, then those around the second one, and so on.
    """

    def __init__(self, box: Cell) -> None:
        self._box = box
        p, self._R = box.placements(box.rim())
        self.C = len(p)
        self._offsets = p - box.placement.translation
        self._step = self._offsets[:, box.task.rows[: len(box.half_width)]] / STEPS
        self._near = _NEAR * np.linalg.norm(self._offsets, axis=1).max() / STEPS

    def evaluated(
        self, p: Array, share: float, Q: Array
    ) -> tuple[Array, Array, Array, NDArray[np.bool_]]:
        """Evaluate how well configurations Q (K C, n) reach the rims around p (K, 3), m.

        The rims have the given share of their full size. Return J⁺ (K C, n, m), task errors (K C,
        m), limit margins (K C,), and a mask (K C,) of the points that are reached inside the joint
        limits, where J has full rank.
        """
        aims = (p[:, None] + share * self._offsets).reshape(-1, 3)
        p_now, R_now, J = placed(self._box.task, Q)
        G, s = inverses(J)
        error = self._box.errors(aims, np.tile(self._R, (len(p), 1, 1)), p_now, R_now)
        least = self._box.task.limit_margin(Q).min(axis=1)
        good = (s[:, -1] > SINGULAR * s[:, 0]) & (least > 0)
        return G, error, least, good & (np.linalg.norm(error, axis=1) < self._near)

    def outward(self, G: Array, error: Array) -> Array:
        """Compute the motion Δq (K C, n) of J⁺ to the rims that are one step larger.

        ``G`` (K C, n, m) and ``error`` (K C, m), from :meth:`evaluated`, are J⁺ and the task errors
        before this step; the motion corrects these errors, too.
        """
        ahead = error.copy()
        ahead[:, : self._step.shape[1]] += np.tile(self._step, (len(error) // self.C, 1))
        return np.einsum("Knm,Km->Kn", G, ahead)


def _middles(box: Cell, p: Array, Q: Array) -> tuple[Array, Array]:
    """Solve for poses at positions p (K, 3), m, in the box's orientation, starting at Q (K, n).

    Return the positions (L, 3) and configurations (L, n) of the L poses where this succeeds inside
    the joint limits.
    """
    R = np.broadcast_to(box.placement.rotation, (len(p), 3, 3))
    Q, left = reached(box, p, R, Q, inward=True, iterations=40)
    inside = (left < EXACT) & (box.task.limit_margin(Q).min(axis=1) > 0)
    return p[inside], Q[inside]
