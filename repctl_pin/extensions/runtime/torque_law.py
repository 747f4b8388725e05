"""Torque law of :class:`LeafImpedance`: in C, and in NumPy as plain formulas.

The end effector moves as if held by a spring and a damper, and the joints are pulled to the leaf
h(q) = c. C is fast enough for a loop at 1 kHz; NumPy is the reference, and replaces C where C
cannot be used. The r potentials h are those that a repeatable inverse keeps constant, and c (r,) is
the level of the leaf. Letters: x, the pose of the frame; ẋ (m,), its task velocity; J (m, n), the
task Jacobian; V (n, r), the gradients of h; J_V = [J; Vᵀ] (n, n).

``Potentials`` are r functions h(q) that a repeatable controller holds constant. ``Observer`` is the
state of a disturbance observer, which estimates what moves the joints off their leaf. ``Gains`` are
the gains of the torque law: stiffness, damping ratios, leaf frequency, and those of the observer.
``NumPyTorques`` is the torque law in NumPy.
"""

from __future__ import annotations

import ctypes
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from ...base.arguments import Array
from ...base.errors import InputError, SingularityError
from ...model.task import Task
from ...native import TORQUE_CALL, filled_struct, required_library
from ...potentials.basis import Potentials
from ...redundancy.augmented import augmented_inverse
from ...strategies.step_arguments import failure

_DIFFERENCE = 1e-3
"""Length of the two steps ±Δq of the central difference along q̇, rad or m."""


class Gains(NamedTuple):
    """Gains of the torque law; see :class:`repctl_pin.extensions.runtime.impedance.LeafImpedance`.

    Attributes
    ----------
    stiffness : (m,) array
        Stiffness K for each row of J, N/m or Nm/rad.
    damping, leaf_frequency, leaf_damping, observer_rate : float
        Damping ratio ζ of the end effector; frequency ω, rad/s, and damping ratio ζ_h of the return
        to the leaf; and the rate κ of the observer, 1/s.
    observer_limit : (n,) array
        Maximum torque of the observer on each joint, Nm or N.
    """

    stiffness: Array
    damping: float
    leaf_frequency: float
    leaf_damping: float
    observer_rate: float
    observer_limit: Array


class Observer(NamedTuple):
    """Disturbance observer of one arm: it estimates what moves the joints off their leaf h(q) = c.

    Attributes
    ----------
    state : (r,) array
        Rate ḣ, per second, that is to be expected without a disturbance: w in the formulas of
        :class:`NumPyTorques`. The torque law updates it in each call.
    dt : float
        Time step of the loop, s.
    """

    state: Array
    dt: float

    def reset(self) -> None:
        """Set the state to 0, because after a stop of the robot the estimate is no longer valid."""
        self.state[...] = 0.0


