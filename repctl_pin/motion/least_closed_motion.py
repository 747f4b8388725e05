"""Closed motion of minimum joint speed on a path, to which repeatable controllers are compared.

A closed motion is K configurations q_k, one at each point x(s_k) of the path, with s from 0 to 1.
Its cost, an augmented Lagrangian with the joint limits, is :class:`_Cost`. It is minimised by
Newton steps along the null space of J, each followed by a correction back onto the path. An
argument ``cost`` is this cost; it holds the task and the placements on the path. A self-motion
moves the joints while the frame rests. J⁺ is the pseudoinverse of the Jacobian J, and the columns
of N (n, r) are an orthonormal basis of its null space.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..base.arguments import MOST_STEPS, Array, as_int, flag, positive, read_only, require_type
from ..base.errors import InputError, SingularityError
from ..base.threads import one_blas_thread
from ..model.chain_formulas import Placement
from ..model.task import Task, require_task
from ..paths.task_path import TaskPath, closed_path
from ..redundancy.inverses import pseudoinverse, row_factor
from ..solvers import newton_rows, solve_block_tridiagonal
from .follow import path_grid
from .motion import Motion, motion_along
from .solve_ik import solve_ik, solve_near

_STAGES = 100
"""Maximum number of stages in which the motion of J⁺ is deformed until it closes."""

_LONGEST = 0.3
"""Maximum step of any joint, rad or m."""

_FLAT = 1e-8
"""Largest entry of a Newton step, rad or m, below which the descent ends."""

_SURE = 1e-5
"""Largest entry of a Newton step, rad or m, up to which it is taken without a line search."""

_ROUNDING = 1e-14
"""Predicted decrease, relative to the cost, below which the descent ends."""

_ITERATIONS = 100
"""Maximum number of Newton steps of one descent."""

_DAMPING = 1e-6
"""Weight of the squared step in Newton's matrix, for null directions in which the cost is constant,
such as a rotation about the tool's own axis."""

_INSIDE = 1e-6
"""Margin to the joint limits, rad or m, that is added to the requested one."""

_STIFFEST = 1e9
"""Penalty weight ``stiffness`` of violated limits at which the search is given up."""

_NEAR = (
    "the motion comes near a singularity, or there are too few steps; "
    "use more steps, another start or a smaller path"
)


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
    controller, needs less joint speed (rms) on this path from this start. So the minimum shows how
    close a repeatable inverse comes to the best motion; pass the motion of that inverse as
    ``guess`` to search near it. At the minimum, ``N_kᵀ (2 q_k − q_{k−1} − q_{k+1}) = 0`` for
    uniform steps, wherever no joint is at its limit; N_k spans the null space of J at q_k.
    Collisions are not considered; see ``motion.body_distance``.

    Parameters
    ----------
    task
        Redundant task.
    path
        Closed path.
    q0 : (n,) array
        Start configuration, moved to the path's first point if necessary.
    steps
        Number K of points per cycle. If the path has corners, K can differ from ``steps`` by a few.
    period
        Period, s; by default the path's, else 5.
    free_start
        True if the start is optimised too, along its self-motions; False to keep q0.
    limit_margin
        Minimum margin from every joint limit, rad or m; a fixed start may have less.
    guess
        Motion with whose first cycle the search begins; by default the motion of J⁺, deformed until
        it closes.

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
    period = positive((path.period or 5.0) if period is None else period, "the period", "s")
    free_start = flag(free_start, "free_start")
    margin = positive(limit_margin, "limit_margin", "rad", zero=True)
    start = solve_ik(task, require_task(task).check(q0, "the start"), path.placement(0.0))
    grid = path_grid(path, steps)
    cost = _Cost.of(task, path, grid, free_start=free_start, margin=margin)
    if guess is None:
        Q = _closed(cost, _plain(cost, start), grid)
    else:
        Q = _sampled(cost, require_type(guess, Motion, "guess", "a motion"), start, grid)
    Q = _within_limits(cost, Q)
    Q = np.vstack([Q, Q[:1]])
    t = grid * period
    qdot = np.diff(Q, axis=0) / np.diff(t)[:, None]  # means over the steps
    targets = [*cost.targets, path.placement(1.0)]
    return motion_along(path, task, t, Q, np.vstack([qdot, qdot[:1]]), targets)


