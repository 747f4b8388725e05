"""Law of the leaf lock in NumPy: one step of a repeatable inverse, with feedback to its leaf.

The leaf is the set h(q) = c on which the potentials h keep the arm, and c its level; the leaf lock
corrects c − h(q) as a controller corrects the task error. ẋ (m,) is the task velocity, f(q) is the
pose of the frame, and x − f(q) the task error (m,) of a target x. J_V = [J; Vᵀ] is the augmented
Jacobian, with V = ∂hᵀ/∂q. The law is written twice: in C (:mod:`.native_law`), the default, and
here. This version is the reference, and is used for what C does not support: user-defined
potentials, more than 64 joints. Numbers such as (31) are equations of the paper, see
docs/notation.md.

``Potentials`` are r functions h(q) that a repeatable controller holds constant. ``StepLimits`` are
the limits of a step: joint speeds (n,), and the maximum damping.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from ..base.arguments import Array
from ..base.errors import InputError
from ..model.task import Task
from ..potentials.basis import Potentials
from ..redundancy.augmented import augmented_inverse, is_regular
from .damping import damped
from .step_arguments import StepLimits, failure


class NumPyLaw:
    """The control law by the formulas of the paper: ``J_V = [J; Vᵀ]`` (37), and its inverse (31).

    It is made from a task and the potentials h. It has the same methods as :class:`NativeLaw`, and
    both give the same results. Arguments are checked by the caller.
    """

    def __init__(self, task: Task, potentials: Potentials) -> None:
        self.task = task
        self.potentials = potentials
        self.arm = None
        self._report = 0.0, 1.0

    def leaf(self, q: Array) -> Array:
        """Evaluate the level c = h(q) (r,) of the potentials, which identifies the leaf of q."""
        c = self.potentials.value(q)
        if not np.isfinite(c).all():
            raise InputError(
                "is so large that h(q) is not finite",
                argument="q",
                remedy="give a configuration within the joint limits",
            )
        return c

    def inverse(self, q: Array) -> Array:
        """Evaluate G_r (n, m), the repeatable inverse, at q (n,)."""
        if not np.isfinite(q).all():
            raise failure(self.task, q, q)
        J, V = self.task.jacobian(q), self.potentials.gradient(q)
        return augmented_inverse(J, V)[:, : self.task.m]

    def inverses(self, Q: Array) -> Array:
        """Evaluate G_r (K, n, m), the repeatable inverse, at the rows of Q (K, n).

        G_r is the first m columns of J_V⁻¹ (31).
        """
        J = self.task.jacobians(Q)
        V = self.potentials.gradients(Q)
        return augmented_inverse(J, V)[:, :, : self.task.m]

    def velocities(self, Q: Array, Xdot: Array) -> Array:
        """Compute q̇ (K, n) of the repeatable inverse at the rows of Q (K, n) and Ẋ (K, m)."""
        return (self.inverses(Q) @ Xdot[..., None])[..., 0]

    def velocity(self, q: Array, xdot: Array) -> Array:
        """Compute ``q̇ = J_V⁻¹ [ẋ; 0]`` (n,): the frame moves with ẋ, and h(q) stays constant."""
        still = np.zeros(self.task.r)
        return self._solved(q, self._augmented(q), np.concatenate([xdot, still]))

    def step(
        self,
        q: Array,
        target: pin.SE3,
        dt: float,
        twist: Array | None,
        leaf: Array | None,
        gain: float | None,
        limits: StepLimits | None,
    ) -> Array:
        """Compute ``q + J_V⁻¹ (dt [ẋ; 0] + K dt [x − f(q); c − h(q)])`` (n,), the next q.

        ``target`` is the placement x, and ``leaf`` the level c. ``twist`` is the velocity (v, ω) of
        the target, m/s and rad/s; its task coordinates are ẋ. If ``twist`` or ``leaf`` is None, its
        term is omitted. ``dt`` is in s. ``gain`` is K, 1/s; None removes the whole error in one
        step. With ``limits`` the step is damped near singularities, and shortened to the joint
        speed limits.
        """
        task = self.task
        share = 1.0 if gain is None else gain * dt
        J_V = self._augmented(q)
        x_error = task.error(q, target)
        still = np.zeros(task.r)
        c_error = still if leaf is None else leaf - self.potentials.value(q)
        rhs = share * np.concatenate([x_error, c_error])
        if twist is not None:
            if not np.isfinite(twist).all():
                raise failure(task, q, twist)
            rhs += dt * np.concatenate([task.task_velocity(q, twist), still])
        if limits is None:
            x, self._report = self._solved(q, J_V, rhs), (0.0, 1.0)
            return q + x
        x, used = self._damped(q, J_V, rhs, limits.damping)
        self._report = used, 1.0
        most = limits.velocity_limit * dt
        if not (np.abs(x) <= most).all():
            rhs[task.m :] = 0.0
            x_task, _ = self._damped(q, J_V, rhs, limits.damping)
            x, slowed = _within(x, x_task, most)
            self._report = used, slowed
        return q + x

    def report(self) -> tuple[float, float]:
        """Return (λ, factor) of the last step; (0, 1) if it had no ``limits``.

        λ is the damping, and the factor, 0 to 1, is that by which the step was shortened to the
        joint speed limits.
        """
        return self._report

    def _augmented(self, q: Array) -> Array:
        """Evaluate the augmented Jacobian J_V = [J; Vᵀ] (n, n); InputError if q is not finite."""
        if not np.isfinite(q).all():
            raise failure(self.task, q, q)
        with np.errstate(over="ignore", invalid="ignore"):  # tested when solved
            V = self.potentials.gradient(q)
        return np.concatenate([self.task.jacobian(q), V.T])

    def _solved(self, q: Array, J_V: Array, rhs: Array) -> Array:
        """Solve ``J_V x = rhs`` for the step x (n,); raise an error if that is not possible.

        The error is an InputError if ``rhs`` (n,) is not finite, and a SingularityError if J_V is
        singular or nearly so. The message contains q.
        """
        if not np.isfinite(rhs).all():
            raise failure(self.task, q, rhs)
        try:
            inverse = np.asarray(np.linalg.inv(J_V), float)
        except np.linalg.LinAlgError:
            raise failure(self.task, q, rhs) from None
        x = inverse @ rhs
        if not (np.isfinite(x).all() and is_regular(J_V, inverse)):
            raise failure(self.task, q, rhs)
        return x

    def _damped(self, q: Array, J_V: Array, rhs: Array, most: float) -> tuple[Array, float]:
        """Solve ``J_V x = rhs``, damped if ``most``, λ_max, is above 0; return x (n,) and λ.

        λ limits x near singularities, and is 0 away from them. Without damping a singularity raises
        an error.
        """
        if not most:
            return self._solved(q, J_V, rhs), 0.0
        x, used = damped(J_V, rhs, most)
        if not np.isfinite(x).all():
            raise failure(self.task, q, rhs)
        return x, used


def _within(x: Array, x_task: Array, most: Array) -> tuple[Array, float]:
    """Shorten a step ``x = x_task + x_leaf`` to the maximum step of each joint.

    The return to the leaf h(q) = c, x_leaf, is scaled down first, so that the task keeps its speed.
    If that is not enough, the whole step is scaled down.

    Parameters
    ----------
    x, x_task, most : (n,) arrays
        Step, its part that moves the frame, and maximum step of each joint, rad or m.

    Returns
    -------
    x : (n,) array
        Shortened step.
    slowed : float
        The smaller of the two factors, 0 to 1, by which x_leaf and the whole step were scaled.
    """
    x_leaf = x - x_task
    left = np.where(x_leaf > 0, most - x_task, most + x_task)
    moving = np.abs(x_leaf) > 1e-12
    share = float(np.clip((left[moving] / np.abs(x_leaf[moving])).min(initial=1.0), 0.0, 1.0))
    shorter = x_task + share * x_leaf
    whole = float((most / np.maximum(np.abs(shorter), 1e-300)).min(initial=1.0))
    return shorter * min(1.0, whole), min(share, whole)
