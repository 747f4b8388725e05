"""The least closed joint motion on a closed path: the yardstick for every repeatable controller."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arguments import MOST_STEPS, Array, as_int, flag, positive, require_type
from ..blas import one_blas_thread
from ..errors import InputError, SingularityError
from ..paths.task_path import TaskPath, closed_path
from ..redundancy.inverses import pseudoinverse, row_factor
from ..robot.chain_formulas import Placement
from ..robot.task import Task, require_task
from ..solvers import newton_rows, solve_block_tridiagonal
from .follow import path_grid
from .motion import Motion
from .solve_ik import solve_ik

_STEP = 0.3
"""Longest step of any joint, rad or m."""

_FLAT = 1e-8
"""Largest entry of a step of the descent, rad or m, after which the motion is the least one."""

_SURE = 1e-5
"""Largest entry of a step, rad or m, that is taken without a line search."""

_NEAR = ": the motion comes near a singularity, or there are too few steps"

_ITERATIONS = 100
"""Maximum number of steps of one descent, and of stages in which the initial motion is closed."""

_INSIDE = 1e-6
"""Margin that is kept to the joint limits, rad or m."""

_STIFFEST = 1e9
"""Largest weight of a violated limit, relative to the motion's own cost."""


@one_blas_thread()
def least_closed_motion(
    task: Task,
    path: TaskPath,
    q0: ArrayLike,
    *,
    steps: int = 200,
    period: float | None = None,
    free_start: bool = False,
    guess: Motion | None = None,
) -> Motion:
    """Minimise the joint motion over all closed joint motions on one closed path.

    ``min Σ_k ‖q_{k+1} − q_k‖² / (s_{k+1} − s_k)`` with ``f(q_k) = x(s_k)`` and ``q_K = q_0``,
    within the joint limits. No controller whose motion closes can need less joint speed (rms) on
    this path from this start, so it measures how close a repeatable inverse comes to the best.
    At the minimum, ``N_kᵀ (2 q_k − q_{k−1} − q_{k+1}) = 0`` for uniform steps, wherever no joint is
    at its limit. The minimum is a local one: of the motions near the initial one. Collisions are
    not considered; see ``motion.body_distance``.

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
        Whether the start may move along its self-motion, too.
    guess
        Motion whose first cycle is near the least one; by default that of J⁺, closed.

    Returns
    -------
    Motion
        One closed cycle. Its velocities are means over the steps, so compare ``rms_speed`` with
        that of motions of the same number of steps.

    Raises
    ------
    InputError
        If J⁺ cannot follow the path from the start, or no closed motion is found within the limits.

    Examples
    --------
    >>> least = rp.least_closed_motion(task, path, q0, steps=50)
    >>> own = rp.follow(design.inverse, path, q0, cycles=1, steps=50)
    >>> bool(least.rms_speed <= own.rms_speed)
    True
    """
    path = closed_path(path)
    steps = as_int(steps, "steps", 8, MOST_STEPS)
    period = positive((path.period or 5.0) if period is None else period, "the period", "s")
    free_start = flag(free_start, "free_start")
    start = solve_ik(task, require_task(task).check(q0, "the start"), path.placement(0.0))
    grid = path_grid(path, steps)
    cost = _Cost.of(task, [path.placement(float(s)) for s in grid[:-1]], grid, free_start)
    if guess is None:
        Q = _closed(cost, _plain(cost, start), grid, path.name)
    else:
        Q = _sampled(cost, require_type(guess, Motion, "guess", "a motion"), start, grid, path.name)
    Q = _within_limits(cost, Q, path.name)
    return _motion(task, path, cost.targets, np.vstack([Q, Q[:1]]), grid * period)


