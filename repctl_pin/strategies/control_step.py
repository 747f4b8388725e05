"""Control step of a repeatable inverse, with feedback to its leaf (the leaf lock), in Python.

A step evaluates J and the potentials once and solves one linear system. The functions work in
preallocated memory on arguments that are already checked, see
:mod:`repctl_pin.strategies.fast_loop`.
"""

from __future__ import annotations

from collections.abc import Callable
from math import prod
from sys import float_info

import numpy as np
import pinocchio as pin
from scipy.linalg.blas import daxpy, ddot, dscal
from scipy.linalg.lapack import dgesv, dgetrf, dgetri

from ..arguments import Array
from ..model import fast_kinematics
from ..model.task import Task
from ..potentials import fast_potentials
from ..potentials.basis import Potentials
from ..redundancy.augmented import is_regular
from ..redundancy.inverses import RANK_TOLERANCE
from .fast_loop import FastLoop, StepLimits, checked, failure


def python_loops(task: Task, potentials: Potentials) -> Callable[[], FastLoop]:
    """Return a function without arguments that creates the fast functions, in Python.

    It is called once per thread, so that each thread has separate working memory.
    """
    return lambda: checked(task, _control_law(task, potentials))


def _control_law(task: Task, potentials: Potentials) -> FastLoop:
    """Create the control law of the repeatable inverse of potentials h, in preallocated memory.

    Its step is ``q + J_V⁻¹ (dt [ẋ; 0] + K dt [x − f(q); c − h(q)])`` with ``J_V = [J; Vᵀ]`` (37).
    """
    n, m = task.n, task.m
    memory = np.zeros(n * n + n)
    J_V, rhs = (
        memory[: n * n].reshape((n, n), order="F"),
        memory[n * n :],
    )  # [J; Vᵀ] (37)
    top, bottom = rhs[:m], rhs[m:]
    jacobian, error, rate = fast_kinematics.in_place(task, J_V[:m], top)
    slope, gap = fast_potentials.in_place(potentials, J_V[m:], bottom)
    whole = task.kind == "pose"
    used, slowed = 0.0, 1.0

    def evaluate(q: Array) -> None:
        jacobian(q)
        slope(q)

    solved = checked_solve(task, memory, J_V, rhs, evaluate)

    def solved_within(q: Array, bounds: StepLimits, dt: float) -> Array:
        """Solve ``J_V x = rhs`` with damping, and shorten x to the speed limits."""
        nonlocal used, slowed
        damping, most = bounds.damping, bounds.velocity_limit * dt
        used, slowed = 0.0, 1.0
        if damping:
            x, used = damped(J_V, rhs, damping)
            if not np.isfinite(x).all():
                raise failure(task, q, rhs)
        else:
            x = solved(q)
        if (np.abs(x) <= most).all():
            return x
        bottom[:] = 0.0
        if damping:
            x_task = damped(J_V, rhs, damping)[0]
        else:
            evaluate(q)
            x_task = solved(q)
        x, slowed = within(x, x_task, most)
        return x

    def velocity(q: Array, xdot: Array) -> Array:
        evaluate(q)
        top[:] = xdot
        bottom[:] = 0.0
        return solved(q)

    def step(
        q: Array,
        target: pin.SE3,
        dt: float,
        twist: Array | None,
        leaf: Array | None,
        gain: float | None,
        bounds: StepLimits | None,
    ) -> Array:
        evaluate(q)
        error(target)
        if leaf is None:
            bottom[:] = 0.0
        else:
            gap(leaf)
        if gain is not None:
            dscal(gain * dt, rhs)
        if twist is not None:
            daxpy(twist if whole else rate(twist), rhs, m, dt)
        x = solved(q) if bounds is None else solved_within(q, bounds, dt)
        return daxpy(q, x, n)

    return FastLoop(velocity, step, lambda: (used, slowed))


def checked_solve(
    task: Task, memory: Array, J_V: Array, rhs: Array, evaluate: Callable[[Array], None]
) -> Callable[[Array], Array]:
    """Create the function q → x that solves ``J_V x = rhs``, or raises SingularityError.

    Parameters
    ----------
    task
        Task, for error messages.
    memory : array
        Memory block that begins with J_V, column by column. If it also contains rhs, overflow of x
        is detected, too.
    J_V : (n, n) array
        Evaluated at q by the caller; overwritten.
    rhs : (n,) or (n, k) array
        Right-hand side, or k of them.
    evaluate
        Function that writes J_V at q again. It is needed only where a fast test cannot show that
        J_V is regular, and its rank is tested exactly.
    """
    n = task.n
    pivots, half, tolerance = (
        memory[: n * n : n + 1],
        n / 2,
        RANK_TOLERANCE / n ** (n / 2),
    )
    largest = float_info.max ** (1 / half)  # square ** half overflows beyond it

    def solved(q: Array) -> Array:
        square = ddot(memory, memory)
        _, order, x, info = dgesv(J_V, rhs, 1, 0)
        # |det J_V| = |∏ pivots| ≤ sin θ ∏ ‖row‖ ≤ sin θ (‖J_V‖/√n)ⁿ, θ the smallest angle of
        # is_regular, so this test is sufficient. NaN fails it. Where it fails, the exact test
        # decides. It bounds x, too: ‖x‖ ≤ square^half / |det J_V|.
        if not (
            square < largest and abs(prod(pivots.tolist())) > tolerance * square**half
        ):
            inverse = None if info else dgetri(J_V, order)[0]
            evaluate(q)
            if inverse is None or not (
                np.isfinite(x).all() and is_regular(J_V, inverse)
            ):
                raise failure(task, q, rhs)
        return x

    return solved


@np.errstate(over="ignore", invalid="ignore")
def damped(J_V: Array, rhs: Array, most: float) -> tuple[Array, float]:
    """Solve ``J_V x = rhs``, damped where J_V is near a singularity.

    ``x = Σ_i v_i σ_i / (σ_i² + λ²) u_iᵀ rhs``, with ``λ² = λ_max² (1 − (σ_min / 2λ_max)²)`` where
    ``σ_min < 2 λ_max`` and λ = 0 elsewhere. So x is continuous in J_V, and
    ``‖x‖ ≤ ‖rhs‖ / (√3 λ_max)`` where λ > 0.

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
        The λ that was used; 0 where the solution is exact.
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
    """Shorten a step ``x = x_task + x_leaf`` to the maximum step of each joint.

    The return to the leaf, x_leaf, is scaled down first, so that the task keeps its speed. If that
    is not enough, the whole step is scaled down.

    Parameters
    ----------
    x, x_task, most : (n,) arrays
        Step, its part that moves the frame, and maximum step of each joint, rad or m.

    Returns
    -------
    x : (n,) array
        Shortened step.
    slowed : float
        Smaller one of the two factors, of x_leaf and of the whole step.
    """
    x_leaf = x - x_task
    left = np.where(x_leaf > 0, most - x_task, most + x_task)
    moving = np.abs(x_leaf) > 1e-15
    share = float(
        np.clip((left[moving] / np.abs(x_leaf[moving])).min(initial=1.0), 0.0, 1.0)
    )
    shorter = x_task + share * x_leaf
    whole = float((most / np.maximum(np.abs(shorter), 1e-300)).min(initial=1.0))
    return shorter * min(1.0, whole), min(share, whole)
