"""The pseudoinverse J⁺ and the weighted pseudoinverse J⁺_M: what most arms run, and what drifts."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg.lapack import dposv

from ..errors import InputError, SingularityError
from ..redundancy.inverses import RANK_TOLERANCE, pseudoinverse, weighted_pseudoinverse
from ..robot.task import Task

Array = NDArray[np.float64]


class Pseudoinverse:
    """Least joint speed: ``q̇ = J⁺ ẋ``, ``J⁺ = Jᵀ (J Jᵀ)⁻¹``. In general not repeatable."""

    def __init__(self, task: Task) -> None:
        self.task = _redundant(task)

    def __call__(self, q: Array) -> Array:
        """Evaluate J⁺ (n, m)."""
        return pseudoinverse(self.task.jacobian(q))

    def batch(self, Q: Array, J: Array | None = None) -> Array:
        """Evaluate J⁺ at every row of Q (K, n): (K, n, m)."""
        return pseudoinverse(self.task.jacobians(Q) if J is None else J)

    def velocity(self, q: Array, xdot: Array) -> Array:
        """Choose ``q̇ = Jᵀ (J Jᵀ)⁻¹ ẋ`` (n,).

        Raises
        ------
        SingularityError
            Where J loses rank.
        """
        return least_norm(self.task.jacobian(q), xdot)


class WeightedInverse:
    """Least weighted joint speed: ``q̇ = J⁺_M ẋ`` minimises ``q̇ᵀ M q̇``.

    Parameters
    ----------
    task
        The task to control.
    weight
        M: n positive numbers (one a joint), a positive definite (n, n) matrix, a function of q that
        returns one, or ``"inertia"`` for the joint-space inertia (least kinetic energy).

    Raises
    ------
    InputError
        If the weight is none of these.
    """

    def __init__(self, task: Task, weight: ArrayLike | Callable[[Array], ArrayLike] | str) -> None:
        self.task = _redundant(task)
        self._weights: Callable[[Array], Array]
        if isinstance(weight, str):
            if weight != "inertia":
                raise InputError(f"no weight named {weight!r}; give 'inertia', n numbers, a matrix or a function")
            self._weights = task.inertias
        elif callable(weight):
            self._weights = lambda Q: np.array([_positive(weight(q), task.n) for q in Q])
        else:
            M = _positive(weight, task.n)
            self._weights = lambda Q: M

    def __call__(self, q: Array) -> Array:
        """Evaluate J⁺_M (n, m)."""
        return self.batch(np.asarray(q, float)[None])[0]

    def batch(self, Q: Array, J: Array | None = None) -> Array:
        """Evaluate J⁺_M at every row of Q (K, n): (K, n, m)."""
        J = self.task.jacobians(Q) if J is None else J
        return weighted_pseudoinverse(J, self._weights(np.asarray(Q, float)))

    def velocity(self, q: Array, xdot: Array) -> Array:
        """Choose ``q̇ = J⁺_M ẋ`` (n,)."""
        return self(q) @ xdot


def least_norm(J: Array, xdot: Array) -> Array:
    """Solve ``J q̇ = ẋ`` for the shortest q̇ (n,), one LAPACK call: ``q̇ = Jᵀ (J Jᵀ)⁻¹ ẋ``.

    Raises
    ------
    SingularityError
        Where J loses rank.
    """
    L, y, info = dposv(J @ J.T, xdot)
    pivots = L.diagonal()
    if info or pivots.min() < RANK_TOLERANCE * pivots.max():
        raise SingularityError("the Jacobian loses rank: the arm is at a singularity")
    return y @ J


def _positive(weight: ArrayLike, n: int) -> Array:
    """Check a weight: n numbers or an (n, n) symmetric positive definite matrix."""
    M = np.asarray(weight, float)
    M = np.diag(M) if M.shape == (n,) else M
    if M.shape != (n, n) or not np.isfinite(M).all() or not np.allclose(M, M.T):
        raise InputError(f"the weight must be {n} numbers or a symmetric {n} × {n} matrix, all finite")
    if np.linalg.eigvalsh(M)[0] <= 0:
        raise InputError("the weight must be positive definite; every joint needs a weight above 0")
    return M


def _redundant(task: Task) -> Task:
    """Refuse a task with fewer joints than coordinates: it has no right inverse."""
    if task.r < 0:
        raise InputError(f"{task.frame!r} is moved by {task.n} joints, too few for a {task.kind} task (m = {task.m})")
    return task
