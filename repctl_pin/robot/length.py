"""Arm length, comparable joint units, and the elbow joint."""

from __future__ import annotations

import numpy as np

from ..arguments import Array
from ..redundancy import nullspace
from .task import Task


def arm_length(task: Task, q: Array) -> float:
    """Compute the arm length, m: sum of the distances between successive revolute joints.

    The distance from the last one to the frame is added. 0 without revolute joints.

    Parameters
    ----------
    task
        Task of the chain; joint coordinates ψ are allowed.
    q : (n,) array
        Configuration.
    """
    turning = np.append(np.linalg.norm(task.axes(q), axis=1) > 0.5, True)
    stations = np.vstack([task.joint_origins(q), task.placement(q).translation])[
        turning
    ]
    return float(np.linalg.norm(np.diff(stations, axis=0), axis=1).sum())


def joint_scale(task: Task, q: Array) -> Array:
    """Return the unit of every joint (n,): 1 rad, or the arm length in m for a prismatic joint.

    In these units, motions of revolute and prismatic joints are comparable. For an arm of prismatic
    joints only, the unit is 1 m.
    """
    if task.revolute.all():
        return np.ones(task.n)
    return np.where(task.revolute, 1.0, arm_length(task, q) or 1.0)


def elbow(task: Task, q: Array) -> int:
    """Find the index of the elbow: the joint whose origin moves most in self-motions q̇ = N ż.

    It maximises ``Σ_i ‖dp/dz_i‖²``, with p the joint's origin and all directions z_i weighted
    equally.

    Parameters
    ----------
    task
        Task of the chain.
    q : (n,) array
        Configuration.
    """
    step = 1e-4
    here = task.joint_origins(q)
    moved = [task.joint_origins(q + step * n) for n in nullspace(task.jacobian(q)).T]
    return int(np.argmax(sum(np.linalg.norm(p - here, axis=1) ** 2 for p in moved)))