def _plain(cost: _Cost, start: Array) -> Array:
    """Follow the path with J⁺ from a start (n,): a motion (K + 1, n), in general not closed."""
    Q = [start]
    for target in [*cost.targets[1:], cost.targets[0]]:
        Q.append(solve_near(cost.task, Q[-1], target, tolerance=1e-10))
    return np.array(Q)


def _closed(cost: _Cost, Q: Array, grid: Array) -> Array:
    """Deform a motion (K + 1, n) along the path until it is closed; return its cycle (K, n).

    Each stage subtracts the gap ``q_K − q_0``, or a part of at most 0.3 rad or m, in proportion to
    s, and moves the configurations back onto the path along J⁺. ``grid`` (K + 1,) are the values of
    s.
    """
    for _ in range(_STAGES):
        gap = Q[-1] - Q[0]
        size = float(np.abs(gap).max())
        if size < 1e-9:
            return Q[:-1]
        moved = Q[1:] - grid[1:, None] * gap * min(1.0, _LONGEST / size)
        rest = _on_path(cost.task, [*cost.targets[1:], cost.targets[0]], moved)
        if rest is None:
            break
        Q = np.vstack([Q[:1], rest])
    raise InputError(
        "the motion of J⁺ on this path cannot be deformed into a closed one",
        remedy="pass a closed motion as guess=",
    )


def _sampled(cost: _Cost, guess: Motion, start: Array, grid: Array) -> Array:
    """Convert the first cycle of a motion to K configurations (K, n) on the path.

    The motion ``guess`` is interpolated at the values of s in ``grid`` (K + 1,), and the
    configurations are moved onto the path. If the start is fixed, the first of them is ``start``
    (n,). InputError is raised for another number of joints, or for a guess too far from the path.
    """
    cycle = guess.cycle(0)
    t = guess.t[: guess.steps + 1]
    if cycle.shape[1] != cost.task.n:
        raise InputError(
            f"has {cycle.shape[1]} joints, but the task has {cost.task.n}",
            argument="guess",
            remedy="give a motion of the same task",
        )
    s = (t - t[0]) / (t[-1] - t[0])
    Q = np.stack([np.interp(grid[:-1], s, joint) for joint in cycle.T], axis=1)
    Q[: cost.first] = start
    moved = cost.moved(Q)
    if moved is None:
        raise InputError(
            ": the motion is too far from the path", argument="guess", remedy="omit guess="
        )
    return moved


