"""Joint coordinates ψ of a task, q = T ψ: absolute angles, gear ratios, coupled drives."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError

if TYPE_CHECKING:
    from .task import Task

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Coordinates:
    """A linear change of joint coordinates, ``q = T ψ``, and what it makes of a task's limits.

    ``J_ψ = J T``, ``H_ψ[a, i, k] = Σ H[a, p, s] T[p, i] T[s, k]``, ``M_ψ = Tᵀ M T``.

    The box of allowed q is no box of ψ. A joint whose row of T has a single entry, q_i = T_ij ψ_j, bounds
    ψ_j exactly, and only such bounds are stated; elsewhere there is −inf, inf. :meth:`Task.check` tests
    q = T ψ itself.

    Attributes
    ----------
    T, inverse : (n, n) arrays
        T and T⁻¹.
    names : tuple of str
        A joint's own name where ψ_i = q_i, else ``ψ1``, ``ψ2``, …
    lower, upper, velocity : (n,) arrays
        The bounds on ψ and its rate that hold whatever the other ψ are.
    revolute : (n,) array of bool
        True where ψ_i turns any joint: it is counted in rad.
    """

    T: Array
    inverse: Array
    names: tuple[str, ...]
    lower: Array
    upper: Array
    velocity: Array
    revolute: NDArray[np.bool_]

    def joints(self, psi: Array) -> Array:
        """Turn ψ (..., n) into q = T ψ."""
        return psi @ self.T.T

    def coordinates(self, q: Array) -> Array:
        """Turn q (..., n) into ψ = T⁻¹ q."""
        return q @ self.inverse.T


def change_of(task: Task, T: ArrayLike) -> Coordinates:
    """Make the change ``q = T ψ`` for a task that is written in its own joints q.

    Raises
    ------
    InputError
        If T is not an invertible (n, n) matrix of finite numbers.
    """
    n = task.n
    try:
        matrix = np.array(T, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"T of q = T ψ must be {n} × {n} numbers") from None
    if matrix.shape != (n, n) or not np.isfinite(matrix).all():
        raise InputError(f"T of q = T ψ must be {n} × {n} finite numbers, one row a joint; got shape {matrix.shape}")
    values = np.linalg.svd(matrix, compute_uv=False)
    if values[-1] <= 1e-12 * values[0]:
        raise InputError("T of q = T ψ must be invertible; its rows are dependent")

    lower, upper, velocity = np.full(n, -np.inf), np.full(n, np.inf), np.full(n, np.inf)
    names = [f"ψ{i + 1}" for i in range(n)]
    for i, row in enumerate(matrix):
        (used,) = np.nonzero(row)
        if len(used) != 1:
            continue
        j, factor = used[0], row[used[0]]
        lower[j], upper[j] = sorted((task.lower[i] / factor, task.upper[i] / factor))
        velocity[j] = task.velocity_limit[i] / abs(factor)
        if factor == 1.0 and np.count_nonzero(matrix[:, j]) == 1:
            names[j] = task.joint_names[i]
    revolute = np.array([task.revolute[np.nonzero(column)[0]].any() for column in matrix.T])
    change = Coordinates(matrix, np.linalg.inv(matrix), tuple(names), lower, upper, velocity, revolute)
    for array in (change.T, change.inverse, lower, upper, velocity, revolute):
        array.setflags(write=False)
    return change


def absolute_angles(task: Task) -> Array:
    """Make the T of q = T ψ with ψ the absolute angles of a planar arm's links.

    ``ψ_i = q_1 + … + q_i`` over the revolute joints up to the i-th (a joint whose axis points the other way
    counts negative), prismatic joints unchanged; so ``q_i = ψ_i − ψ_(i−1)``.

    Parameters
    ----------
    task
        A task of an arm whose revolute joints are all parallel.

    Returns
    -------
    (n, n) array
        For :meth:`Task.in_coordinates`.

    Raises
    ------
    InputError
        If the revolute axes are not all parallel: then no sum of joint angles is a link's angle.
    """
    from .task import wanted_task

    if wanted_task(task).coordinates is not None:
        raise InputError("this task is in joint coordinates already; take the absolute angles of the original task")
    turning = np.flatnonzero(task.revolute)
    axes = task.axes(task.reference)[turning]  # (revolute joints, 3)
    signs = axes @ axes[0] if len(axes) else np.zeros(0)
    for joint, sign in zip(turning, signs, strict=True):
        if abs(abs(sign) - 1) > 1e-9:
            raise InputError(
                f"absolute angles need parallel axes, but {task.joint_names[joint]!r} is not parallel to "
                f"{task.joint_names[turning[0]]!r}; give in_coordinates() a T of your own"
            )
    T = np.eye(task.n)
    for k, (joint, sign) in enumerate(zip(turning, np.sign(signs), strict=True)):
        T[joint, joint] = sign
        if k:
            T[joint, turning[k - 1]] = -sign
    return T