@dataclass(frozen=True)
class _Cost:
    """Augmented Lagrangian of the discrete motion, for the K configurations of one cycle.

    ``½ Σ w_k ‖q_{k+1} − q_k‖² + ½ Σ ρ_k ‖e_k‖²`` with ``e_k`` the excess of ``T q_k + λ_k / ρ_k``
    over the joint limits. ``first`` is the first k whose configuration is free."""

    task: Task
    targets: list[Placement]
    weights: Array  # (K,), 1 / step length
    share: Array  # (K,), share of the cycle that a point stands for
    first: int
    stiffness: float
    multipliers: Array  # (K, n)

    @classmethod
    def of(cls, task: Task, targets: list[Placement], grid: Array, free_start: bool) -> _Cost:
        """Make the cost without multipliers."""
        lengths = np.diff(grid)
        return cls(
            task=task,
            targets=targets,
            weights=1 / lengths,
            share=(lengths + np.roll(lengths, 1)) / 2,
            first=0 if free_start else 1,
            stiffness=1e4,
            multipliers=np.zeros((len(targets), task.n)),
        )

    def excess(self, Q: Array, *, shifted: bool = True) -> Array:
        """Excess over the joint limits (K, n), of the shifted joint positions or of their own."""
        lower, upper, _ = self.task.joint_limits
        joints = self.task.joints(Q)
        if shifted:
            joints = joints + self.multipliers / (self.stiffness * self.share[:, None])
        room = np.minimum(_INSIDE, (upper - lower) / 2)
        return joints - np.clip(joints, lower + room, upper - room)

    def value(self, Q: Array) -> float:
        """Evaluate the augmented Lagrangian, up to a constant."""
        chords = ((np.roll(Q, -1, axis=0) - Q) ** 2).sum(axis=1)
        beyond = (self.excess(Q)[self.first :] ** 2).sum(axis=1)
        stiff = self.stiffness * self.share[self.first :]
        return float(self.weights @ chords + stiff @ beyond) / 2

    def on_path(self, Q: Array) -> Array | None:
        """Move configurations (K, n) along J⁺ onto the path; None if one does not get there."""
        moved = _on_path(self.task, self.targets[self.first :], Q[self.first :])
        return None if moved is None else np.vstack([Q[: self.first], moved])

    def step(self, Q: Array, *, exact: bool) -> Array:
        """Compute a step of Newton's method in the null coordinates, or of Gauss–Newton's.

        Along the fibre ``q(a) = q + N a − ½ J⁺ (H N a) N a + …``, so that Newton's matrix has the
        blocks ``−λᵀ (H N) N`` with ``λ = J⁺ᵀ ∇`` beside Gauss–Newton's.

        Raises
        ------
        numpy.linalg.LinAlgError
            If Newton's matrix is not positive definite.
        """
        first, w = self.first, self.weights
        free = Q[first:]
        inverse, N = _inverses(self.task.jacobians(free))
        ahead = w[:, None] * (np.roll(Q, -1, axis=0) - Q)  # (K, n)
        beyond = self.excess(Q)[first:]
        stiff = (self.stiffness * self.share[first:])[:, None]
        T = self.task.coordinate_matrix
        gradient = (np.roll(ahead, 1, axis=0) - ahead)[first:] + (stiff * beyond) @ T
        TN = T @ N
        diagonal = (w + np.roll(w, 1))[first:, None, None] * np.eye(N.shape[2])
        diagonal = diagonal + np.swapaxes(TN, 1, 2) @ ((stiff * (beyond != 0))[:, :, None] * TN)
        if exact:
            forces = np.einsum("kni,kn->ki", inverse, gradient)  # λ (K, m)
            bent = np.einsum("ki,kiab->kab", forces, self.task.hessians(free))
            bent = np.swapaxes(N, 1, 2) @ bent @ N
            diagonal = diagonal - (bent + np.swapaxes(bent, 1, 2)) / 2
        upper = -w[first:, None, None] * np.swapaxes(N, 1, 2) @ np.roll(N, -1, axis=0)
        slope = np.einsum("knr,kn->kr", N, gradient)
        a = solve_block_tridiagonal(diagonal, upper, -slope, cyclic=not first)
        return np.vstack([np.zeros((first, Q.shape[1])), (N @ a[:, :, None])[:, :, 0]])


def _inverses(J: Array) -> tuple[Array, Array]:
    """Evaluate J⁺ (K, n, m) and N (K, n, r) of Jacobians (K, m, n)."""
    m = J.shape[1]
    basis, R = row_factor(J, mode="complete")
    inverse = np.swapaxes(np.linalg.solve(R[:, :m], np.swapaxes(basis[:, :, :m], 1, 2)), 1, 2)
    return inverse, basis[:, :, m:]


def _on_path(task: Task, targets: list[Placement], Q: Array) -> Array | None:
    """Move configurations (K, n) along J⁺ to their targets; None if one does not get there."""

    def correction(Q: Array, rows: NDArray[np.intp]) -> Array:
        errors = task.errors(Q, [targets[k] for k in rows])
        return (pseudoinverse(task.jacobians(Q)) @ errors[:, :, None])[:, :, 0]

    try:
        moved, last = newton_rows(correction, Q, longest=_STEP, tolerance=1e-7, iterations=20)
    except SingularityError:
        return None
    return moved if (last <= 1e-7).all() else None


