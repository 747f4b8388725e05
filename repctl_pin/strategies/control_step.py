"""One step of a control loop, the leaf lock: one Jacobian, one evaluation of the potentials, one
LAPACK solve.

The functions made here are closures over preallocated memory, see
:mod:`repctl_pin.robot.fast_kinematics`. What they are given is looked at before it reaches compiled
code: native doubles of the right size pass, everything else is converted or refused by name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from math import inf, prod
from sys import float_info

import numpy as np
import pinocchio as pin
from numpy import ndarray
from numpy.typing import ArrayLike
from scipy.linalg.blas import daxpy, ddot, dscal
from scipy.linalg.lapack import dgesv, dgetrf, dgetri

from ..arguments import FLOAT, Array, per_joint, positive, row, vector
from ..errors import InputError, SingularityError
from ..potentials import fast_potentials
from ..potentials.basis import Potentials
from ..redundancy.augmented import SINGULAR, is_regular
from ..redundancy.inverses import RANK_TOLERANCE
from ..robot import fast_kinematics
from ..robot.formulas import Placement, as_placement
from ..robot.task import Task


@dataclass(frozen=True)
class Loop:
    """The quick functions of one repeatable inverse, for one thread; see
    :class:`RepeatableInverse`.

    Attributes
    ----------
    velocity : function (q, ẋ) → q̇
    step : function (q, target, dt, twist, leaf, gain) → the next q
    bounded : function (q, target, dt, twist, leaf, gain, velocity_limit, damping) → the next q, λ,
    slowed
    inverses : function Q (K, n) → G (K, n, m), optional
    velocities : function (Q, Ẋ) → q̇ (K, n), optional
    """

    velocity: Callable[..., Array]
    step: Callable[..., Array]
    bounded: Callable[..., tuple[Array, float, float]]
    inverses: Callable[[Array], Array] | None = None
    velocities: Callable[[Array, Array], Array] | None = None


def python_loops(task: Task, potentials: Potentials) -> Callable[[], Loop]:
    """Make what makes the quick functions in Python, once in each thread."""
    return partial(make_loop, task, potentials)


def make_loop(task: Task, potentials: Potentials) -> Loop:
    """Make the quick functions of the repeatable inverse of potentials h."""
    n, m, r = task.n, task.m, task.r
    of_joints, of_task, of_twist, of_leaf = (n,), (m,), (6,), (r,)
    memory = np.zeros(n * n + n)
    J_V, rhs = memory[: n * n].reshape((n, n), order="F"), memory[n * n :]  # [J; Vᵀ] (37)
    top, bottom, pivots = rhs[:m], rhs[m:], memory[: n * n : n + 1]
    kinematics = fast_kinematics.in_place(task, J_V[:m], top)
    h = fast_potentials.in_place(potentials, J_V[m:], bottom)
    jacobian, error, rate = kinematics.jacobian, kinematics.error, kinematics.task_velocity
    slope, gap, SE3 = h.slope, h.gap, pin.SE3
    whole, half, tolerance = task.kind == "pose", n / 2, RANK_TOLERANCE / n ** (n / 2)
    largest = float_info.max ** (1 / half)  # square ** half overflows beyond it

    def solved(q: Array) -> Array:
        """Solve ``J_V x = rhs``; J_V is overwritten."""
        square = ddot(memory, memory)
        _, order, x, info = dgesv(J_V, rhs, 1, 0)
        # |det J_V| = |∏ pivots| ≤ sin θ ∏ ‖row‖ ≤ sin θ (‖J_V‖/√n)ⁿ, θ the least angle of
        # is_regular: this is enough.
        # NaN fails it. Where it fails the exact test has the word. It bounds x, too: ‖x‖ ≤
        # square^half / |det J_V|.
        if not (square < largest and abs(prod(pivots.tolist())) > tolerance * square**half):
            inverse = None if info else dgetri(J_V, order)[0]
            jacobian(q)
            slope(q)
            if inverse is None or not (np.isfinite(x).all() and is_regular(J_V, inverse)):
                raise failure(task, q, rhs)
        return x

    def velocity(q: Array, xdot: Array) -> Array:
        if not (type(q) is ndarray and q.dtype is FLOAT and q.shape == of_joints):
            q = vector(q, n, "q")
        if not (type(xdot) is ndarray and xdot.dtype is FLOAT and xdot.shape == of_task):
            xdot = vector(xdot, m, "ẋ", "m/s and rad/s")
        jacobian(q)
        slope(q)
        top[:] = xdot
        bottom[:] = 0.0
        return solved(q)

    def step(
        q: Array,
        target: Placement,
        dt: float,
        twist: Array | None,
        leaf: Array | None,
        gain: float | None,
        solve: Callable[[Array], Array] = solved,
    ) -> Array:
        if not (type(q) is ndarray and q.dtype is FLOAT and q.shape == of_joints):
            q = vector(q, n, "q")
        if not (isinstance(dt, float) and 0.0 < dt < inf):
            dt = positive(dt, "dt", "s")
        if not isinstance(target, SE3):
            target = as_placement(target, "the target")
        jacobian(q)
        slope(q)
        error(target)
        if leaf is None:
            bottom[:] = 0.0
        else:
            if not (type(leaf) is ndarray and leaf.dtype is FLOAT and leaf.shape == of_leaf):
                leaf = vector(leaf, r, "the leaf c = h(q)", "one per potential")
            gap(leaf)
        if gain is not None:
            dscal(share_of(gain, dt), rhs)
        if twist is not None:
            if not (type(twist) is ndarray and twist.dtype is FLOAT and twist.shape == of_twist):
                twist = vector(twist, 6, "the twist (v, ω)", "m/s and rad/s")
            daxpy(twist if whole else rate(twist), rhs, m, dt)
        return daxpy(q, solve(q), n)

    def bounded(
        q: Array,
        target: Placement,
        dt: float,
        twist: Array | None,
        leaf: Array | None,
        gain: float | None,
        velocity_limit: ArrayLike | None,
        damping: float,
    ) -> tuple[Array, float, float]:
        dt, damping = positive(dt, "dt", "s"), positive(damping, "damping", zero=True)
        most = np.full(n, inf) if velocity_limit is None else speeds(velocity_limit, n) * dt
        used, slowed = 0.0, 1.0

        def gently(q: Array) -> Array:
            nonlocal used, slowed
            if damping:
                x, used = damped(J_V, rhs, damping)
                if not np.isfinite(x).all():
                    raise failure(task, q, rhs)
            else:
                x = solved(q)
            if velocity_limit is None or (np.abs(x) <= most).all():
                return x
            bottom[:] = 0.0
            if not damping:
                jacobian(q)
                slope(q)
            x_task = damped(J_V, rhs, damping)[0] if damping else solved(q)
            x, slowed = within(x, x_task, most)
            return x

        return step(q, target, dt, twist, leaf, gain, gently), used, slowed

    return Loop(velocity, step, bounded)


@np.errstate(over="ignore", invalid="ignore")
def damped(J_V: Array, rhs: Array, most: float) -> tuple[Array, float]:
    """Solve ``J_V x = rhs``, damped where J_V is near a singularity.

    ``x = Σ_i v_i σ_i / (σ_i² + λ²) u_iᵀ rhs``, with ``λ² = λ_max² (1 − (σ_min / 2λ_max)²)`` where
    ``σ_min < 2 λ_max`` and λ = 0 elsewhere: continuous, and ``‖x‖ ≤ ‖rhs‖ / (√3 λ_max)`` wherever
    it acts.

    Parameters
    ----------
    J_V : (n, n) array
    rhs : (n,) array
    most : float
        λ_max.

    Returns
    -------
    x : (n,) array
    damping : float
        λ; 0 where the solution is exact.
    """
    factors, pivots, info = dgetrf(J_V)
    if not info:
        inverse, _ = dgetri(factors, pivots)
        if np.linalg.norm(inverse) < 1 / (
            2 * most
        ):  # σ_min ≥ 1 / ‖J_V⁻¹‖_F: surely far from singular
            return inverse @ rhs, 0.0
    if not np.isfinite(J_V).all():
        return np.full(len(rhs), np.nan), 0.0
    U, s, V_T = np.linalg.svd(J_V)
    ratio = s[-1] / (2 * most)
    square = most * most * (1 - ratio**2) if ratio < 1 else 0.0
    return V_T.T @ ((U.T @ rhs) * s / (s**2 + square)), float(np.sqrt(square))


def within(x: Array, x_task: Array, most: Array) -> tuple[Array, float]:
    """Shorten a step ``x = x_task + x_leaf`` until no joint moves further than it may.

    The return to the leaf gives way first, so that the task keeps its speed as long as it can; then
    the step as a whole is scaled down.

    Parameters
    ----------
    x, x_task, most : (n,) arrays
        The step, the part of it that moves the frame, and the longest step of each joint.

    Returns
    -------
    x : (n,) array
    slowed : float
        The factor by which the part that gave way most was scaled.
    """
    x_leaf = x - x_task
    room = np.where(x_leaf > 0, most - x_task, most + x_task)
    moving = np.abs(x_leaf) > 1e-15
    share = float(np.clip((room[moving] / np.abs(x_leaf[moving])).min(initial=1.0), 0.0, 1.0))
    shorter = x_task + share * x_leaf
    whole = float((most / np.maximum(np.abs(shorter), 1e-300)).min(initial=1.0))
    return shorter * min(1.0, whole), min(share, whole)


def failure(task: Task, q: Array, rhs: Array, singular: str = "") -> Exception:
    """Say why a step has no finite solution."""
    if not np.isfinite(q).all():
        return InputError(f"q must be {task.n} finite numbers; got {row(q)}")
    if not np.isfinite(rhs).all():
        return InputError(
            "the task velocity ẋ or the target, the leaf and dt must be finite numbers"
        )
    return SingularityError(f"{singular or SINGULAR}, at q = {row(q)}")


def share_of(gain: float, dt: float) -> float:
    """Take a feedback gain, 1/s, that a person gave: the share gain · dt of the error that a step
    undoes."""
    share = (gain if isinstance(gain, float) else positive(gain, "gain", "1/s", zero=True)) * dt
    if not 0.0 <= share <= 2.0:
        raise InputError(
            f"gain · dt must be from 0 to 2, beyond which feedback diverges; got {gain!r} · {dt!r}"
        )
    return share


def speeds(velocity_limit: ArrayLike, n: int) -> Array:
    """Check the speed limits (n,) that the user gave."""
    return per_joint(velocity_limit, n, "a speed limit")