class NumPyTorques:
    """Torque law in NumPy as plain formulas, the reference for the law in C.

    ``τ = M J_V⁻¹ ([ẍ; ḧ − d] − J̇_V q̇) + b`` with ``J_V = [J; Vᵀ]`` and the gradients V of the
    potentials h: the end effector accelerates by ẍ and the potentials by ḧ, independently. M is the
    joint-space inertia, and b contains gravity and velocity terms.

    ``ẍ = Λ⁻¹ F``, ``F = K e + D (ẋ* − ẋ)``, with the task error e, the velocity ẋ* to follow, and
    ``Λ⁻¹ = J M⁻¹ Jᵀ``. D gives every mode the damping ratio ζ: with ``A = √K Λ⁻¹ √K``, the law is
    ``√K ẍ = A √K e + 2 ζ A^½ √K (ẋ* − ẋ)``.

    ``ḧ = ω² (c − h) − 2 ζ_h ω ḣ``. The observer's estimate of the disturbance of ḧ is
    ``d = κ (ḣ − w)``, with its state ``ẇ = ḧ``. The torque against d is scaled down until no joint
    exceeds its limit; w then also moves toward ḣ, so that the estimate stays near the limit. K, ζ,
    ω, ζ_h and κ are the numbers of :class:`Gains`.
    """

    def __init__(self, task: Task, potentials: Potentials, gains: Gains) -> None:
        self._task, self._potentials, self._gains = task, potentials, gains

    def __call__(
        self,
        q: Array,
        qdot: Array,
        M: Array,
        b: Array,
        target: pin.SE3,
        twist: Array | None,
        leaf: Array,
        observer: Observer | None,
    ) -> Array:
        """Compute the torques τ (n,), Nm or N, and update the observer's state.

        q and q̇ (n,) are joint positions and velocities, M (n, n) and b (n,) inertia and bias, and
        ``leaf`` (r,) is the level c. ``target`` is the pose to follow, ``twist`` (v, ω) its
        velocity, (6,) per frame; None is 0. InputError is raised for numbers that overflow, and
        SingularityError where J_V is singular.
        """
        task, gains, m = self._task, self._gains, self._task.m
        e = task.error(q, target)
        J_V = self._augmented(q)
        rates = J_V @ qdot  # (ẋ, ḣ)
        lag = (0.0 if twist is None else task.task_velocity(q, twist)) - rates[:m]
        xddot = self._task_acceleration(J_V[:m], M, e, lag)
        h, hdot = self._potentials.value(q), rates[m:]
        omega, zeta = gains.leaf_frequency, gains.leaf_damping
        hddot = omega**2 * (leaf - h) - 2 * zeta * omega * hdot
        desired = np.concatenate([xddot, hddot]) - self._curvature(q, qdot)
        d = np.zeros(task.n)
        if observer is not None:
            d[m:] = gains.observer_rate * (hdot - observer.state)
        _require_finite(desired, d)
        try:
            inverse = augmented_inverse(J_V[:m], J_V[m:].T)
        except SingularityError:
            raise failure(task, q, d) from None
        opposed = M @ inverse @ d
        share = 1 / max(1.0, np.abs(opposed / gains.observer_limit).max())
        tau = M @ inverse @ desired + b - share * opposed
        _require_finite(tau)
        if observer is not None:
            state = hdot - share / gains.observer_rate * d[m:] + observer.dt * hddot
            _require_finite(state)
            observer.state[:] = state
        return np.asarray(tau, float)

    def _augmented(self, q: Array) -> Array:
        """Evaluate J_V (n, n), the Jacobian of the task above the gradients of the potentials."""
        return np.vstack([self._task.jacobian(q), self._potentials.gradient(q).T])

    def _task_acceleration(self, J: Array, M: Array, e: Array, lag: Array) -> Array:
        """Compute the task acceleration ẍ (m,) that the end effector's spring and damper give.

        J (m, n) is the Jacobian, M (n, n) the joint-space inertia, e (m,) the task error, and
        ``lag`` (m,) the velocity error ẋ* − ẋ.
        """
        root = np.sqrt(self._gains.stiffness)
        try:
            np.linalg.cholesky(M)
        except np.linalg.LinAlgError:
            raise InputError(
                "the joint-space inertia M is not positive definite; "
                "correct the <inertial> of the links in the model"
            ) from None
        A = root[:, None] * (J @ np.linalg.solve(M, J.T)) * root
        if not (np.isfinite(A).all() and np.isfinite(e).all()):
            raise _not_finite()
        values, U = np.linalg.eigh(A)
        half = (U * np.sqrt(np.maximum(values, 0.0))) @ U.T  # A^½
        damper = 2 * self._gains.damping * half @ (root * lag)
        return np.asarray((A @ (root * e) + damper) / root, float)

    def _curvature(self, q: Array, qdot: Array) -> Array:
        """Evaluate ``J̇_V q̇`` (n,), the acceleration of (x, h) at constant q̇.

        J̇_V is a central difference of J_V along q̇. The entries of polynomial potentials of degree
        3 or less have rounding errors only. All other entries, those of the task included, are
        accurate to 1e-6 of their size.
        """
        speed = float(np.linalg.norm(qdot))
        if speed == 0.0:
            return np.zeros(len(q))
        if not speed < np.inf:
            raise _not_finite()
        step = _DIFFERENCE / speed
        change = self._augmented(q + step * qdot) - self._augmented(q - step * qdot)
        return np.asarray(change @ qdot / (2 * step), float)


