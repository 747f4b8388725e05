"""Where an arm can work: the best place for a box of poses of a given size and orientation."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from ...arguments import Array, as_int, as_matrices, finite, read_only, vector
from ...errors import InputError
from ...model.bodies import bodies_of
from ...model.chain_formulas import require_rotation
from ...model.several_frames import one_frame
from ...model.task import Task, require_task
from ...motion.solve_ik import random_configurations
from ...regions.region import sobol
from ...solvers import newton_rows
from ...strategies import Pseudoinverse
from .cell import Cell
from .cell_arguments import sizes
from .kinematics import bases, placed
from .posture_search import Candidate, searched
from .reference import rays

_DRAWN, _MIDDLES, _STARTS = 4096, 256, 3
"""Random configurations that show the reach; middles that are tried; starts of Newton's method."""

_SEARCHED = 3
"""Number of best middles at which the posture is searched for, with the bodies."""

_ENOUGH = 0.3
"""Limit margin, rad or m, above which a larger one is no longer an advantage."""

_SMALLER, _LEAST = 0.8, 0.1
"""Factor from one size to the next smaller one, and the smallest size that is tried."""

_STEP, _ITERATIONS, _PUSH = 0.4, 40, 0.3
_REACHED = 1e-9

_TOOL = {
    "down": np.diag([1.0, -1.0, -1.0]),
    "forward": np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]),
    "up": np.eye(3),
}
"""Rotations of the tool whose z axis points down, forward (along x of the base), or up."""


@dataclass(frozen=True, eq=False)
@read_only
class BestCell:
    """Place for a box of poses, see :func:`best_cell`.

    Attributes
    ----------
    cell : Cell
        The box.
    posture : (n,) array
        Configuration in its middle, from which J⁺ reaches all corners, rad or m.
    factor : float
        Edges relative to those asked for, m per m: 1 if it fits.
    margin : float
        Smallest limit margin on the straight ways to the corners, rad or m.
    reason : str
        Obstruction to the size asked for, at the same middle; empty if it fits.

    Examples
    --------
    >>> place = rp.best_cell(task, 0.2)  # m, a square
    >>> place.factor
    1.0
    >>> place.reason
    ''
    """

    cell: Cell
    posture: Array
    factor: float
    margin: float
    reason: str

    def __repr__(self) -> str:
        fits = "fits" if self.factor == 1 else f"{100 * self.factor:.0f} % of it fits"
        cell = self.cell
        return (
            f"<BestCell: {cell.size()} around {cell.where(np.zeros(cell.k))}, {fits}>"
        )


def best_cell(
    task: Task,
    size: ArrayLike,
    *,
    orientation: str | ArrayLike | None = None,
    yaw: float = 0.0,
    at: ArrayLike | None = None,
    seed: int = 0,
) -> BestCell:
    """Find the best place for a box of poses, or the largest box of its shape that is found.

    A box fits if J⁺ leads from a configuration in its middle along straight ways to all corners,
    inside the joint limits, and no bodies collide in the middle and at the corners. Among such
    middles, those with the box above z = 0 of the base come first, then those with the largest
    limit margin, then those with the shortest ways; with ``at``, the nearest one. The function over
    the box is then designed by :func:`nearest_inverse_function`.

    Parameters
    ----------
    task
        The task.
    size : float or (k,) array
        Edges of the box, m: one number, or one per position that the task commands.
    orientation : str or (3, 3) array, optional
        Direction of the tool's z axis, ``"down"``, ``"forward"`` (along x of the base) or
        ``"up"``; or a rotation matrix. By default, the orientation at the task's reference.
    yaw
        Angle by which the tool is then turned about the base's z axis, rad.
    at : (3,) array, optional
        Middle to be near to, m; by default any.
    seed
        Random seed of the middles that are tried.

    Returns
    -------
    BestCell

    Raises
    ------
    InputError
        If the task is not redundant or an argument is wrong; or no box of this orientation fits
        anywhere, with the obstruction.

    Examples
    --------
    >>> place = rp.best_cell(panda, (0.3, 0.3, 0.2), orientation="down")
    >>> place.factor
    1.0
    >>> place.cell.placement.rotation[:, 2].round()  # the tool's z axis
    array([ 0.,  0., -1.])
    """
    one_frame(require_task(task), "a cell")
    if task.r < 1:
        raise InputError(
            f"{task!r} is not redundant: with r = {task.r} the pose determines the joints",
            remedy="use another kind of task",
        )
    positions = min(3, task.m)
    edges = sizes(
        size, positions, "size", "m", "one per position that the task commands"
    )
    if not edges.any():
        raise InputError("must be above 0", argument="size")
    R = _rotation(task, orientation, yaw)
    near_to = None if at is None else vector(at, 3, "at", "m")
    middles = _middles(task, R, near_to, as_int(seed, "seed", 0))
    factor, shortest = 1.0, min(edges[edges > 0])
    first: _Middle | None = None
    while factor * shortest > 2e-3 and factor > _LEAST:
        found, best = _best(task, R, middles, factor * edges / 2, near_to)
        first = first or best
        if found is not None:
            cell, posture = found
            reason = (
                "" if factor == 1 else _obstruction(cell.scaled(1 / factor), posture.q)
            )
            return BestCell(cell, posture.q, factor, posture.margin, reason)
        factor *= _SMALLER
    assert first is not None, "there is a middle"
    whole = Cell(task, pin.SE3(R, first.p), edges / 2)
    raise InputError(
        f"no box of this shape fits in this orientation: {_obstruction(whole, first.q)}",
        remedy="turn the tool, or use another kind of task",
    )


