"""The absolute angles of a planar arm's links, as joint coordinates."""

from __future__ import annotations

import numpy as np

from ..arguments import Array
from ..errors import InputError
from .task import Task, require_task


def absolute_angles(task: Task) -> Array:
    """Make the T of q = T ψ with ψ the absolute angles of a planar arm's links.

    ``ψ_i = q_1 + … + q_i`` over the revolute joints up to the i-th (a joint whose axis points the
    other way counts negative), prismatic joints unchanged; so ``q_i = ψ_i − ψ_(i−1)``.

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
            "this task is in joint coordinates already; take the absolute angles of the original task"
        )
    if task.drive is not None:
        raise InputError(
            "absolute angles need joints that move by themselves, but in this chain some mimic others"
        )
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
