"""Torque law of :class:`LeafImpedance`, in preallocated memory.

See :mod:`repctl_pin.strategies.fast_loop`.
"""

from __future__ import annotations

from collections.abc import Callable
from math import inf
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from scipy.linalg.blas import daxpy, ddot, dgemv, dnrm2
from scipy.linalg.lapack import dpotrf, dsyev, dtrtrs

from ...arguments import Array
from ...errors import InputError
from ...model import fast_kinematics
from ...model.task import Task
from ...potentials import fast_potentials
from ...potentials.basis import Potentials
from ...strategies.control_step import checked_solve

_DIFFERENCE = 1e-3
"""Length of the two steps ±Δq of the central difference along q̇, rad or m."""


class Gains(NamedTuple):
    """Gains of the torque law; see :class:`repctl_pin.extensions.runtime.impedance.LeafImpedance`.

    Attributes
    ----------
    stiffness : (m,) array
        Stiffness K for each row of J, N/m or Nm/rad.
    damping, leaf_frequency, leaf_damping, observer_rate : float
        ζ, ω in rad/s, ζ_h, and κ in 1/s.
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
    """Disturbance observer of one arm.

    Attributes
    ----------
    state : (r,) array
        State w, which the torque law updates; 0 at rest without a disturbance.
    dt : float
        Time step of the loop, s.
    """

    state: Array
    dt: float

    def reset(self) -> None:
        """Set the state to 0, after a stop of the robot."""
        self.state[:] = 0.0


def torque_law(
    task: Task, potentials: Potentials, gains: Gains
) -> Callable[..., Array]:
    """Create the function (q, q̇, M, b, target, twist, leaf, observer) → τ (n,), for one thread.

    ``τ = M J_V⁻¹ ([ẍ; ḧ − d] − J̇_V q̇) + b`` with ``J_V = [J; Vᵀ]`` (37): the end effector
    accelerates by ẍ and the potentials by ḧ, independently.

    ``ẍ = Λ⁻¹ F``, ``F = K e + D (ẋ* − ẋ)``, where D gives every mode the damping ratio ζ: for the
    Cholesky factor L of M and ``W = √K J L⁻ᵀ``, ``W Wᵀ = U k Uᵀ``, it is
    ``√K ẍ = U (k Uᵀ √K e + 2 ζ √k Uᵀ √K (ẋ* − ẋ))``, without an inverse of J M⁻¹ Jᵀ.

    ``ḧ = ω² (c − h) − 2 ζ_h ω ḣ``. The observer's estimate of the disturbance of ḧ is
    ``d = κ (ḣ − w)``, ``ẇ = ḧ``; its torque is scaled down to the limit of every joint.
    """
    n, m = task.n, task.m
    memory, rhs, errors = np.zeros(n * n), np.zeros(2 * n), np.zeros(2 * m)
    J_V, y = memory.reshape((n, n), order="F"), rhs.reshape((n, 2), order="F")
    pair = errors.reshape((2, m))  # e, and its rate
    rates, bent, away = np.zeros(n), np.zeros(n), np.zeros(n - m)
    J, error, lag, hdot = J_V[:m], pair[0], pair[1], rates[m:]
    xddot, hddot, disturbance = y[:m, 0], y[m:, 0], y[m:, 1]
    jacobian, aim, velocity = fast_kinematics.in_place(task, J, error)
    slope, gap = fast_potentials.in_place(potentials, J_V[m:], away)
    K, rows, twice = (
        gains.stiffness,
        np.sqrt(gains.stiffness)[:, None],
        2 * gains.damping,
    )
    kappa, limit = gains.observer_rate, gains.observer_limit
    spring = gains.leaf_frequency**2
    damper = 2 * gains.leaf_damping * gains.leaf_frequency

    def evaluate(q: Array) -> None:
        jacobian(q)
        slope(q)

    solved = checked_solve(task, memory, J_V, y, evaluate)

    def curvature(q: Array, qdot: Array) -> None:
        """Write ``J̇_V q̇`` into ``bent`` by a central difference along q̇.

        It is exact for the rows of potentials of degree 3, else to 1e-6 of its size.
        """
        speed = dnrm2(qdot)
        if speed * speed == 0.0:
            bent[:] = 0.0
            return
        step = _DIFFERENCE / speed
        evaluate(daxpy(qdot, q.copy(), n, step))
        dgemv(0.5 / step, J_V, qdot, 0.0, bent, overwrite_y=1)
        evaluate(daxpy(qdot, q.copy(), n, -step))
        dgemv(-0.5 / step, J_V, qdot, 1.0, bent, overwrite_y=1)

    def hand(M: Array) -> Array:
        """Compute the acceleration ẍ (m,) of the spring and damper at the end effector."""
        factor, info = dpotrf(M.T, lower=1)  # M is symmetric, and M.T needs no copy
        if info:
            raise InputError("the joint-space inertia M is not positive definite")
        X = dtrtrs(factor, J.T, lower=1)[0]
        k, U, _ = dsyev(rows * X.T.dot(X) * rows.T)  # (√K J M⁻¹ Jᵀ √K) = U k Uᵀ
        k = np.maximum(k, 0.0)
        U *= rows
        modes = pair.dot(U)
        return U.dot(k * modes[0] + twice * np.sqrt(k) * modes[1]) / K

    def torque(
        q: Array,
        qdot: Array,
        M: Array,
        b: Array,
        target: pin.SE3,
        twist: Array | None,
        leaf: Array,
        observer: Observer | None,
    ) -> Array:
        curvature(q, qdot)
        evaluate(q)
        aim(target)
        gap(leaf)
        dgemv(1.0, J_V, qdot, 0.0, rates, overwrite_y=1)
        np.negative(rates[:m], lag)
        if twist is not None:
            daxpy(velocity(twist), lag, m)
        size = ddot(memory, memory) + ddot(errors, errors) + ddot(M.ravel(), M.ravel())
        if not size < inf:
            raise _not_finite()
        pull = spring * away - damper * hdot
        xddot[:], hddot[:] = hand(M), pull
        daxpy(bent, rhs, n, -1.0)
        disturbance[:] = 0.0 if observer is None else kappa * (hdot - observer.state)
        if not ddot(rhs, rhs) < inf:
            raise _not_finite()
        force = M.dot(solved(q))
        tau = force[:, 0] + b
        if observer is not None:
            opposed = force[:, 1]
            share = 1.0 / max(1.0, *map(abs, (opposed / limit).tolist()))
            tau -= share * opposed
        if not ddot(tau, tau) < inf:
            raise _not_finite()
        if observer is not None:
            state = hdot - (share / kappa) * disturbance + observer.dt * pull
            if not np.isfinite(state).all():
                raise _not_finite()
            observer.state[:] = state
        return tau

    return torque


def _not_finite() -> InputError:
    """Create the error for numbers that overflow."""
    return InputError(
        "the torque is not finite: a number of q, q̇, the target, the twist or leaf is too large"
    )
