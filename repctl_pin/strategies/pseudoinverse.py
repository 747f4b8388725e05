"""The pseudoinverse J⁺, the weighted J⁺_M, and J⁺ with a posture held in the null space: what most
arms run."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from math import inf, prod
from typing import Any

import numpy as np
from numpy import ndarray
from numpy.typing import ArrayLike
from scipy.linalg.blas import ddot
from scipy.linalg.lapack import dposv

from ..arguments import (
    FLOAT,
    Array,
    as_configurations,
    as_matrices,
    as_numbers,
    positive,
    shown,
    vector,
)
from ..errors import InputError, SingularityError
from ..redundancy.inverses import pseudoinverse, weighted_pseudoinverse
from ..robot.fast_kinematics import in_place
from ..robot.task import Task, own_task
from ..threads import PerThread
from .control_step import failure

_WELL_CONDITIONED = 1e-2
"""Sine of the least angle of a row of J to the span of the others above which J Jᵀ serves."""


class Pseudoinverse:
    """Least joint speed: ``q̇ = J⁺ ẋ``, ``J⁺ = Jᵀ (J Jᵀ)⁻¹``. In general not repeatable.

    Raises
    ------
    InputError
        If the task has fewer joints than coordinates.
    SingularityError
        If it is evaluated at a singularity of J.

    Examples
    --------
    >>> G = rp.Pseudoinverse(task)
    >>> np.allclose(task.jacobian(q0) @ G(q0), np.eye(2))
    True
    >>> G.velocity(q0, [0.1, 0.0]).shape  # rad/s, for ẋ in m/s
    (3,)
    """

    def __init__(self, task: Task) -> None:
        self.task = redundant(task)
        self._quick = PerThread(partial(least_speed, self.task))

    def __call__(self, q: ArrayLike) -> Array:
        """Evaluate J⁺ (n, m)."""
        return pseudoinverse(self.task.jacobian(q))

    def batch(self, Q: ArrayLike, J: Array | None = None) -> Array:
        """Evaluate J⁺ at every row of Q (K, n): (K, n, m)."""
        return pseudoinverse(at_rows(self.task, Q, J)[1])

    def velocity(self, q: Array, xdot: Array) -> Array:
        """Choose ``q̇ = Jᵀ (J Jᵀ)⁻¹ ẋ`` (n,).

        Raises
        ------
        InputError
            If a size is wrong or a number not finite.
        SingularityError
            Where J loses rank.
        """
        return self._quick.own(q, xdot)

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.task,)


class WeightedInverse:
    """Least weighted joint speed: ``q̇ = J⁺_M ẋ`` minimises ``q̇ᵀ M q̇``.

    Parameters
    ----------
    task
        The task to control.
    weight
        M: n positive numbers (one per joint), a positive definite (n, n) matrix, a function of q
        that returns one, or ``"inertia"`` for the joint-space inertia (least kinetic energy).

    Raises
    ------
    InputError
        If the weight is none of these.

    Examples
    --------
    >>> G = rp.WeightedInverse(task, [4.0, 1.0, 1.0])  # the first joint costs four times as much
    >>> bool(abs(G.velocity(q0, [0.1, 0.0])[0]) < abs(control.velocity(q0, [0.1, 0.0])[0]))
    True
    """

    def __init__(self, task: Task, weight: ArrayLike | Callable[[Array], ArrayLike] | str) -> None:
        self.task = redundant(task)
        if isinstance(weight, str) and weight != "inertia":
            raise InputError(
                f"no weight named {weight!r}; give 'inertia', n numbers, a matrix or a function"
            )
        if isinstance(weight, str):
            _check_inertia(self.task)
        n = self.task.n
        self.weight: Any = (
            weight if isinstance(weight, str) or callable(weight) else _positive(weight, n)
        )

    def __call__(self, q: ArrayLike) -> Array:
        """Evaluate J⁺_M (n, m)."""
        return self.batch(vector(q, self.task.n, "q")[None])[0]

    def batch(self, Q: ArrayLike, J: Array | None = None) -> Array:
        """Evaluate J⁺_M at every row of Q (K, n): (K, n, m)."""
        Q, J = at_rows(self.task, Q, J)
        return weighted_pseudoinverse(J, self._weights(Q))

    def _weights(self, Q: Array) -> Array:
        """Evaluate M at every row of Q (K, n): (K, n, n), or (n, n) where it is the same
        everywhere."""
        if isinstance(self.weight, str):
            return self.task.inertias(Q)
        if callable(self.weight):
            return np.array([_positive(self.weight(q), self.task.n) for q in Q])
        return np.asarray(self.weight)

    def velocity(self, q: ArrayLike, xdot: ArrayLike) -> Array:
        """Choose ``q̇ = J⁺_M ẋ`` (n,)."""
        return self(q) @ vector(xdot, self.task.m, "ẋ", "m/s and rad/s")


def least_speed(
    task: Task, pull: Callable[[Array], Array] | None = None
) -> Callable[[Array, Array], Array]:
    """Make the quick ``q̇ = z + J⁺ (ẋ − J z)``, ``J⁺ = Jᵀ (J Jᵀ)⁻¹``: closures and BLAS, see
    :mod:`control_step`.

    Parameters
    ----------
    task
        What is controlled.
    pull : function q (n,) → z (n,), optional
        The joint velocity to come near to; by default 0, and ``q̇ = J⁺ ẋ``.
    """
    m, n = task.m, task.n
    of_joints, of_task = (n,), (m,)
    J, rhs, gram = np.zeros((m, n)), np.zeros(m), np.empty((m, m))
    multiply, J_T, gram_T, pivots = J.dot, J.T, gram.T, gram.ravel()[:: m + 1]
    jacobian = in_place(task, J, rhs).jacobian
    tolerance = _WELL_CONDITIONED**2

    def velocity(q: Array, xdot: Array) -> Array:
        if not (type(q) is ndarray and q.dtype is FLOAT and q.shape == of_joints):
            q = vector(q, n, "q")
        if not (type(xdot) is ndarray and xdot.dtype is FLOAT and xdot.shape == of_task):
            xdot = vector(xdot, m, "ẋ", "m/s and rad/s")
        jacobian(q)
        rhs[:] = xdot
        z = None if pull is None else pull(q)
        if z is not None:
            rhs[:] -= multiply(z)
        multiply(J_T, gram)
        squares = prod(pivots.tolist())  # of the rows' norms, whatever their units
        _, y, info = dposv(gram_T, rhs, 0, 1)
        # The pivots p of J Jᵀ = L Lᵀ: ∏ p ≤ sin θ ∏ ‖row‖, θ the least angle of a row to the span
        # of the others. NaN
        # fails it, in ẋ the second test. Near a singularity J Jᵀ, which squares the condition of J,
        # will not do.
        if not info and prod(pivots.tolist()) ** 2 > tolerance * squares and ddot(y, y) < inf:
            return y.dot(J) if z is None else z + y.dot(J)
        if not (np.isfinite(q).all() and np.isfinite(xdot).all()):
            raise failure(task, q, xdot)
        try:
            G = pseudoinverse(J)
            return G @ xdot if z is None else z + G @ (xdot - J @ z)
        except (SingularityError, np.linalg.LinAlgError) as error:
            raise failure(task, q, xdot, str(error)) from None

    return velocity


def _positive(weight: ArrayLike, n: int) -> Array:
    """Check a weight: n numbers or an (n, n) symmetric positive definite matrix."""
    M = as_numbers(weight)
    if M is None:
        raise InputError(
            f"the weight must be {n} numbers or a {n} × {n} matrix, not {shown(weight)}"
        )
    M = np.diag(M) if M.shape == (n,) else M
    if M.shape != (n, n) or not np.isfinite(M).all() or not np.allclose(M, M.T):
        raise InputError(
            f"the weight must be {n} numbers or a symmetric {n} × {n} matrix, all finite"
        )
    if np.linalg.eigvalsh(M)[0] <= 0:
        raise InputError("the weight must be positive definite; every joint needs a weight above 0")
    return M


def _check_inertia(task: Task) -> None:
    """Refuse the inertia as a weight where a joint moves nothing that has any."""
    own = np.diagonal(task.inertias(task.reference[None])[0])
    light = own <= 1e-12 * own.max()
    if light.any():
        name = task.joint_names[int(np.argmax(light))]
        link = (
            f"; link {task.robot.joints[name].child!r} needs an <inertial>"
            if name in task.robot.joints
            else ""
        )
        raise InputError(
            f"nothing that {name} moves has a mass or an inertia, so there is no 'inertia' weight{link}"
        )


def at_rows(task: Task, Q: ArrayLike, J: Array | None) -> tuple[Array, Array]:
    """Take configurations Q (K, n), and J (K, m, n) there where it is at hand already."""
    Q = as_configurations(Q, task.n, "batch()")
    if J is None:
        return Q, task.jacobians(Q)
    (J,) = as_matrices(("J", J, f"{len(Q)} {task.m} {task.n}"), exact=True)
    return Q, J


def redundant(value: Any) -> Task:
    """Take a task for oneself, see :func:`own_task`; one with fewer joints than coordinates has no
    right inverse."""
    task = own_task(value)
    if task.r < 0:
        raise InputError(
            f"{task.frame!r} is moved by {task.n} joints, too few for a {task.kind} task (m = {task.m})"
        )
    return task


class PostureControl:
    """``q̇ = J⁺ ẋ + (I − J⁺ J) K (q_p − q)``: track, and pull towards a posture in the null space.

    Cycles close after a while if it starts on the posture. Started elsewhere it first moves there:
    in a jump with a high gain, slowly with a low one.

    Parameters
    ----------
    task
        The task to control.
    posture : (n,) array
        q_p, the posture to hold, rad (m for sliding joints).
    gain : float
        K in 1/s.

    Raises
    ------
    InputError
        If the posture has not n numbers, or the gain is negative.

    Examples
    --------
    >>> hold = rp.PostureControl(task, q0, gain=2.0)  # 1/s
    >>> hold.velocity(q0 + 0.1, [0.0, 0.0]).round(3)  # rad/s: back to the posture, the tool at rest
    array([-0.018,  0.041, -0.041])
    """

    def __init__(self, task: Task, posture: ArrayLike, gain: float = 1.0) -> None:
        self.task, self.posture = redundant(task), vector(posture, task.n, "a posture")
        self.gain = positive(gain, "the gain of a posture", "1/s", zero=True)
        self._quick = PerThread(partial(least_speed, self.task, self._pull))

    def velocity(self, q: Array, xdot: Array) -> Array:
        """Choose q̇ (n,) for a task velocity ẋ (m,)."""
        return self._quick.own(q, xdot)

    def _pull(self, q: Array) -> Array:
        return self.gain * (self.posture - q)

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.task, self.posture, self.gain)
