"""Reasons why an inverse function fails at poses of a cell, each with its worst pose.

The causes are: out of reach, singularity, joint limit, fold, collision. U (K, k) are the k
coordinates of K poses in the cell, from −1 to 1, and Q (K, n) configurations of the function there,
for n joints. A share is a fraction of all sampled poses, 0 to 1. A leaf is the set of
configurations q = F(x) of one function, on which its controller stays. At a fold, the leaf turns
back along the self-motion, and is no longer a function of the pose.

``FailureReason`` is one reason why a function fails at some poses of its cell: cause, share of the
poses, worst pose.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ....base.arguments import Array, read_only
from ....model.native_kinematics import placed
from ....redundancy.inverses import inverse_condition_number
from ..geometry.cell import Cell
from ..geometry.sector import Sector
from .reach import SINGULAR, reached

_SHORT = 1e-6
_SPARSE = 24
_FINE, _JUMP = 1e-3, 0.5
"""Smallest step in u of the search for a singularity, and the joint step, rad or m, beyond which a
neighbour has another configuration."""


@dataclass(frozen=True, eq=False)
@read_only
class FailureReason:
    """One reason why a function fails at some poses of its cell, with one of these poses.

    Attributes
    ----------
    cause : str
        Kind of the reason: ``reach``, ``singularity``, ``limit``, ``fold`` or ``collision``.
    share : float
        Fraction of the sampled poses that fail for this reason, 0 to 1. For collisions, it is an
        estimate from some of these poses.
    u : (k,) array
        The worst of these poses or, for a fold, any of them, in all coordinates u of the cell, from
        −1 to 1 (those of :attr:`Cell.whole`).
    what : str
        Message that describes the failure and this pose.
    """

    cause: str
    share: float
    u: Array
    what: str

    def __str__(self) -> str:
        return self.what


def _reason(cause: str, share: float, cell: Cell, u: Array, what: str) -> FailureReason:
    """Make the :class:`FailureReason` for coordinates u (k,) of the worst pose of a cell.

    ``what`` is the sentence that says where and how the function fails. Coordinates that a symmetry
    of the arm removes from u are added as 0.
    """
    return FailureReason(cause, share, cell._lifted(u[None])[0], what)


def broken_limit(cell: Cell, U: Array, Q: Array, share: float) -> FailureReason | None:
    """Describe the failure by a joint limit: the joint and the pose of the largest violation.

    Q (K, n) are the configurations at the poses U (K, k), and ``share`` the share of poses that
    violate a limit. Return None if no configuration violates one.
    """
    task = cell.task
    margin = cell.limit_margin(Q)
    broken = margin.min(axis=1, initial=np.inf) < 0
    if not broken.any():
        return None
    at, joint = np.unravel_index(int(np.argmin(margin)), margin.shape)
    unit = "rad" if task.revolute[joint] else "m"
    by = f"{-margin[at, joint]:.2g} {unit}"
    what = f"at {cell.where(U[at])}, {task.joint_names[joint]} is {by} beyond its limit"
    return _reason("limit", share, cell, U[at], what)


def unreached(cell: Cell, U: Array, near: Array, share: float) -> list[FailureReason]:
    """Describe the failures at poses at which the function has no configuration.

    If Newton's method reaches such a pose from one of the configurations ``near``, a singularity
    lies between the middle of the cell and the pose. Otherwise the pose is out of reach. Up to 24
    poses are tested.

    Parameters
    ----------
    cell
        The cell.
    U : (K, k) array
        Poses at which the function has no configuration.
    near : (L, n) array
        Initial configurations of Newton's method.
    share
        Fraction of the sampled poses at which the function has no configuration.

    Returns
    -------
    list of FailureReason
        At most one for reach and one for singularity; empty if there are no poses.
    """
    if not len(U):
        return []
    some = U[np.linspace(0, len(U) - 1, min(_SPARSE, len(U))).astype(int)]
    goals = cell.placements(some.repeat(len(near), axis=0))
    Q, left = reached(cell, *goals, np.tile(near, (len(some), 1)), iterations=40)
    left = left.reshape(len(some), -1)
    best = left.argmin(axis=1) + len(near) * np.arange(len(some))
    shortfall = left.min(axis=1)
    spans = inverse_condition_number(placed(cell.task, Q[best])[2])
    short = shortfall > _SHORT
    failures = []
    if short.any():
        at = int(np.argmax(shortfall))
        where = cell.where(some[at])
        what = f"the pose {where} is out of reach (task error {shortfall[at]:.2g}, in m and rad)"
        part = share * float(short.mean())
        failures.append(_reason("reach", part, cell, some[at], what))
    if not short.all():
        at = int(np.argmin(np.where(short, np.inf, spans)))
        where = cell.where(some[at])
        what = f"between the middle of the cell and {where} the arm passes a singularity"
        part = share * float((~short).mean())
        failures.append(_reason("singularity", part, cell, some[at], what))
    return failures


def folded(cell: Cell, U: Array, Q: Array, share: float) -> FailureReason | None:
    """Describe the failure of a function that folds between the middle and poses U (K, k).

    At a fold, the leaf turns back along the self-motion, and the leaf margin, the distance from an
    algorithmic singularity, is 0. Every leaf folds near a singularity of J, because the direction
    of the null space turns through all angles on a path around the singularity. So a singularity is
    searched for, from the configurations Q (K, n) at the poses U. If one is found, the cause is
    ``singularity``, else ``fold``. ``share`` is the share of poses beyond a fold. Return None if U
    is empty.
    """
    if not len(U):
        return None
    u, ratio = most_singular(cell, U, Q)
    if ratio < SINGULAR:
        what = (
            f"at {cell.where(u)} the arm is at a singularity "
            f"(σ_min(J) / σ_max(J) = {ratio:.1g}), around which the function folds"
        )
        return _reason("singularity", share, cell, u, what)
    what = f"at {cell.where(U[0])} the function folds: its leaf turns back, leaf margin 0"
    return _reason("fold", share, cell, U[0], what)


def most_singular(cell: Cell, U: Array, Q: Array) -> tuple[Array, float]:
    """Search a cell for a singularity of J near poses U (K, k), from configurations Q (K, n).

    The search begins at the pose of U with the smallest ratio σ_min / σ_max of J. It changes one
    coordinate at a time, by ever smaller steps, such that the ratio falls. Return the pose (k,)
    with the smallest ratio, and this ratio.
    """
    ratios = inverse_condition_number(placed(cell.task, Q)[2])
    first = int(np.argmin(ratios))
    u, q, ratio, step = U[first], Q[first], float(ratios[first]), 0.1
    ways = np.concatenate([np.eye(cell.k), -np.eye(cell.k)])
    while step > _FINE:
        beside = np.clip(u + step * ways, -1, 1)
        goals = cell.placements(beside)
        there, left = reached(cell, *goals, np.tile(q, (len(beside), 1)), iterations=20)
        near = (left < _SHORT) & (np.abs(there - q).max(axis=1) < _JUMP)
        ratios = np.where(near, inverse_condition_number(placed(cell.task, there)[2]), np.inf)
        best = int(np.argmin(ratios))
        if ratios[best] < ratio:
            u, q, ratio = beside[best], there[best], float(ratios[best])
        else:
            step /= 2
    return u, ratio


def touching(
    cell: Cell, U: Array, distances: Array, links: tuple[str, str], share: float, required: float
) -> FailureReason | None:
    """Describe the failure that two links collide, or come nearer than ``required``, m.

    ``distances`` (K,) are the body distances, m, at the poses U (K, k). ``links`` are the two links
    with the smallest distance, and ``share`` is the share of poses with a distance below
    ``required``. Return None if no distance is below ``required``.
    """
    at = int(np.argmin(distances))
    least = float(distances[at])
    if least >= required:
        return None
    how = "collide" if least < 0 else f"come to {1e3 * least:.2g} mm"
    what = f"at {cell.where(U[at])}, {links[0]} and {links[1]} {how}"
    return _reason("collision", share, cell, U[at], what)


def round_the_base(cell: Cell) -> str:
    """Write that no function exists because the cell contains the axis of the arm's first joint.

    On a closed path around that axis the first joint makes a full turn, so no function is possible.
    The text ends an error message; it is empty if the cell does not contain the axis, if the first
    joint is prismatic, or if the cell is a sector, which has an angle around an axis.
    """
    task = cell.task
    turning = np.flatnonzero(task.revolute)
    if isinstance(cell, Sector) or not len(turning) or turning[0] != 0:
        return ""
    q = np.array(task.reference)
    point, axis = task.joint_origins(q)[0], task.axes(q)[0]
    rows, w = task.rows[: len(cell.half_width)], cell.half_width
    away, slope = (cell.placement.translation - point)[rows], axis[rows]
    slope[np.abs(slope) < 1e-9] = 0.0
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.stack([away - w, away + w]) / slope  # of the line point + t axis
    low, high = ends.min(axis=0).max(), ends.max(axis=0).min()
    if low >= high:  # the line is not in all slabs at once
        return ""
    return (
        f"the cell contains the axis of {task.joint_names[0]}, and no single-valued function "
        "exists all the way around the base; place the cell on one side of that axis"
    )