class NativeTorques:
    """Torque law in C, for checked arguments; an object must not be shared between threads.

    This law is fast enough for a control loop at 1 kHz.

    Parameters
    ----------
    arm
        C struct :data:`repctl_pin.native.ARM` of the task's joint chain and the potentials.
    reference
        The same law in NumPy, which is called after a failure in C to raise the error.
    gains
        The gains.
    task
        Task of the inverse.
    """

    def __init__(self, arm: Any, reference: NumPyTorques, gains: Gains, task: Task) -> None:
        n, r, frames = task.n, task.r, len(task.frames)
        self._arm, self._reference = arm, reference
        damping = gains.damping, gains.leaf_frequency, gains.leaf_damping
        numbers = np.array([*damping, gains.observer_rate])
        packed = np.concatenate([gains.stiffness, gains.observer_limit, numbers])
        self._q, self._qdot, self._bias = np.zeros(n), np.zeros(n), np.zeros(n)
        self._inertia, self._target = np.zeros((n, n)), np.zeros((4 * frames, 4))
        self._twist, self._leaf = np.zeros(task.twist_size), np.zeros(r)
        self._tau = np.zeros(n)
        memory = {
            "q": self._q,
            "qdot": self._qdot,
            "inertia": self._inertia,
            "bias": self._bias,
            "target": self._target,
            "twist": self._twist,
            "leaf": self._leaf,
            "gains": packed,
            "result": self._tau,
        }
        own = {"arm": ctypes.addressof(arm)}
        self._call = filled_struct(TORQUE_CALL, {}, memory, own)[0]
        self._address = ctypes.c_void_p(ctypes.addressof(self._call))
        self._run = required_library("the torque law", holds=True).call_torque

    def __call__(
        self,
        q: Array,
        qdot: Array,
        M: Array,
        b: Array,
        target: pin.SE3,
        twist: Array | None,
        leaf: Array,
        observer: Observer | None,
    ) -> Array:
        """Compute the torques τ (n,), Nm or N, and update the observer's state.

        q and q̇ (n,) are joint positions and velocities, M (n, n) and b (n,) inertia and bias, and
        ``leaf`` (r,) is the level c. ``target`` is the pose to follow, ``twist`` (v, ω) its
        velocity; None is rest. Without an ``observer``, disturbances are not compensated.
        SingularityError is raised where [J; Vᵀ] is singular, InputError if numbers overflow.
        """
        self._q[...] = q
        self._qdot[...] = qdot
        self._inertia[...] = M
        self._bias[...] = b
        self._target[...] = target.homogeneous
        self._leaf[...] = leaf
        if twist is not None:
            self._twist[...] = twist
        dt, state = 0.0, None
        if observer is not None:
            dt, state = observer.dt, observer.state.ctypes.data
        given = int(twist is not None)
        if self._run(self._address, given, ctypes.c_double(dt), ctypes.c_void_p(state)):
            self._reference(q, qdot, M, b, target, twist, leaf, None)  # raises
            raise _not_finite()
        return self._tau.copy()


def _not_finite() -> InputError:
    """Create the error for numbers that overflow in the torque law."""
    return InputError(
        "the torque is not finite: a number of q, q̇, the target, the twist or leaf is too large; "
        "check their units: rad, m and s"
    )


def _require_finite(*arrays: Array) -> None:
    """Raise InputError unless all numbers are finite."""
    if not all(np.isfinite(array).all() for array in arrays):
        raise _not_finite()