class _Middle(NamedTuple):
    """A position p (3,) that is reached in the orientation, by a configuration q (n,)."""

    p: Array
    q: Array


def _rotation(task: Task, orientation: Any, yaw: float) -> Array:
    """Make the rotation of the tool from a word or a matrix, and the yaw."""
    turn = pin.rpy.rpyToMatrix(0.0, 0.0, finite(yaw, "yaw"))
    if orientation is None:
        return turn @ task.placement(task.reference).rotation
    if not task.kind.turns:
        raise InputError(
            f": a {task.kind} task leaves the rotation free",
            argument="orientation",
            remedy="omit it",
        )
    if isinstance(orientation, str):
        if orientation not in _TOOL:
            raise InputError(
                f"must be 'down', 'forward', 'up' or a rotation matrix; got {orientation!r}",
                argument="orientation",
            )
        return turn @ _TOOL[orientation]
    (R,) = as_matrices(("the orientation", orientation, "3 3"), exact=True)
    require_rotation(R, "the orientation")
    return np.asarray(turn @ R)


def _middles(task: Task, R: Array, at: Array | None, seed: int) -> list[_Middle]:
    """Find positions that the arm reaches in an orientation, inside its limits."""
    rng = np.random.default_rng(seed)
    drawn = task.positions(random_configurations(task, _DRAWN, rng))
    low, high = drawn.min(axis=0), drawn.max(axis=0)
    axes = task.rows[: min(3, task.m)]
    middle = np.array(task.placement(task.reference).translation)
    middle[axes] = (low + high)[axes] / 2
    half = np.maximum((high - low)[axes] / 2, 2e-3)
    world = Cell(task, pin.SE3(R, middle), half)
    U = 2 * sobol(world.k, _MIDDLES, seed) - 1
    if at is not None:  # denser, and nearer, around the given middle
        u = (at[axes] - middle[axes]) / half
        near = u + U[: _MIDDLES // 2] * np.linspace(0, 0.5, _MIDDLES // 2)[:, None]
        U = np.concatenate([np.clip(near, -1, 1), U])
    p_goal, R_goal = world.placements(np.repeat(U, _STARTS, axis=0))
    starts = np.array([task.reference, *random_configurations(task, _STARTS - 1, rng)])

    def correction(Q: Array, on: NDArray[np.intp]) -> Array:
        p, R, J = placed(task, Q)
        e = world.errors(p_goal[on], R_goal[on], p, R)
        G, N, _ = bases(J, np.zeros((len(Q), task.n, task.r)))
        low = np.maximum(0.0, task.lower + 0.1 - Q)
        back = low - np.maximum(0.0, Q - task.upper + 0.1)
        free = np.einsum("Knr,Klr,Kl->Kn", N, N, back)
        return np.asarray(np.einsum("Knm,Km->Kn", G, e) + _PUSH * free)

    Q, _ = newton_rows(
        correction,
        np.tile(starts, (len(U), 1)),
        longest=_STEP,
        tolerance=_REACHED / 10,
        iterations=_ITERATIONS,
    )
    p, R_now, _ = placed(task, Q)
    left = np.linalg.norm(world.errors(p_goal, R_goal, p, R_now), axis=1)
    margin = np.where(left < _REACHED, task.limit_margin(Q).min(axis=1), -np.inf)
    best = margin.reshape(-1, _STARTS).argmax(axis=1) + _STARTS * np.arange(len(U))
    kept = [k for k in best if margin[k] > 0]
    if not kept:
        joint = "within the joint limits" if (left < _REACHED).any() else "at all"
        raise InputError(
            f"the orientation is reached at none of {len(U)} positions {joint}; "
            "turn the tool, or use another kind of task"
        )
    return [_Middle(p_goal[k], Q[k]) for k in kept]


def _best(
    task: Task, R: Array, middles: list[_Middle], half: Array, at: Array | None
) -> tuple[tuple[Cell, Candidate] | None, _Middle]:
    """Find the best middle at which a box fits, with its posture; and the most promising middle."""
    desired = Pseudoinverse(task)
    merits = []
    for k, middle in enumerate(middles):
        cell = Cell(task, pin.SE3(R, middle.p), half)
        ends = rays(desired, cell, middle.q, cell.corners(), steps=8)
        good = ends.reached == 1
        margin = float(ends.least.min())
        fits = bool(good.all()) and margin > 0
        speed = float(np.abs(ends.Q - middle.q).max()) if fits else np.inf
        near = 0.0 if at is None else float(np.linalg.norm(middle.p - at))
        missed = 0.0 if fits else 1 - float(good.mean())
        low = bool(middle.p[2] < cell.spread(cell.corners())[:, 2:3].max(initial=0.0))
        merits.append((not fits, missed, near, low, -min(margin, _ENOUGH), speed, k))
    merits.sort()
    order = [middles[merit[-1]] for merit in merits]
    fitting = [middles[merit[-1]] for merit in merits if not merit[0]]
    for middle in _apart(fitting or order[:1], 0.0 if at is not None else half.max()):
        cell = Cell(task, pin.SE3(R, middle.p), half)
        try:
            posture = searched(desired, cell)[0]
        except InputError:
            continue
        if posture.share == 1 and posture.margin > 0 and posture.body_distance >= 0:
            return (cell, posture), order[0]
    return None, order[0]


def _apart(order: list[_Middle], distance: float) -> Iterator[_Middle]:
    """Yield the first middles of a list, each of them a distance away from those before."""
    taken: list[_Middle] = []
    for middle in order:
        if len(taken) == _SEARCHED:
            return
        if all(np.linalg.norm(middle.p - one.p) >= distance for one in taken):
            taken.append(middle)
            yield middle


def _obstruction(cell: Cell, q: Array) -> str:
    """Say what keeps J⁺ from the corners of a cell, from a configuration q (n,) in its middle."""
    task, corners = cell.task, cell.corners()
    ends = rays(Pseudoinverse(task), cell, q, corners, steps=16)
    worst = int(np.argmin(np.where(ends.reached < 1, ends.reached - 2, ends.least)))
    where = cell.where(corners[worst])
    if ends.reached[worst] < 1:
        share = 100 * ends.reached[worst]
        return (
            f"on the straight way to the corner {where}, the arm is at the end of its reach or at "
            f"a singularity after {share:.0f} %"
        )
    if ends.least[worst] <= 0:
        margins = task.limit_margin(ends.Q[worst])
        joint = task.joint_names[int(np.argmin(margins))]
        return f"on the way to the corner {where}, {joint!r} leaves its limits"
    bodies = bodies_of(task)
    Q = np.array([q, *ends.Q])
    k = int(np.argmin(bodies.distances(Q)))
    near = bodies.nearest(Q[k])
    place = "in the middle" if k == 0 else f"at the corner {cell.where(corners[k - 1])}"
    if near.distance < 0:
        return f"{place}, {' and '.join(near.links)} collide"
    return "another posture in the middle is needed, which the search did not find"
