"""Argument checks of control steps, and the errors of steps that cannot be computed.

Arrays of doubles of the right size are passed on as they are; other values are converted, or
refused by an error that names the argument. A call of a Python function takes as long as the
arithmetic of a step; so each argument is tested in place, and a function is called only if the
argument must be converted. A level c is the value of the potentials h(q) at which a
repeatable inverse keeps the arm. q (n,) is a configuration, ẋ (m,) a task velocity, and the twist
(v, ω) the velocity of a target.

``StepLimits`` are the limits of a step: joint speeds (n,), and the maximum damping.
"""

from __future__ import annotations

from math import inf
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy import ndarray
from numpy.typing import ArrayLike

from ..base.arguments import FLOAT, Array, per_joint, positive, row, vector
from ..base.errors import InputError, SingularityError
from ..model.chain_formulas import Placement
from ..model.task import Task
from ..redundancy.augmented import SINGULAR


class StepLimits(NamedTuple):
    """Limits of a step: joint speeds (n,), infinite if unlimited, and the maximum damping λ_max.

    ``velocity_limit`` (n,) is in rad/s or m/s. ``damping`` is λ_max, in the units of the Jacobian:
    damping shortens steps near singularities, and with λ_max = 0 there is none.
    """

    velocity_limit: Array
    damping: float


def step_limits(velocity_limit: ArrayLike | None, damping: float, n: int) -> StepLimits:
    """Check the limits of a step of a control loop, and return them.

    ``velocity_limit`` is a number or n of them, rad/s or m/s, or None; ``damping`` is λ_max, 0 or
    more.
    """
    damping = positive(damping, "damping", zero=True)
    limit = inf if velocity_limit is None else velocity_limit
    return StepLimits(per_joint(limit, n, "a speed limit"), damping)


def as_joints(q: ArrayLike, n: int) -> Array:
    """Convert q (n,) to an array of doubles; one that is already (n,) doubles is returned as is."""
    if type(q) is ndarray and q.dtype is FLOAT and q.shape == (n,):
        return q
    return vector(q, n, "q")


def as_velocity_arguments(q: ArrayLike, xdot: ArrayLike, n: int, m: int) -> tuple[Array, Array]:
    """Check the arguments q (n,) and ẋ (m,) of a controller, and return them as arrays of doubles.

    Whether the numbers of an array of doubles are finite is not tested here, but by the solver.
    """
    if not (type(q) is ndarray and q.dtype is FLOAT and q.shape == (n,)):
        q = vector(q, n, "q")
    if not (type(xdot) is ndarray and xdot.dtype is FLOAT and xdot.shape == (m,)):
        xdot = vector(xdot, m, "ẋ", "m/s and rad/s")
    return q, xdot


def as_step_arguments(
    q: ArrayLike,
    target: Placement,
    dt: float,
    twist: ArrayLike | None,
    leaf: ArrayLike | None,
    gain: float | None,
    task: Task,
) -> tuple[Array, pin.SE3, float, Array | None, Array | None, float | None]:
    """Check the arguments of a step, and return (q, target, dt, twist, leaf, gain).

    ``target`` is a placement, ``dt`` is in s, ``twist`` is (v, ω), m/s and rad/s, ``leaf`` the
    level c (r,), and ``gain`` in 1/s. None stays None. InputError names the argument that cannot be
    used.
    """
    n = task.n
    if not (type(q) is ndarray and q.dtype is FLOAT and q.shape == (n,)):
        q = vector(q, n, "q")
    if not (isinstance(dt, float) and 0.0 < dt < inf):
        dt = positive(dt, "dt", "s")
    if type(target) is not task.target_type:
        target = task.as_target(target, "the target")
    if leaf is not None and not (
        type(leaf) is ndarray and leaf.dtype is FLOAT and leaf.shape == (task.r,)
    ):
        leaf = vector(leaf, task.r, "the leaf c = h(q)", "one per potential")
    if gain is not None and not (isinstance(gain, float) and 0.0 <= gain * dt <= 2.0):
        gain = _as_gain(gain, dt)
    if twist is not None and not (
        type(twist) is ndarray and twist.dtype is FLOAT and twist.shape == (task.twist_size,)
    ):
        twist = vector(twist, task.twist_size, "the twist (v, ω)", "m/s and rad/s")
    return q, target, dt, twist, leaf, gain


def _as_gain(gain: float, dt: float) -> float:
    """Check a feedback gain, 1/s, and convert it to a float.

    A step multiplies the error by 1 − gain · dt. InputError is raised unless gain · dt is from 0 to
    2: above 2, each step would increase the error.
    """
    value = gain if isinstance(gain, float) else positive(gain, "gain", "1/s", zero=True)
    if not 0.0 <= value * dt <= 2.0:
        raise InputError(
            f"gain · dt must be from 0 to 2, beyond which feedback diverges; "
            f"got {gain!r} 1/s · {dt!r} s; reduce the gain"
        )
    return value


def failure(task: Task, q: Array, rhs: Array, singular: str = "") -> Exception:
    """Create the exception for a step without a finite solution, with q in its message.

    It is an InputError if q (n,) or ``rhs``, the right-hand side of the equation for the step, is
    not finite; else a SingularityError with the text ``singular``.
    """
    if not np.isfinite(q).all():
        return InputError(f"q must be {task.n} finite numbers; got {row(q)}")
    if not np.isfinite(rhs).all():
        return InputError(
            "an input of the step is not finite: the task velocity ẋ, or the target, twist, leaf "
            "or dt; give finite numbers"
        )
    return SingularityError(f"{singular or SINGULAR}, at q = {row(q)}")
