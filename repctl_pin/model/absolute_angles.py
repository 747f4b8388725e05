"""Weight of the joint speeds that makes J⁺ minimise the speeds of a planar arm's link angles.

q (n,) are the joint positions, J is the task Jacobian and J⁺ its pseudoinverse.
"""

from __future__ import annotations

import numpy as np

from ..base.arguments import Array
from ..base.errors import InputError
from .task import Task, require_task


def absolute_angles(task: Task) -> Array:
    r"""Compute the weight M with which J⁺ minimises the speeds of the absolute link angles.

    .. math:: \dot q^T M \dot q = \lVert \dot\psi \rVert^2, \qquad \psi = T^{-1} q,
              \qquad M = T^{-T} T^{-1}.

    If joint i is revolute, ψ_i is the angle of link i to the base: the sum of the positions of all
    revolute joints up to the i-th, with a minus sign for each joint whose axis is opposite to that
    of the first revolute joint. If joint i is prismatic, ψ_i = q_i. For an arm that the paper
    describes by absolute angles, the paper's J⁺ is the inverse with weight M.

    Parameters
    ----------
    task
        Task of an arm whose revolute joints are all parallel.

    Returns
    -------
    (n, n) array
        Weight M, for :class:`WeightedInverse`.

    Raises
    ------
    InputError
        If the revolute axes are not all parallel, or some joints mimic others: then a link angle is
        not a sum of joint angles.

    Examples
    --------
    >>> rp.absolute_angles(task)
    array([[3., 2., 1.],
           [2., 2., 1.],
           [1., 1., 1.]])
    >>> G = rp.WeightedInverse(task, rp.absolute_angles(task))
    >>> links = np.cumsum(G.velocity(q0, [0.1, 0.0]))  # ψ̇, rad/s
    >>> bool(np.linalg.norm(links) < np.linalg.norm(np.cumsum(control.velocity(q0, [0.1, 0.0]))))
    True
    """
    if not require_task(task).drive.identity:
        raise InputError(
            "absolute angles require independent joints, but some joints of this chain "
            "mimic others",
            remedy="use J⁺, or another weight of rp.WeightedInverse",
        )
    turning = np.flatnonzero(task.revolute)
    axes = task.axes(task.reference)[turning]  # (revolute joints, 3)
    signs = axes @ axes[0] if len(axes) else np.zeros(0)
    for joint, sign in zip(turning, signs, strict=True):
        if abs(abs(sign) - 1) > 1e-9:
            raise InputError(
                f"absolute angles require parallel axes, but {task.joint_names[joint]!r} "
                f"is not parallel to {task.joint_names[turning[0]]!r}",
                remedy="use J⁺, or another weight of rp.WeightedInverse",
            )
    A = np.eye(task.n)  # T⁻¹
    A[np.ix_(turning, turning)] = np.tril(np.ones((len(turning), 1)) * np.sign(signs))
    return A.T @ A
