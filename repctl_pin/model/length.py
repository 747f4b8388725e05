"""Arm length, comparable joint units, and the elbow joint.

Lengths along the arm are sums of the distances between successive joints; its middle is from 0.3 to
0.7 of its length. A self-motion moves the joints while the frame rests.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..base.arguments import Array
from .several_frames import of_singles
from .task import Task

_MIDDLE = (0.3, 0.7)
"""Range along the arm, as fractions of its length, in which a joint can be the elbow."""

_RANK = 1e-9
"""Share of the largest singular value of J below which a direction moves no frame."""


def arm_length(task: Task, q: Array) -> float:
    """Compute the arm length, m: the sum of the distances between successive revolute joints.

    The distance from the last revolute joint to the frame is added. The arm length is 0 without
    revolute joints. With several frames, it is the largest length of their chains.

    Parameters
    ----------
    task
        Task of the chain.
    q : (n,) array
        Configuration.
    """
    if len(task.frames) > 1:
        return max(arm_length(*single) for single in of_singles(task, q))
    turning = np.append(np.linalg.norm(task.axes(q), axis=1) > 0.5, True)
    stations = np.vstack([task.joint_origins(q), task.placement(q).translation])[turning]
    return float(np.linalg.norm(np.diff(stations, axis=0), axis=1).sum())


def arm_reach(task: Task, q: Array) -> float:
    """Compute the arm length at q (n,), m, plus the strokes of prismatic joints that have limits.

    Default path sizes are fractions of this reach.
    """
    strokes = (task.upper - task.lower)[~task.revolute]
    return arm_length(task, q) + float(strokes[np.isfinite(strokes)].sum())


def joint_scale(task: Task, q: Array) -> Array:
    """Return the unit of each joint (n,): 1 rad, or the arm length in m for a prismatic joint.

    Divided by these units, motions of revolute and prismatic joints are comparable. The arm length
    is measured at the configuration q (n,). Without revolute joints, the unit is 1 m.
    """
    if task.revolute.all():
        return np.ones(task.n)
    return np.where(task.revolute, 1.0, arm_length(task, q) or 1.0)


def elbow(task: Task, q: Array) -> int:
    """Find the index, in q, of the elbow joint.

    It is the revolute joint in the middle of the arm whose origin p moves most in self-motions: it
    maximises ``Σ_i ‖∂p/∂z_i‖²``, with ``q̇ = N ż`` and the columns of N an orthonormal basis of the
    null space of J. Without a self-motion, it is the joint nearest to the middle. If no revolute
    joint lies in the middle of the arm, all joints are candidates.

    Parameters
    ----------
    task
        Task of the chain.
    q : (n,) array
        Configuration.
    """
    step = 1e-4
    here = task.joint_origins(q)
    share = _along_arm(task, q)
    # at a singularity, all directions without motion of the frame
    _, s, V_T = np.linalg.svd(task.jacobian(q))
    N = V_T[np.sum(s > _RANK * s.max()) :].T
    moved = [task.joint_origins(q + step * n) for n in N.T]
    speed = np.sum([np.linalg.norm(p - here, axis=1) ** 2 for p in moved], axis=0)
    middle = in_the_middle(task, q)
    key = np.where(middle, speed, -1.0) if middle.any() else speed
    best = key >= key.max() * (1 - 1e-6)
    return int(np.argmin(np.where(best, np.abs(share - 0.5), np.inf)))


def in_the_middle(task: Task, q: Array) -> NDArray[np.bool_]:
    """Return a mask (n,): True for a revolute joint in the middle of the arm at q (n,)."""
    share = _along_arm(task, q)
    return (_MIDDLE[0] <= share) & (share <= _MIDDLE[1]) & task.revolute


def _along_arm(task: Task, q: Array) -> Array:
    """Compute the positions of the joint origins along the arm at q, as fractions of its length.

    Return them as an array (n,): 0 is the first joint, and 1 would be the frame.
    """
    if len(task.frames) > 1:
        shares = np.zeros(task.n)
        for single, own in of_singles(task, q):
            columns = [task.joint_names.index(joint) for joint in single.joint_names]
            shares[columns] = _along_arm(single, own)
        return shares
    stations = np.vstack([task.joint_origins(q), task.placement(q).translation])
    along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(stations, axis=0), axis=1)))
    return along[:-1] / (along[-1] or 1.0)
