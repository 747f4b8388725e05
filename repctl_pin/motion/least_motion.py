"""Closed motion of minimum joint speed on a path, to which repeatable controllers are compared."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..arguments import MOST_STEPS, Array, as_int, flag, positive, require_type
from ..errors import InputError
from ..model.task import Task, require_task
from ..paths.task_path import TaskPath, closed_path
from ..threads import one_blas_thread
from .closed_motion_cost import LONGEST, ClosedMotionCost, on_path, within_limits
from .follow import path_grid
from .motion import Motion, motion_along
from .solve_ik import solve_ik, solve_near

_STAGES = 100
"""Maximum number of stages in which the motion of J⁺ is deformed until it closes."""


@one_blas_thread()
def least_closed_motion(
    task: Task,
    path: TaskPath,
    q0: ArrayLike,
    *,
    steps: int = 200,
    period: float | None = None,
    free_start: bool = False,
    limit_margin: float = 0.0,
    guess: Motion | None = None,
) -> Motion:
    """Compute the closed joint motion of minimum joint speed on a closed path.

    ``min Σ_k ‖q_{k+1} − q_k‖² / (s_{k+1} − s_k)`` with ``f(q_k) = x(s_k)`` and ``q_K = q_0``,
    within the joint limits. The minimum is a local one: no closed motion near it, of whatever
    controller, needs less joint speed (rms) on this path from this start. So it estimates how close
    a repeatable inverse comes to the best; pass its motion as ``guess`` to search near it. At the
    minimum, ``N_kᵀ (2 q_k − q_{k−1} − q_{k+1}) = 0`` for uniform steps, wherever no joint is
    at its limit. Collisions are not considered; see ``motion.body_distance``.

    Parameters
    ----------
    task
        Redundant task.
    path
        Closed path.
    q0 : (n,) array
        Start configuration, moved to the path's first point if necessary.
    steps
        Number of points K per cycle (a few more if the path has corners).
    period
        Period, s; by default the path's, else 5.
    free_start
        True if the start, too, may move along its self-motion.
    limit_margin
        Margin to keep to every joint limit, rad or m; a start that is not free may have less.
    guess
        Motion whose first cycle is the initial one of the search; by default the motion of J⁺,
        deformed until it closes.

    Returns
    -------
    Motion
        One closed cycle. Its velocities are means over the steps, so compare ``rms_speed`` with
        that of motions of the same number of steps.

    Raises
    ------
    InputError
        If J⁺ cannot follow the path from the start, or no closed motion is found within the limits.
    SingularityError
        If the motion comes near a singularity.

    Examples
    --------
    >>> least = rp.least_closed_motion(task, path, q0, steps=50)
    >>> own = rp.follow(design.inverse, path, q0, cycles=1, steps=50)
    >>> bool(least.rms_speed <= own.rms_speed)
    True
    """
    path = closed_path(path)
    steps = as_int(steps, "steps", 8, MOST_STEPS)
    period = positive(
        (path.period or 5.0) if period is None else period, "the period", "s"
    )
    free_start = flag(free_start, "free_start")
    margin = positive(limit_margin, "limit_margin", "rad", zero=True)
    start = solve_ik(
        task, require_task(task).check(q0, "the start"), path.placement(0.0)
    )
    grid = path_grid(path, steps)
    cost = ClosedMotionCost.of(task, path, grid, free_start=free_start, margin=margin)
    if guess is None:
        Q = _closed(cost, _plain(cost, start), grid)
    else:
        Q = _sampled(
            cost, require_type(guess, Motion, "guess", "a motion"), start, grid
        )
    Q = within_limits(cost, Q)
    Q = np.vstack([Q, Q[:1]])
    t = grid * period
    qdot = np.diff(Q, axis=0) / np.diff(t)[:, None]  # means over the steps
    targets = [*cost.targets, path.placement(1.0)]
    return motion_along(path, task, t, Q, np.vstack([qdot, qdot[:1]]), targets)


def _plain(cost: ClosedMotionCost, start: Array) -> Array:
    """Follow the path with J⁺: configurations (K + 1, n), in general not closed."""
    Q = [start]
    for target in [*cost.targets[1:], cost.targets[0]]:
        Q.append(solve_near(cost.task, Q[-1], target, tolerance=1e-10))
    return np.array(Q)


def _closed(cost: ClosedMotionCost, Q: Array, grid: Array) -> Array:
    """Deform a motion (K + 1, n) on the path until it ends where it began: one cycle (K, n).

    Each stage subtracts the gap ``q_K − q_0``, at most 0.3 rad or m of it, in proportion to s, and
    moves the configurations back to the path along J⁺.
    """
    for _ in range(_STAGES):
        gap = Q[-1] - Q[0]
        size = float(np.abs(gap).max())
        if size < 1e-9:
            return Q[:-1]
        moved = Q[1:] - grid[1:, None] * gap * min(1.0, LONGEST / size)
        rest = on_path(cost.task, [*cost.targets[1:], cost.targets[0]], moved)
        if rest is None:
            break
        Q = np.vstack([Q[:1], rest])
    raise InputError(
        "the motion of J⁺ cannot be closed", remedy="pass one that closes as guess="
    )


def _sampled(cost: ClosedMotionCost, guess: Motion, start: Array, grid: Array) -> Array:
    """Sample the first cycle of a motion at the points of the path: (K, n)."""
    cycle = guess.cycle(0)
    t = guess.t[: guess.steps + 1]
    if cycle.shape[1] != cost.task.n:
        raise InputError(
            f"has {cycle.shape[1]} joints, not {cost.task.n}", argument="guess"
        )
    s = (t - t[0]) / (t[-1] - t[0])
    Q = np.stack([np.interp(grid[:-1], s, joint) for joint in cycle.T], axis=1)
    Q[: cost.first] = start
    on_path = cost.moved(Q)
    if on_path is None:
        raise InputError(
            ": it is too far from the path", argument="guess", remedy="omit it"
        )
    return on_path
