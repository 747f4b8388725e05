"""Torque control on a leaf: impedance of the end effector, and a null-space spring to the leaf.

A leaf is the set h(q) = c on which the r potentials h of a repeatable inverse have the level c.
Letters: q (n,), joint positions; J (m, n), the task Jacobian; V (n, r), the gradients of h; F (m,),
the force on the end effector.

``Observer`` is the state of a disturbance observer, which estimates what moves the joints off their
leaf. ``Kind`` is the kind of a task, such as ``pose``, with the coordinates that it commands.
``Gains`` are the gains of the torque law: stiffness, damping ratios, leaf frequency, and those of
the observer. ``NativeTorques`` is the torque law in C. ``NumPyTorques`` is the torque law in NumPy.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from math import inf

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike
from scipy.linalg.blas import ddot

from ...base.arguments import (
    FLOAT,
    Array,
    as_numbers,
    per_joint,
    positive,
    require_type,
    shown,
    vector,
)
from ...base.errors import InputError
from ...base.threads import PerThread
from ...model.chain_formulas import Placement
from ...model.kind import Kind
from ...model.task import Task
from ...strategies.native_arm import library_arm
from ...strategies.repeatable import RepeatableInverse
from ...strategies.strategy import described
from .torque_law import Gains, NativeTorques, NumPyTorques, Observer


class LeafImpedance:
    """Impedance control of the end effector, with a null-space spring to the leaf h(q) = c.

    ``τ = Jᵀ F + P V Λ_h (ḧ* − Vᵀ M⁻¹ Jᵀ F) + b(q, q̇)`` with ``F = K e + D (ẋ* − J q̇)``,
    ``ḧ* = ω² (c − h) − 2 ζ_h ω Vᵀ q̇``, ``P = I − Jᵀ J̄ᵀ``, ``J̄ = M⁻¹ Jᵀ Λ``,
    ``Λ = (J M⁻¹ Jᵀ)⁻¹``, ``Λ_h = (Vᵀ M⁻¹ P V)⁻¹``; e is the task error, ẋ* the velocity of the
    target, V the gradients of h, M the joint-space inertia, and b compensates gravity and the
    velocity terms. Because ``J M⁻¹ P = 0``, the second term of τ does not accelerate the end
    effector (Khatib); ``Vᵀ M⁻¹ Jᵀ F`` decouples the leaf from the force F. There is no home
    posture: the null-space spring is relaxed everywhere on the leaf, and only pulls the joints back
    to it. This controller is not part of the paper.

    With ``J_V = [J; Vᵀ]``, the torque is computed as ``τ = M J_V⁻¹ ([Λ⁻¹ F; ḧ*] − J̇_V q̇) + b``.
    This form also compensates ``J̇_V q̇``, so that ``ḧ = ḧ*`` holds exactly at any speed. D is such
    that the end effector, with its inertia Λ, has the same damping ratio in every direction.

    Friction and errors of M and b move the joints off the leaf. An :meth:`observer` estimates this
    disturbance from ḧ* and ḣ, and cancels it.

    Parameters
    ----------
    inverse
        Repeatable inverse, such as ``design.inverse``, in the robot's own joints.
    stiffness : (float, float) or (m,) array
        Stiffness K: two numbers, N/m for all translations and Nm/rad for all rotations; or one
        number per row of J.
    damping
        Damping ratio ζ of the end effector; 1 is critical.
    leaf_frequency
        Natural frequency ω of the return to the leaf, rad/s. A lower frequency makes the elbow
        softer, and the leaf error larger.
    leaf_damping
        Damping ratio ζ_h of the return to the leaf; 1 is critical.
    observer_rate
        Rate κ at which the observer follows a disturbance of the leaf, 1/s.
    observer_limit : float or (n,) array
        Maximum torque per joint by which the observer compensates a disturbance, Nm or N. A larger
        disturbance, such as a push, still moves the arm.

    Raises
    ------
    InputError
        If an argument is invalid, or a link of the chain has no inertia.

    Examples
    --------
    >>> near = rp.Tube([panda.reference], 0.1)
    >>> J_plus, options = rp.Pseudoinverse(panda), rp.FitOptions(held_out=64)
    >>> found = rp.nearest_repeatable(J_plus, None, near, degree=1, options=options)
    >>> spring = rp.LeafImpedance(found.inverse, stiffness=(2000.0, 100.0))  # N/m and Nm/rad
    >>> q, observer = np.array(panda.reference), spring.observer(dt=0.001)
    >>> leaf, target = found.inverse.leaf(q), panda.placement(q)
    >>> spring.torque(q, np.zeros(7), target, leaf=leaf, observer=observer).shape  # Nm
    (7,)
    """

    def __init__(
        self,
        inverse: RepeatableInverse,
        *,
        stiffness: ArrayLike = (1000.0, 50.0),
        damping: float = 1.0,
        leaf_frequency: float = 20.0,
        leaf_damping: float = 1.0,
        observer_rate: float = 200.0,
        observer_limit: ArrayLike = 5.0,
    ) -> None:
        self.inverse = require_type(
            inverse, RepeatableInverse, "inverse", "a repeatable inverse, such as design.inverse"
        )
        self.task = task = self.inverse.task
        self.gains = Gains(
            _stiffness(stiffness, task.kind),
            positive(damping, "damping", zero=True),
            positive(leaf_frequency, "leaf_frequency", "rad/s", zero=True),
            positive(leaf_damping, "leaf_damping", zero=True),
            positive(observer_rate, "observer_rate", "1/s"),
            per_joint(observer_limit, task.n, "observer_limit"),
        )
        self._law = PerThread(partial(_torque_law, inverse, self.gains))
        self._dynamics = PerThread(partial(_dynamics, task))
        try:
            np.linalg.cholesky(task.inertias(task.reference[None])[0])
        except np.linalg.LinAlgError:
            raise InputError(
                f"a link of the chain to {task.frame!r} has no inertia; "
                "add <inertial> to every link in the model that a joint moves"
            ) from None

    def __repr__(self) -> str:
        return described(self, self.task, f"leaf frequency {self.gains.leaf_frequency:g} rad/s")

    def observer(self, dt: float) -> Observer:
        """Create a disturbance observer for :meth:`torque`; each arm needs its own.

        Call ``reset()`` of the observer after the robot was stopped.

        Parameters
        ----------
        dt
            Time step of the loop, s.

        Raises
        ------
        InputError
            If dt is not above 0, or longer than 1 / observer_rate.
        """
        dt, rate = positive(dt, "dt", "s"), self.gains.observer_rate
        if not rate * dt <= 1.0:
            raise InputError(
                f"dt = {dt:g} s is longer than 1 / observer_rate = {1 / rate:.3g} s; "
                f"create the controller with observer_rate={1 / dt:.3g} (1/s) or less"
            )
        return Observer(np.zeros(self.task.r), dt)

    def torque(
        self,
        q: ArrayLike,
        qdot: ArrayLike,
        target: Placement,
        twist: ArrayLike | None = None,
        *,
        leaf: ArrayLike,
        observer: Observer | None = None,
    ) -> Array:
        """Compute the joint torques τ (n,), Nm or N, once per tick of the control loop.

        The end effector is pulled to the target, and the joints to the leaf h(q) = c.

        Parameters
        ----------
        q, qdot : (n,) arrays
            Joint positions, rad or m, and joint velocities, rad/s or m/s.
        target : pinocchio.SE3 or (4, 4) array
            Desired placement of the frame, in the base frame; for several frames, a list of one
            placement per frame.
        twist : (6,) or (6 k,) array, optional
            Velocity (v, ω) of the target in base axes, m/s and rad/s; for k frames, the six numbers
            of each frame in turn. By default 0.
        leaf : (r,) array
            Level c, from ``inverse.leaf(q)`` at the start.
        observer : Observer, optional
            Result of :meth:`observer`; a call that raises no error updates its state. Without an
            observer, friction and errors of the model are not compensated.

        Raises
        ------
        InputError
            If a size is wrong, or a number is not finite or so large that the torque is not finite.
        SingularityError
            If J_V is singular.
        """
        n, r = self.task.n, self.task.r
        q, qdot = _checked(q, n, "q"), _checked(qdot, n, "qdot")
        leaf = _checked(leaf, r, "leaf", "from inverse.leaf(q)")
        if twist is not None:
            size = self.task.twist_size
            twist = _checked(twist, size, "the twist (v, ω)", "m/s and rad/s")
        if observer is not None and not (type(observer) is Observer and len(observer.state) == r):
            raise InputError(
                f"must be a result of observer(dt) of this controller; got {shown(observer)}",
                argument="observer",
            )
        with np.errstate(over="ignore", invalid="ignore"):
            M, b = self._dynamics.own(q, qdot)
            return self._law.own(q, qdot, M, b, self.task.as_target(target), twist, leaf, observer)


def _checked(values: ArrayLike, n: int, name: str, each: str = "one per joint") -> Array:
    """Check n numbers and return them as an array; an array of finite doubles is returned as is.

    InputError is raised unless there are n finite numbers; its message contains ``name``, the name
    of the argument, and ``each``, such as "one per joint". To save time in a control loop, one
    scalar product first tests all numbers at once.
    """
    if (
        type(values) is np.ndarray
        and values.dtype is FLOAT
        and values.shape == (n,)
        and ddot(values, values) < inf
    ):
        return values
    return vector(values, n, name, each)


def _stiffness(given: ArrayLike, kind: Kind) -> Array:
    """Convert a stiffness to an array (m,), one number per task coordinate, N/m or Nm/rad.

    If two numbers are given, the first holds for all translations and the second for all rotations;
    ``kind`` says which coordinates are translations. InputError is raised unless all numbers are
    above 0.
    """
    values, m = as_numbers(given), kind.m
    if values is not None and values.shape == (2,) and m != 2:
        values = np.where(kind.linear, values[0], values[1])
    if values is None or values.shape != (m,) or not (np.isfinite(values) & (values > 0)).all():
        raise InputError(
            f"stiffness must be two numbers above 0 (N/m and Nm/rad), or {m} numbers, one per "
            f"task coordinate; got {shown(given)}"
        )
    return values


def _torque_law(inverse: RepeatableInverse, gains: Gains) -> NumPyTorques | NativeTorques:
    """Create the torque law for one thread: in C or, where C cannot compute it, in NumPy.

    C lacks user-defined potentials and chains of more than 64 joints.
    """
    task = inverse.task
    law = NumPyTorques(task, inverse.potentials, gains)
    arm = library_arm(task, inverse.potentials)
    return law if arm is None else NativeTorques(arm, law, gains, task)


def _dynamics(task: Task) -> Callable[[Array, Array], tuple[Array, Array]]:
    """Create the function (q, q̇) → (M, b), inertia (n, n) and bias (n,), for one thread.

    b contains gravity and velocity terms. Inertia and bias of a mimic joint are added to those of
    the joint that drives it. Each thread needs its own function, because Pinocchio computes in a
    buffer.
    """
    model, drive = task.bodies_model()
    data = model.createData()
    S = drive.S

    def dynamics(q: Array, qdot: Array) -> tuple[Array, Array]:
        whole = drive.joints(q)
        M = pin.crba(model, data, whole)
        b = pin.nonLinearEffects(model, data, whole, drive.rates(qdot))
        return S.T @ M @ S, S.T @ b

    return dynamics
