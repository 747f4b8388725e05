"""Absolute link angles of a planar arm as joint coordinates."""

from __future__ import annotations

import numpy as np

from ..base.arguments import Array
from ..base.errors import InputError
from .task import Task, require_task


def absolute_angles(task: Task) -> Array:
    """Compute the matrix T of q = T ψ, with ψ the absolute link angles of a planar arm.

    ``ψ_i = ± q_1 ± … ± q_i`` over the revolute joints up to the i-th, with minus for a joint whose
    axis is opposite to that of the first one; so ``q_i = ± (ψ_i − ψ_(i−1))``. For a prismatic
    joint, ψ_i = q_i.

    Parameters
    ----------
    task
        Task of an arm whose revolute joints are all parallel.

    Returns
    -------
    (n, n) array
        For :meth:`Task.in_coordinates`.

    Raises
    ------
    InputError
        If the revolute axes are not all parallel: then a link angle is not a sum of joint angles.

    Examples
    --------
    >>> T = rp.absolute_angles(task)
    >>> links = task.in_coordinates(T)  # q = T ψ
    >>> psi = np.linalg.solve(T, q0)
    >>> psi.round(3)  # rad: the links' angles from the base's x axis
    array([0.3, 1.1, 1.9])
    >>> np.allclose(links.placement(psi).translation, task.placement(q0).translation)
    True
    """
    if require_task(task).coordinates is not None:
        raise InputError(
            "the task already has joint coordinates; "
            "compute the absolute angles of the original task"
        )
    if not task.drive.identity:
        raise InputError(
            "absolute angles require independent joints, but some joints of this chain "
            "mimic others; pass a custom T to in_coordinates()"
        )
    turning = np.flatnonzero(task.revolute)
    axes = task.axes(task.reference)[turning]  # (revolute joints, 3)
    signs = axes @ axes[0] if len(axes) else np.zeros(0)
    for joint, sign in zip(turning, signs, strict=True):
        if abs(abs(sign) - 1) > 1e-9:
            raise InputError(
                f"absolute angles require parallel axes, but {task.joint_names[joint]!r} "
                f"is not parallel to {task.joint_names[turning[0]]!r}; "
                "pass a custom T to in_coordinates()"
            )
    T = np.eye(task.n)
    for k, (joint, sign) in enumerate(zip(turning, np.sign(signs), strict=True)):
        T[joint, joint] = sign
        if k:
            T[joint, turning[k - 1]] = -sign
    return T