@dataclass(frozen=True, eq=False)
@read_only
class _Cost:
    """Augmented Lagrangian of a closed motion: a function of the K configurations q_k of its cycle.

    It is ``½ Σ w_k ‖q_{k+1} − q_k‖² + ½ Σ ρ_k ‖e_k‖²``. The ``weights`` are
    w_k = 1 / (s_{k+1} − s_k). ``e_k`` (n,) is how far ``q_k + λ_k / ρ_k`` exceeds the joint limits,
    which are narrowed by ``margin``, rad or m. λ_k (n,) are the ``multipliers`` of the limits, and
    ρ_k = ``stiffness · share``, where ``share`` (K,) is the fraction of the cycle that point k
    stands for. ``targets`` are the K placements on the path. ``first`` is the index of the first
    configuration that is optimised: 0, or 1 if the start is fixed.
    """

    task: Task
    targets: list[Placement]
    weights: Array  # (K,), 1 / step length
    share: Array  # (K,), share of the cycle that a point stands for
    first: int
    margin: float
    stiffness: float
    multipliers: Array  # (K, n)

    @classmethod
    def of(
        cls, task: Task, path: TaskPath, grid: Array, *, free_start: bool, margin: float = 0.0
    ) -> _Cost:
        """Create the cost at the points s = ``grid`` (K + 1,) of a path, with all multipliers 0.

        ``free_start`` is True if the start is optimised too, and ``margin`` the joint-limit margin
        to keep, rad or m.
        """
        targets = [path.placement(float(s)) for s in grid[:-1]]
        lengths = np.diff(grid)
        return cls(
            task=task,
            targets=targets,
            weights=1 / lengths,
            share=(lengths + np.roll(lengths, 1)) / 2,
            first=0 if free_start else 1,
            margin=margin + _INSIDE,
            stiffness=1e4,
            multipliers=np.zeros((len(targets), task.n)),
        )

    def excess(self, Q: Array, *, shifted: bool = True) -> Array:
        """Compute how far Q (K, n) exceeds the joint limits, narrowed by ``margin``: (K, n).

        The result is in rad or m, and negative below the lower limits. With ``shifted``, Q + λ/ρ is
        compared instead of Q: the result is e_k of the cost.
        """
        lower, upper = self.task.lower, self.task.upper
        if shifted:
            Q = Q + self.multipliers / (self.stiffness * self.share[:, None])
        kept = np.minimum(self.margin, (upper - lower) / 2)
        return Q - np.clip(Q, lower + kept, upper - kept)

    def value(self, Q: Array) -> float:
        """Evaluate the augmented Lagrangian of a cycle Q (K, n), up to a constant.

        Limits count only for configurations that are optimised.
        """
        chords = ((np.roll(Q, -1, axis=0) - Q) ** 2).sum(axis=1)
        beyond = (self.excess(Q)[self.first :] ** 2).sum(axis=1)
        stiff = self.stiffness * self.share[self.first :]
        return float(self.weights @ chords + stiff @ beyond) / 2

    def moved(self, Q: Array) -> Array | None:
        """Move Q (K, n) along J⁺ onto the path, except for a fixed start; None if that fails."""
        moved = _on_path(self.task, self.targets[self.first :], Q[self.first :])
        return None if moved is None else np.vstack([Q[: self.first], moved])

    def step(self, Q: Array, *, exact: bool) -> tuple[Array, float]:
        """Compute a Newton step (K, n) along the null space, and the decrease that it predicts.

        The decrease is that of the cost. The step begins at Q (K, n); a fixed start has the step 0.
        Each configuration moves along its self-motions ``q(a) = q + N a − ½ J⁺ (H N a) N a + …``
        with the unknowns a (r,), a basis N of the null space of J, and H = ∂J/∂q. The term of
        second order adds one block (r, r) per configuration to the Gauss–Newton matrix; the sum is
        Newton's matrix. If ``exact`` is False, each block is replaced by its positive semidefinite
        part, so that Newton's matrix is positive definite.

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
        gradient = (np.roll(ahead, 1, axis=0) - ahead)[first:] + stiff * beyond
        own = w + np.roll(w, 1) + _DAMPING * self.share
        diagonal = own[first:, None, None] * np.eye(N.shape[2])
        diagonal = diagonal + np.swapaxes(N, 1, 2) @ ((stiff * (beyond != 0))[:, :, None] * N)
        diagonal = diagonal + self._bent(free, inverse, N, gradient, exact=exact)
        upper = -w[first:, None, None] * (np.swapaxes(N, 1, 2) @ np.roll(N, -1, axis=0))
        slope = np.einsum("knr,kn->kr", N, gradient)
        a = solve_block_tridiagonal(diagonal, upper, -slope, cyclic=not first)
        step = np.vstack([np.zeros((first, Q.shape[1])), (N @ a[:, :, None])[:, :, 0]])
        return step, -float((slope * a).sum()) / 2

    def _bent(self, Q: Array, inverse: Array, N: Array, gradient: Array, *, exact: bool) -> Array:
        """Evaluate the blocks ``−Σ_a μ_a Nᵀ H_a N`` (K, r, r) of Newton's matrix.

        ``μ = J⁺ᵀ ∇`` are the multipliers of the path constraint, with the gradient ∇ of the cost;
        H_a are the second derivatives of task coordinate a by q. Q (K, n) are the configurations
        that are optimised. ``inverse`` is J⁺ (K, n, m), N (K, n, r) are null-space bases, and
        ``gradient`` (K, n) is ∇. Unless ``exact``, each block is replaced by its positive
        semidefinite part.
        """
        forces = np.einsum("kni,kn->ki", inverse, gradient)  # μ (K, m)
        bent = -np.einsum("ki,kiab->kab", forces, self.task.hessians(Q))
        bent = np.swapaxes(N, 1, 2) @ bent @ N
        bent = (bent + np.swapaxes(bent, 1, 2)) / 2
        return bent if exact else _convex(bent)


def _inverses(J: Array) -> tuple[Array, Array]:
    """Return J⁺ (K, n, m) and orthonormal bases N (K, n, r) of the null spaces of J (K, m, n)."""
    m = J.shape[1]
    basis, R = row_factor(J, mode="complete")
    inverse = np.swapaxes(np.linalg.solve(R[:, :m], np.swapaxes(basis[:, :, :m], 1, 2)), 1, 2)
    return inverse, basis[:, :, m:]


def _convex(blocks: Array) -> Array:
    """Replace the negative eigenvalues of symmetric matrices (K, r, r) by 0."""
    values, vectors = np.linalg.eigh(blocks)
    return (vectors * np.maximum(values, 0.0)[:, None, :]) @ np.swapaxes(vectors, 1, 2)


def _on_path(task: Task, targets: list[Placement], Q: Array) -> Array | None:
    """Move configurations Q (K, n) by Newton steps with J⁺ to ``targets``, one placement per row.

    Return None if a row comes to a singularity, or does not converge within 20 steps.
    """

    def correction(Q: Array, rows: NDArray[np.intp]) -> Array:
        errors = task.errors(Q, [targets[k] for k in rows])
        return (pseudoinverse(task.jacobians(Q)) @ errors[:, :, None])[:, :, 0]

    try:
        moved, last = newton_rows(correction, Q, longest=_LONGEST, tolerance=1e-7, iterations=20)
    except SingularityError:
        return None
    return moved if (last <= 1e-7).all() else None


def _descended(cost: _Cost, Q: Array) -> Array:
    """Minimise the cost, with constant multipliers, from Q (K, n); return the cycle (K, n).

    Newton's method with a line search is used; where Newton's matrix is not positive definite, a
    positive definite matrix replaces it.

    Raises
    ------
    SingularityError
        If the descent does not converge.
    """
    value = cost.value(Q)
    for _ in range(_ITERATIONS):
        try:
            step, decrease = cost.step(Q, exact=True)
        except np.linalg.LinAlgError:
            step, decrease = cost.step(Q, exact=False)
        size = float(np.abs(step).max())
        scale = min(1.0, _LONGEST / max(size, _LONGEST))
        trial = cost.moved(Q + scale * step)
        while trial is None or (cost.value(trial) >= value and scale * size > _SURE):
            scale /= 2
            if scale * size < _SURE / 10:
                raise SingularityError(f"the minimum of the joint speed was not found: {_NEAR}")
            trial = cost.moved(Q + scale * step)
        Q, value = trial, cost.value(trial)
        if size < _FLAT or decrease < _ROUNDING * value:
            return Q
    raise SingularityError(
        f"the minimum of the joint speed was not found in {_ITERATIONS} iterations: {_NEAR}"
    )


def _within_limits(cost: _Cost, Q: Array) -> Array:
    """Minimise the cost within the joint limits, from a cycle Q (K, n) on the path: (K, n).

    By the method of multipliers, each descent is followed by an update of the multipliers, and the
    stiffness is multiplied by five, until no configuration exceeds its limits.

    Raises
    ------
    InputError
        If no motion within the limits is found.
    SingularityError
        If the descent does not converge.
    """
    while True:
        Q = _descended(cost, Q)
        beyond = cost.excess(Q, shifted=False)[cost.first :]
        if np.abs(beyond).max() < _INSIDE / 2:
            return Q
        if cost.stiffness >= _STIFFEST:
            raise InputError(
                "no closed motion within the joint limits was found",
                remedy="choose another start or a smaller path",
            )
        stiff = cost.stiffness * cost.share[:, None]
        cost = replace(cost, multipliers=stiff * cost.excess(Q), stiffness=5 * cost.stiffness)
