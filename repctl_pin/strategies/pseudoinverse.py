"""The pseudoinverse J⁺, the weighted J⁺_M, and minimum joint speed with a null-space motion.

J (m, n) is the Jacobian of the task, M (n, n) the weight of the joint speeds, and ẋ (m,) the task
velocity. A posture is a configuration to which the joints are pulled without moving the frame.
"""

from __future__ import annotations

from collections.abc import Callable
from ctypes import byref, c_long, c_void_p
from functools import partial
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from ..base.arguments import Array, as_configurations, as_matrices, as_numbers, shown, vector
from ..base.errors import InputError, SingularityError
from ..base.threads import PerThread
from ..model.task import Task, own_task
from ..native import library
from ..redundancy.inverses import pseudoinverse, weighted_pseudoinverse
from .native_arm import library_arm
from .native_law import call_memory, holding_library
from .step_arguments import as_joints, as_velocity_arguments, failure
from .strategy import described


class Pseudoinverse:
    """Minimum joint speed: ``q̇ = J⁺ ẋ``, ``J⁺ = Jᵀ (J Jᵀ)⁻¹``. In general not repeatable.

    This is the usual controller, with which all others are compared.

    Raises
    ------
    InputError
        If the task has fewer joints than coordinates.
    SingularityError
        If J is singular where it is evaluated.

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
        self._inverse = PerThread(partial(_least_inverse, self.task))
        self._inverses = PerThread(partial(_least_inverses, self.task))

    def __repr__(self) -> str:
        return described(self, self.task)

    def __call__(self, q: ArrayLike) -> Array:
        """Evaluate J⁺ (n, m), the pseudoinverse of the Jacobian, at q (n,)."""
        return self._inverse.own(as_joints(q, self.task.n))

    def batch(self, Q: ArrayLike, J: ArrayLike | None = None) -> Array:
        """Evaluate J⁺ at every row of Q (K, n): (K, n, m).

        J (K, m, n) are the Jacobians at these rows, if they are known already.
        """
        return self._inverses.own(at_rows(self.task, Q, J)[1])

    def velocity(self, q: ArrayLike, xdot: ArrayLike) -> Array:
        """Compute ``q̇ = Jᵀ (J Jᵀ)⁻¹ ẋ`` (n,).

        Raises
        ------
        InputError
            If a size is wrong or a number is not finite.
        SingularityError
            If J loses rank at q.
        """
        n, m = self.task.n, self.task.m
        return self._quick.own(*as_velocity_arguments(q, xdot, n, m))


class WeightedInverse:
    """Minimum weighted joint speed: ``q̇ = J⁺_M ẋ`` minimises ``q̇ᵀ M q̇``.

    Parameters
    ----------
    task
        The task to control.
    weight
        M: n positive numbers (one per joint), a positive definite (n, n) matrix, a function of q
        that returns either, or ``"inertia"`` for the joint-space inertia (minimum kinetic energy).

    Raises
    ------
    InputError
        If the weight is none of these, or not positive.

    Examples
    --------
    >>> G = rp.WeightedInverse(task, [4.0, 1.0, 1.0])  # the first joint costs four times as much
    >>> bool(abs(G.velocity(q0, [0.1, 0.0])[0]) < abs(control.velocity(q0, [0.1, 0.0])[0]))
    True
    """

    def __init__(
        self, task: Task, weight: Literal["inertia"] | ArrayLike | Callable[[Array], ArrayLike]
    ) -> None:
        self.task = redundant(task)
        if isinstance(weight, str) and weight != "inertia":
            raise InputError(
                f"there is no weight named {weight!r}; give 'inertia', {task.n} numbers, "
                f"a {task.n} × {task.n} matrix or a function of q"
            )
        if isinstance(weight, str):
            _check_inertia(self.task)
        n = self.task.n
        self.weight: Any = (
            weight if isinstance(weight, str) or callable(weight) else _weight_matrix(weight, n)
        )

    def __repr__(self) -> str:
        if isinstance(self.weight, str):
            return described(self, self.task, "weight 'inertia'")
        return described(
            self, self.task, "weight a function of q" if callable(self.weight) else "constant M"
        )

    def __call__(self, q: ArrayLike) -> Array:
        """Evaluate J⁺_M (n, m), the inverse of minimum ``q̇ᵀ M q̇``, at q (n,)."""
        return self.batch(vector(q, self.task.n, "q")[None])[0]

    def batch(self, Q: ArrayLike, J: ArrayLike | None = None) -> Array:
        """Evaluate J⁺_M at every row of Q (K, n): (K, n, m).

        J (K, m, n) are the Jacobians at these rows, if they are known already.
        """
        Q, J = at_rows(self.task, Q, J)
        return weighted_pseudoinverse(J, self._weights(Q))

    def _weights(self, Q: Array) -> Array:
        """Evaluate the weight matrix M at every row of Q: (K, n, n), or (n, n) if constant.

        According to the given weight, M is the arm's inertia matrix, a function of q, or constant.
        """
        if isinstance(self.weight, str):
            return self.task.inertias(Q)
        if callable(self.weight):
            return np.array([_weight_matrix(self.weight(q), self.task.n) for q in Q])
        return np.asarray(self.weight)

    def velocity(self, q: ArrayLike, xdot: ArrayLike) -> Array:
        """Compute ``q̇ = J⁺_M ẋ`` (n,), which minimises ``q̇ᵀ M q̇``, for ẋ (m,)."""
        return self(q) @ vector(xdot, self.task.m, "ẋ", "m/s and rad/s")


def least_speed(
    task: Task, posture: Array | None = None, gain: float = 0.0
) -> Callable[[Array, Array], Array]:
    """Create the function (q, ẋ) → ``q̇ = z + J⁺ (ẋ − J z)`` with ``z = K (q_p − q)``.

    Each thread requires a function of its own. q̇ is computed in C (least_speed.c), or in NumPy if
    there is no native library or C fails; NumPy's error then names the cause.

    Parameters
    ----------
    task
        Task to control.
    posture, gain
        Posture q_p (n,) and gain K, 1/s; without a posture, z is 0.
    """
    arm = library_arm(task)
    given = {} if posture is None else {"posture": posture}

    def plain(q: Array, xdot: Array) -> Array:
        if not (np.isfinite(q).all() and np.isfinite(xdot).all()):
            raise failure(task, q, xdot)
        J = task.jacobian(q)
        z = np.zeros(task.n) if posture is None else gain * (posture - q)
        try:
            return z + pseudoinverse(J) @ (xdot - J @ z)
        except (SingularityError, np.linalg.LinAlgError) as error:
            raise failure(task, q, xdot, str(error)) from None

    if arm is None:
        return plain
    parts, call = call_memory(task, arm, **given)
    q_in = parts["q"]
    xdot_in = parts["xdot"]
    result = parts["result"]
    parts["numbers"][1] = gain
    run = holding_library().call_least_speed

    def velocity(q: Array, xdot: Array) -> Array:
        q_in[:] = q
        xdot_in[:] = xdot
        return result.copy() if run(call) else plain(q, xdot)

    return velocity


def _least_inverse(task: Task) -> Callable[[Array], Array]:
    """Create the function q → J⁺ (n, m), in C or else NumPy; each thread requires its own."""
    arm = library_arm(task)

    def plain(q: Array) -> Array:
        return pseudoinverse(task.jacobian(q))

    if arm is None:
        return plain
    parts, call = call_memory(task, arm)
    q_in = parts["q"]
    result = parts["inverse"].reshape(task.n, task.m)
    run = holding_library().call_least_inverse

    def inverse(q: Array) -> Array:
        q_in[:] = q
        return result.copy() if run(call) else plain(q)

    return inverse


def _least_inverses(task: Task) -> Callable[[Array], Array]:
    """Create the function J (K, m, n) → J⁺ (K, n, m), in C or, where C fails, in NumPy.

    NumPy's error then names the number of configurations at which J loses rank.
    """
    arm, native = library_arm(task), library()
    if arm is None or native is None:
        return pseudoinverse

    def inverses(J: Array) -> Array:
        J = np.ascontiguousarray(J, float)
        K, m, n = J.shape
        G = np.empty((K, n, m))
        J_at, G_at = c_void_p(J.ctypes.data), c_void_p(G.ctypes.data)
        done = native.call_least_inverses(byref(arm), c_long(K), J_at, G_at)
        return G if done == K else pseudoinverse(J)

    return inverses


def _weight_matrix(weight: ArrayLike, n: int) -> Array:
    """Check a weight and return it as a matrix M (n, n).

    The weight can be n positive numbers, which become the diagonal, or a symmetric positive
    definite (n, n) matrix. InputError is raised for others: ``q̇ᵀ M q̇`` would have no minimum.
    """
    M = as_numbers(weight)
    if M is None:
        raise InputError(
            f"the weight must be {n} numbers or a {n} × {n} matrix, not {shown(weight)}"
        )
    M = np.diag(M) if M.shape == (n,) else M
    if M.shape != (n, n):
        raise InputError(
            f"the weight has shape {M.shape}; give {n} numbers or a symmetric {n} × {n} matrix"
        )
    if not np.isfinite(M).all():
        raise InputError("the weight contains nan or inf; give finite numbers")
    if not np.allclose(M, M.T):
        raise InputError(
            f"the weight M is not symmetric: it differs from M.T by {np.abs(M - M.T).max():.2g}; "
            "give (M + M.T) / 2"
        )
    least = np.linalg.eigvalsh(M)[0]
    if least <= 0:
        raise InputError(
            f"the weight is not positive definite: its smallest eigenvalue is {least:.3g}; "
            "give every joint a weight above 0"
        )
    return M


def _check_inertia(task: Task) -> None:
    """Raise InputError if a joint moves no mass: the inertia is then no positive weight.

    The message names the joint and the link that lacks an ``<inertial>``.
    """
    own = np.diagonal(task.inertias(task.reference[None])[0])
    light = own <= 1e-12 * own.max()
    if light.any():
        name = task.joint_names[int(np.argmax(light))]
        link = (
            f"; give link {task.robot.joints[name].child!r} an <inertial> in the model"
            if name in task.robot.joints
            else ""
        )
        raise InputError(
            f"the weight 'inertia' is not positive definite: no link that {name} moves has a mass "
            f"or an inertia{link}"
        )


def at_rows(task: Task, Q: ArrayLike, J: ArrayLike | None) -> tuple[Array, Array]:
    """Check configurations Q (K, n), and return them with their Jacobians J (K, m, n).

    A given J is checked; otherwise J is evaluated. All inverses use this function in ``batch``.
    """
    Q = as_configurations(Q, task.n, "batch()")
    if J is None:
        return Q, task.jacobians(Q)
    (stacked,) = as_matrices(("J", J, f"{len(Q)} {task.m} {task.n}"), exact=True)
    return Q, stacked


def redundant(value: Any) -> Task:
    """Copy a task with memory of its own, for use in another thread, and require n ≥ m.

    InputError is raised if the task has fewer joints than coordinates: then no G has J G = I.
    """
    task = own_task(value)
    if task.r < 0:
        raise InputError(
            f"{task.frame!r} is moved by {task.n} joints, "
            f"too few for a {task.kind} task (m = {task.m})",
            remedy="use a kind of task with fewer coordinates",
        )
    return task
