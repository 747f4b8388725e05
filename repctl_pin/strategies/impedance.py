"""Torque control on a leaf: impedance of the end effector, and a null-space spring to the leaf."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import scipy.linalg
from numpy.typing import ArrayLike

from ..arguments import Array, as_numbers, positive, require_type, shown, vector
from ..errors import InputError, SingularityError
from ..robot.chain_formulas import Placement
from ..threads import PerThread
from .repeatable import RepeatableInverse
from .strategy import described


class LeafImpedance:
    """Impedance control of the end effector, with a null-space spring to the leaf h(q) = c.

    ``τ = Jᵀ F + P V Λ_h (ω² (c − h) − 2 ζ_h ω Vᵀ q̇) + b(q, q̇)`` with ``F = K e + D (ẋ* − J q̇)``,
    ``P = I − Jᵀ J̄ᵀ``, ``J̄ = M⁻¹ Jᵀ Λ``, ``Λ = (J M⁻¹ Jᵀ)⁻¹``, ``Λ_h = (Vᵀ M⁻¹ P V)⁻¹``; b
    compensates gravity and the velocity terms. ``J M⁻¹ P = 0``: the second term does not
    accelerate the end effector (Khatib). There is no home posture: the null-space spring is relaxed
    anywhere on the leaf, and only pulls the joints back to the leaf. Beyond the paper.

    D gives the end effector, with its inertia Λ, the same damping ratio in every direction. The
    potentials respond with a single frequency, ``ḧ = ω² (c − h) − 2 ζ_h ω ḣ``, up to terms in the
    squares of velocities.

    Parameters
    ----------
    inverse
        Repeatable inverse, such as ``design.inverse``, in the robot's own joints.
    stiffness : (float, float) or (m,) array
        Stiffness K: N/m for translations and Nm/rad for rotations; or one number per row of J.
    damping
        Damping ratio ζ of the end effector; 1 is critical.
    leaf_frequency
        Natural frequency ω of the return to the leaf, rad/s.
    leaf_damping
        Damping ratio ζ_h of the return to the leaf; 1 is critical.

    Raises
    ------
    InputError
        If an argument cannot be used, or a link of the chain has no inertia.

    Examples
    --------
    >>> near = rp.Tube([panda.reference], 0.1)
    >>> J_plus, options = rp.Pseudoinverse(panda), rp.FitOptions(held_out=64)
    >>> found = rp.nearest_repeatable(J_plus, None, near, degree=1, options=options)
    >>> spring = rp.LeafImpedance(found.inverse, stiffness=(2000.0, 100.0))  # N/m and Nm/rad
    >>> q = np.array(panda.reference)
    >>> spring.torque(q, np.zeros(7), panda.placement(q), leaf=found.inverse.leaf(q)).shape  # Nm
    (7,)
    """

    def __init__(
        self,
        inverse: RepeatableInverse,
        *,
        stiffness: ArrayLike = (1000.0, 50.0),
        damping: float = 1.0,
        leaf_frequency: float = 5.0,
        leaf_damping: float = 1.0,
    ) -> None:
        self.inverse = require_type(
            inverse, RepeatableInverse, "inverse", "a repeatable inverse, such as design.inverse"
        )
        self.task = task = inverse.task
        if task.coordinates is not None:
            raise InputError(
                "torques act on the robot's own joints, but the task is in other coordinates; "
                "design without in_coordinates()"
            )
        linear, given = min(3, task.m), as_numbers(stiffness)
        pair = given is not None and given.shape == (2,) and task.m != 2
        rows = np.repeat(given, [linear, task.m - linear]) if given is not None and pair else given
        if rows is None or rows.shape != (task.m,) or not (np.isfinite(rows) & (rows > 0)).all():
            said = shown(stiffness)
            raise InputError(
                f"stiffness must be two numbers above 0, N/m and Nm/rad, or {task.m}; got {said}"
            )
        self.stiffness = np.diag(rows)
        self.damping = positive(damping, "damping", zero=True)
        self.leaf_frequency = positive(leaf_frequency, "leaf_frequency", "rad/s", zero=True)
        self.leaf_damping = positive(leaf_damping, "leaf_damping", zero=True)
        self._model, self._drive = task.bodies_model()
        self._data = PerThread(self._model.createData)
        try:
            np.linalg.cholesky(task.inertias(task.reference[None])[0])
        except np.linalg.LinAlgError:
            raise InputError(
                f"a link of the chain to {task.frame!r} has no inertia; torques need one per joint"
            ) from None

    def __repr__(self) -> str:
        return described(self, self.task, f"leaf frequency {self.leaf_frequency:g} rad/s")

    def torque(
        self,
        q: ArrayLike,
        qdot: ArrayLike,
        target: Placement,
        twist: ArrayLike | None = None,
        *,
        leaf: ArrayLike,
    ) -> Array:
        """Compute the joint torques τ (n,), Nm or N.

        Parameters
        ----------
        q, qdot : (n,) arrays
            Joint positions and velocities, rad or m, and per second.
        target : pinocchio.SE3 or (4, 4) array
            Desired placement of the frame.
        twist : (6,) array, optional
            Velocity (v, ω) of the target, base axes, m/s and rad/s; 0 by default.
        leaf : (r,) array
            Level c, from ``inverse.leaf(q)`` at the start.

        Raises
        ------
        InputError
            If a size is wrong, a number not finite, or so large that the torque is not finite.
        SingularityError
            If J or J_V loses rank.
        """
        task = self.task
        q, qdot = vector(q, task.n, "q"), vector(qdot, task.n, "q̇")
        c = vector(leaf, task.r, "leaf", "from inverse.leaf(q)")
        with np.errstate(over="ignore", invalid="ignore"):
            error = task.error(q, target)
            rate = np.zeros(task.m) if twist is None else task.task_velocity(q, twist)
            if not np.isfinite(error).all():
                raise InputError("the target must be finite numbers, m and a rotation")
            torque = self._torque(q, qdot, error, rate, c)
        if not np.isfinite(torque).all():
            raise InputError(
                "the torque is not finite: a number of q, q̇, the target, the twist or leaf "
                "is too large"
            )
        return torque

    def _torque(self, q: Array, qdot: Array, error: Array, rate: Array, c: Array) -> Array:
        """Compute τ (n,) from a task error (m,) and the target's task velocity (m,); not finite if
        numbers overflow."""
        task, potentials = self.task, self.inverse.potentials
        J, V, M = task.jacobian(q), potentials.gradient(q), task.inertias(q[None])[0]
        if not (np.isfinite(V).all() and np.isfinite(M).all()):
            return np.full(task.n, np.nan)
        try:
            factor = scipy.linalg.cho_factor(M)
            M_J = scipy.linalg.cho_solve(factor, J.T)  # M⁻¹ Jᵀ
            inertia = np.linalg.inv(J @ M_J)  # Λ
            P_V = V - J.T @ (inertia @ (M_J.T @ V))  # P V
            leaf_inertia = np.linalg.inv(
                P_V.T @ scipy.linalg.cho_solve(factor, P_V)
            )  # Λ_h: P M⁻¹ P = M⁻¹ P
            force = self._force(J @ qdot, inertia, error, rate)
        except (np.linalg.LinAlgError, ValueError):  # scipy's, where numbers are not finite
            raise SingularityError("the arm is at a singularity: J or J_V loses rank") from None
        omega = self.leaf_frequency
        pull = omega**2 * (c - potentials.value(q)) - 2 * self.leaf_damping * omega * (V.T @ qdot)
        return J.T @ force + P_V @ (leaf_inertia @ pull) + self._balance(q, qdot)

    def _balance(self, q: Array, qdot: Array) -> Array:
        """Compute the torques b (n,) of gravity and velocities; mimic joints load those they
        follow."""
        drive, data, rest = self._drive, self._data.own, np.zeros(self._model.nv)
        if drive is None:
            return pin.rnea(self._model, data, q, qdot, rest)
        return drive.S.T @ pin.rnea(self._model, data, drive.joints(q), drive.S @ qdot, rest)

    def _force(self, xdot: Array, inertia: Array, error: Array, rate: Array) -> Array:
        """Compute the force F (m,) of the end effector's spring and damper at ẋ (m,)."""
        k, Q = scipy.linalg.eigh(self.stiffness, inertia)  # Qᵀ Λ Q = I, Qᵀ K Q = diag k
        D = inertia @ (Q * (2 * self.damping * np.sqrt(k))) @ Q.T @ inertia
        return self.stiffness @ error + D @ (rate - xdot)
