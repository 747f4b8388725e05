"""Argument checks in front of the fast control laws, which are written in Python or C.

In a control step of 5 µs, Python's function calls and attribute look-ups take longer than the
arithmetic. So each part of the law is a closure (a function that holds its arrays). It writes into
memory of its caller, serves one thread, and checks nothing:

- :func:`repctl_pin.model.fast_kinematics.in_place`: J, task error and task velocity of a task;
- :func:`repctl_pin.potentials.fast_potentials.in_place`: Vᵀ and c − h of potentials, whose class
  may bring an ``in_place`` of its own;
- :func:`repctl_pin.extensions.cells.fast_function.fast_coordinates`: coordinates of a cell.

:mod:`repctl_pin.strategies.control_step` combines them into the control law;
an extension can have it in C. :func:`checked` adds the argument check to either: arrays of doubles
of the right size are passed on as they are, other values are converted,
or refused by an error that names the argument.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import inf
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy import ndarray
from numpy.typing import ArrayLike

from ..arguments import FLOAT, Array, per_joint, positive, row, vector
from ..errors import InputError, SingularityError
from ..model.chain_formulas import Placement, as_placement
from ..model.task import Task
from ..redundancy.augmented import SINGULAR


class StepLimits(NamedTuple):
    """Limits of a step: joint speeds (n,), infinite if unlimited, and the maximum damping λ_max."""

    velocity_limit: Array
    damping: float


def step_limits(velocity_limit: ArrayLike | None, damping: float, n: int) -> StepLimits:
    """Check the limits of a step, as :meth:`RepeatableInverse.step` takes them."""
    damping = positive(damping, "damping", zero=True)
    limit = inf if velocity_limit is None else velocity_limit
    return StepLimits(per_joint(limit, n, "a speed limit"), damping)


@dataclass(frozen=True)
class FastLoop:
    """Control law of one repeatable inverse as fast functions, for one thread.

    Attributes
    ----------
    velocity : function (q, ẋ) → q̇
    step : function (q, target, dt, twist, leaf, gain, bounds or None) → the next q
    report : function () → (λ, slowed)
        Damping λ of the last step with bounds, and the factor by which it was scaled down to the
        speed limits.
    inverses : function Q (K, n) → G (K, n, m), optional
    velocities : function (Q, Ẋ) → q̇ (K, n), optional
    """

    velocity: Callable[..., Array]
    step: Callable[..., Array]
    report: Callable[[], tuple[float, float]]
    inverses: Callable[[Array], Array] | None = None
    velocities: Callable[[Array, Array], Array] | None = None


def checked_velocity(
    n: int, m: int, law: Callable[[Array, Array], Array]
) -> Callable[[ArrayLike, ArrayLike], Array]:
    """Add the argument check to a function (q, ẋ) → q̇."""
    of_joints, of_task = (n,), (m,)

    def velocity(q: ArrayLike, xdot: ArrayLike) -> Array:
        if not (type(q) is ndarray and q.dtype is FLOAT and q.shape == of_joints):
            q = vector(q, n, "q")
        if not (
            type(xdot) is ndarray and xdot.dtype is FLOAT and xdot.shape == of_task
        ):
            xdot = vector(xdot, m, "ẋ", "m/s and rad/s")
        return law(q, xdot)

    return velocity


def checked(task: Task, law: FastLoop) -> FastLoop:
    """Add the argument checks to a control law."""
    n, r, run, SE3 = task.n, task.r, law.step, pin.SE3
    of_joints, of_twist, of_leaf = (n,), (6,), (r,)

    def step(
        q: ArrayLike,
        target: Placement,
        dt: float,
        twist: ArrayLike | None,
        leaf: ArrayLike | None,
        gain: float | None,
        bounds: StepLimits | None,
    ) -> Array:
        if not (type(q) is ndarray and q.dtype is FLOAT and q.shape == of_joints):
            q = vector(q, n, "q")
        if not (isinstance(dt, float) and 0.0 < dt < inf):
            dt = positive(dt, "dt", "s")
        if not isinstance(target, SE3):
            target = as_placement(target, "the target")
        if leaf is not None and not (
            type(leaf) is ndarray and leaf.dtype is FLOAT and leaf.shape == of_leaf
        ):
            leaf = vector(leaf, r, "the leaf c = h(q)", "one per potential")
        if gain is not None and not (
            isinstance(gain, float) and 0.0 <= gain * dt <= 2.0
        ):
            gain = _as_gain(gain, dt)
        if twist is not None and not (
            type(twist) is ndarray and twist.dtype is FLOAT and twist.shape == of_twist
        ):
            twist = vector(twist, 6, "the twist (v, ω)", "m/s and rad/s")
        return run(q, target, dt, twist, leaf, gain, bounds)

    return replace(law, velocity=checked_velocity(n, task.m, law.velocity), step=step)


def _as_gain(gain: float, dt: float) -> float:
    """Check a feedback gain, 1/s, and convert it to a float.

    A step removes the share gain · dt of the error.
    """
    value = (
        gain if isinstance(gain, float) else positive(gain, "gain", "1/s", zero=True)
    )
    if not 0.0 <= value * dt <= 2.0:
        raise InputError(
            f"gain · dt must be from 0 to 2, beyond which feedback diverges; got {gain!r} · {dt!r}"
        )
    return value


def failure(task: Task, q: Array, rhs: Array, singular: str = "") -> Exception:
    """Create the exception for a step without a finite solution.

    It is an InputError if q or ``rhs`` is not finite, else a SingularityError.
    """
    if not np.isfinite(q).all():
        return InputError(f"q must be {task.n} finite numbers; got {row(q)}")
    if not np.isfinite(rhs).all():
        return InputError(
            "the task velocity ẋ or the target, the leaf and dt must be finite numbers"
        )
    return SingularityError(f"{singular or SINGULAR}, at q = {row(q)}")