def _descended(cost: _Cost, Q: Array, path: str) -> Array:
    """Minimise the cost by Newton's method with a line search, by Gauss–Newton's where it must."""
    value = cost.value(Q)
    for _ in range(_ITERATIONS):
        try:
            step = cost.step(Q, exact=True)
        except np.linalg.LinAlgError:
            step = cost.step(Q, exact=False)
        size = float(np.abs(step).max())
        scale = min(1.0, _STEP / max(size, _STEP))
        while True:
            trial = cost.on_path(Q + scale * step)
            lower = np.inf if trial is None else cost.value(trial)
            if trial is not None and (lower < value or scale * size < _SURE):
                break
            scale /= 2
            if scale * size < _SURE / 10:
                raise InputError(f"the descent to the least closed motion on {path} is stuck{_NEAR}")
        Q, value = trial, lower
        if size < _FLAT:
            return Q
    raise InputError(f"the descent to the least closed motion on {path} did not converge{_NEAR}")


def _within_limits(cost: _Cost, Q: Array, path: str) -> Array:
    """Minimise within the joint limits, by the method of multipliers."""
    while True:
        Q = _descended(cost, Q, path)
        beyond = cost.excess(Q, shifted=False)[cost.first :]
        if np.abs(beyond).max() < _INSIDE / 2:
            return Q
        if cost.stiffness >= _STIFFEST:
            raise InputError(
                f"no closed motion within the joint limits was found on {path}",
                remedy="choose another start or a smaller path",
            )
        stiff = cost.stiffness * cost.share[:, None]
        cost = replace(cost, multipliers=stiff * cost.excess(Q), stiffness=5 * cost.stiffness)


def _plain(cost: _Cost, start: Array) -> Array:
    """Follow the path by Newton's method with J⁺: (K + 1, n), which need not close."""
    Q = [start]
    for target in [*cost.targets[1:], cost.targets[0]]:
        Q.append(solve_ik(cost.task, Q[-1], target, tolerance=1e-10, limits=False))
    return np.array(Q)


def _closed(cost: _Cost, Q: Array, grid: Array, path: str) -> Array:
    """Close a motion (K + 1, n) by shares of its gap along the self-motions, in stages: (K, n)."""
    for _ in range(_ITERATIONS):
        gap = Q[-1] - Q[0]
        size = float(np.abs(gap).max())
        if size < 1e-9:
            return Q[:-1]
        moved = Q[1:] - grid[1:, None] * gap * min(1.0, _STEP / size)
        rest = _on_path(cost.task, [*cost.targets[1:], cost.targets[0]], moved)
        if rest is None:
            break
        Q = np.vstack([Q[:1], rest])
    raise InputError(
        f"the motion of J⁺ on {path} cannot be closed", remedy="pass a motion that closes, guess="
    )


def _sampled(cost: _Cost, guess: Motion, start: Array, grid: Array, path: str) -> Array:
    """Sample the first cycle of a motion at the points of the path: (K, n)."""
    cycle, t = guess.cycle(0), guess.t[: guess.steps + 1]
    if cycle.shape[1] != cost.task.n:
        raise InputError(f"has {cycle.shape[1]} joints, not {cost.task.n}", argument="guess")
    s = (t - t[0]) / (t[-1] - t[0])
    Q = np.stack([np.interp(grid[:-1], s, joint) for joint in cycle.T], axis=1)
    Q[: cost.first] = start
    on_path = cost.on_path(Q)
    if on_path is None:
        raise InputError(f": it is too far from {path}", argument="guess", remedy="omit it")
    return on_path


def _motion(task: Task, path: TaskPath, targets: list[Placement], Q: Array, t: Array) -> Motion:
    """Make the motion of one closed cycle (K + 1, n); its velocities are means over the steps."""
    qdot = np.diff(Q, axis=0) / np.diff(t)[:, None]
    errors = task.errors(Q, [*targets, targets[0]])
    linear = min(3, task.m)
    return Motion(
        task=task,
        path=path,
        t=t,
        q=Q,
        qdot=np.vstack([qdot, qdot[:1]]),
        cycles=1,
        steps=len(targets),
        drift=np.zeros(1),
        tracking_error=np.linalg.norm(errors[:, :linear], axis=1),
        turning_error=np.linalg.norm(errors[:, linear:], axis=1),
    )
