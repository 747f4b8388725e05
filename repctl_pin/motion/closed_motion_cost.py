"""Newton's method in the null space, for the closed motion of minimum joint speed on a path."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array, read_only
from ..errors import InputError, SingularityError
from ..model.chain_formulas import Placement
from ..model.task import Task
from ..paths.task_path import TaskPath
from ..redundancy.inverses import pseudoinverse, row_factor
from ..solvers import newton_rows, solve_block_tridiagonal

LONGEST = 0.3
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
"""Penalty weight ``stiffness`` of violated limits from which the search fails."""

_NEAR = "the motion comes near a singularity, or there are too few steps"


@dataclass(frozen=True, eq=False)
@read_only
class ClosedMotionCost:
    """Augmented Lagrangian of a discrete closed motion, the K configurations q_k of one cycle.

    ``½ Σ w_k ‖q_{k+1} − q_k‖² + ½ Σ ρ_k ‖e_k‖²``, where ``e_k`` is the excess of
    ``T q_k + λ_k / ρ_k`` over the joint limits less ``margin``, T the task's coordinate matrix, λ_k
    the multipliers, w_k the inverse of the step length in s, and ρ_k the stiffness times the
    point's share of the cycle. ``first`` is the index of the first configuration that is free: 0,
    or 1 if the start is fixed.
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
        cls,
        task: Task,
        path: TaskPath,
        grid: Array,
        *,
        free_start: bool,
        margin: float = 0.0,
    ) -> ClosedMotionCost:
        """Create the cost at the points s = ``grid`` of a path, with multipliers 0."""
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
        """Excess of joint positions over the joint limits less the margin: (K, n), 0 inside.

        If ``shifted``, the positions are those in the augmented Lagrangian, shifted by λ_k / ρ_k.
        """
        lower, upper, _ = self.task.joint_limits
        joints = self.task.joints(Q)
        if shifted:
            joints = joints + self.multipliers / (self.stiffness * self.share[:, None])
        kept = np.minimum(self.margin, (upper - lower) / 2)
        return joints - np.clip(joints, lower + kept, upper - kept)

    def value(self, Q: Array) -> float:
        """Evaluate the augmented Lagrangian, up to a constant."""
        chords = ((np.roll(Q, -1, axis=0) - Q) ** 2).sum(axis=1)
        beyond = (self.excess(Q)[self.first :] ** 2).sum(axis=1)
        stiff = self.stiffness * self.share[self.first :]
        return float(self.weights @ chords + stiff @ beyond) / 2

    def moved(self, Q: Array) -> Array | None:
        """Move configurations (K, n) along J⁺ onto the path; None if one of them fails."""
        moved = on_path(self.task, self.targets[self.first :], Q[self.first :])
        return None if moved is None else np.vstack([Q[: self.first], moved])

    def step(self, Q: Array, *, exact: bool) -> tuple[Array, float]:
        """Compute a Newton step (K, n) along the null space, and its predicted decrease.

        Self-motions are ``q(a) = q + N a − ½ J⁺ (H N a) N a + …``, so that Newton's matrix is the
        Gauss–Newton matrix plus the blocks ``−λᵀ (H N) N`` with ``λ = J⁺ᵀ ∇``, ∇ the gradient of
        the cost. Unless ``exact``, only the convex parts of these blocks are used, and the matrix
        is positive definite.

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
        own = w + np.roll(w, 1) + _DAMPING * self.share
        diagonal = own[first:, None, None] * np.eye(N.shape[2])
        diagonal = diagonal + np.swapaxes(TN, 1, 2) @ (
            (stiff * (beyond != 0))[:, :, None] * TN
        )
        forces = np.einsum("kni,kn->ki", inverse, gradient)  # λ (K, m)
        bent = -np.einsum("ki,kiab->kab", forces, self.task.hessians(free))
        bent = np.swapaxes(N, 1, 2) @ bent @ N
        bent = (bent + np.swapaxes(bent, 1, 2)) / 2
        diagonal = diagonal + (bent if exact else _convex(bent))
        upper = -w[first:, None, None] * (np.swapaxes(N, 1, 2) @ np.roll(N, -1, axis=0))
        slope = np.einsum("knr,kn->kr", N, gradient)
        a = solve_block_tridiagonal(diagonal, upper, -slope, cyclic=not first)
        step = np.vstack([np.zeros((first, Q.shape[1])), (N @ a[:, :, None])[:, :, 0]])
        return step, -float((slope * a).sum()) / 2


def _inverses(J: Array) -> tuple[Array, Array]:
    """Evaluate J⁺ (K, n, m) and N (K, n, r) of Jacobians (K, m, n)."""
    m = J.shape[1]
    basis, R = row_factor(J, mode="complete")
    inverse = np.swapaxes(
        np.linalg.solve(R[:, :m], np.swapaxes(basis[:, :, :m], 1, 2)), 1, 2
    )
    return inverse, basis[:, :, m:]


def _convex(blocks: Array) -> Array:
    """Replace the negative eigenvalues of symmetric blocks (K, r, r) by 0."""
    values, vectors = np.linalg.eigh(blocks)
    return (vectors * np.maximum(values, 0.0)[:, None, :]) @ np.swapaxes(vectors, 1, 2)


def on_path(task: Task, targets: list[Placement], Q: Array) -> Array | None:
    """Move configurations (K, n) along J⁺ to their target placements; None if one of them fails."""

    def correction(Q: Array, rows: NDArray[np.intp]) -> Array:
        errors = task.errors(Q, [targets[k] for k in rows])
        return (pseudoinverse(task.jacobians(Q)) @ errors[:, :, None])[:, :, 0]

    try:
        moved, last = newton_rows(
            correction, Q, longest=LONGEST, tolerance=1e-7, iterations=20
        )
    except SingularityError:
        return None
    return moved if (last <= 1e-7).all() else None


def _descended(cost: ClosedMotionCost, Q: Array) -> Array:
    """Minimise the cost from Q (K, n) by Newton's method with a line search: (K, n).

    Where Newton's matrix is not positive definite, its convex approximation is used.

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
        scale = min(1.0, LONGEST / max(size, LONGEST))
        trial = cost.moved(Q + scale * step)
        while trial is None or (cost.value(trial) >= value and scale * size > _SURE):
            scale /= 2
            if scale * size < _SURE / 10:
                raise SingularityError(f"the minimum was not found: {_NEAR}")
            trial = cost.moved(Q + scale * step)
        Q, value = trial, cost.value(trial)
        if size < _FLAT or decrease < _ROUNDING * value:
            return Q
    raise SingularityError(f"the minimum was not found in {_ITERATIONS} steps: {_NEAR}")


def within_limits(cost: ClosedMotionCost, Q: Array) -> Array:
    """Minimise the cost within the joint limits by the method of multipliers: (K, n).

    The search begins at Q (K, n), which is on the path.

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
        cost = replace(
            cost, multipliers=stiff * cost.excess(Q), stiffness=5 * cost.stiffness
        )
