"""The pseudoinverse J⁺ and the weighted pseudoinverse J⁺_M: what most arms run, and what drifts."""

from __future__ import annotations

from collections.abc import Callable
from math import prod
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg.blas import ddot
from scipy.linalg.lapack import dposv

from ..errors import InputError, SingularityError
from ..redundancy.inverses import RANK_TOLERANCE, pseudoinverse, weighted_pseudoinverse
from ..robot.inplace import in_place
from ..robot.task import Task, wanted_task
from .control_step import UNUSABLE, failure, vector

Array = NDArray[np.float64]


class Pseudoinverse:
    """Least joint speed: ``q̇ = J⁺ ẋ``, ``J⁺ = Jᵀ (J Jᵀ)⁻¹``. In general not repeatable.

    One for each thread: a velocity is worked out in memory of its own.
    """

    def __init__(self, task: Task) -> None:
        self.task = _redundant(task)
        self._quick = _velocity(task)

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
        InputError
            If a size is wrong or a number not finite.
        SingularityError
            Where J loses rank.
        """
        try:
            return self._quick(q, xdot)
        except UNUSABLE as error:
            if isinstance(error, InputError):
                raise
            task = self.task
            return self._quick(vector(task, q, "q", task.n), vector(task, xdot, "ẋ", task.m))

    def __getstate__(self) -> dict:
        return {"task": self.task}

    def __setstate__(self, state: dict) -> None:
        self.__init__(state["task"])  # type: ignore[misc]


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
        if isinstance(weight, str) and weight != "inertia":
            raise InputError(f"no weight named {weight!r}; give 'inertia', n numbers, a matrix or a function")
        self.weight: Any = weight if isinstance(weight, str) or callable(weight) else _positive(weight, task.n)

    def __call__(self, q: Array) -> Array:
        """Evaluate J⁺_M (n, m)."""
        return self.batch(np.asarray(q, float)[None])[0]

    def batch(self, Q: Array, J: Array | None = None) -> Array:
        """Evaluate J⁺_M at every row of Q (K, n): (K, n, m)."""
        J = self.task.jacobians(Q) if J is None else J
        return weighted_pseudoinverse(J, self._weights(np.asarray(Q, float)))

    def _weights(self, Q: Array) -> Array:
        """Evaluate M at every row of Q (K, n): (K, n, n), or (n, n) where it is the same everywhere."""
        if isinstance(self.weight, str):
            return self.task.inertias(Q)
        if callable(self.weight):
            return np.array([_positive(self.weight(q), self.task.n) for q in Q])
        return np.asarray(self.weight)

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


def _velocity(task: Task) -> Callable[[Array, Array], Array]:
    """Make the quick form of :func:`least_norm` for a task: closures and BLAS, see :mod:`control_step`."""
    m, n = task.m, task.n
    memory = np.zeros(m * n + m)
    J, rhs, gram = memory[: m * n].reshape(m, n), memory[m * n :], np.empty((m, m))
    multiply, J_T, gram_T, pivots = J.dot, J.T, gram.T, gram.ravel()[:: m + 1]
    jacobian = in_place(task, J, rhs).jacobian
    half, tolerance = m / 2, RANK_TOLERANCE

    def velocity(q: Array, xdot: Array) -> Array:
        if len(xdot) != m:
            raise ValueError
        jacobian(q)
        rhs[:] = xdot
        square = ddot(memory, memory)
        multiply(J_T, gram)
        _, y, info = dposv(gram_T, rhs, 0, 1)
        # The pivots p of J Jᵀ = L Lᵀ: ∏ p ≤ min p · max pᵐ⁻¹ and max p ≤ ‖J‖, so this is enough; else look closely.
        sure = not info and abs(prod(pivots.tolist())) > tolerance * square**half
        if not sure and (info or not (np.isfinite(y).all() and pivots.min() > tolerance * pivots.max())):
            raise failure(task, q, rhs, "the Jacobian loses rank: the arm is at a singularity")
        return y.dot(J)

    return velocity


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
    if wanted_task(task).r < 0:
        raise InputError(f"{task.frame!r} is moved by {task.n} joints, too few for a {task.kind} task (m = {task.m})")
    return task
