"""How long an arm is, the unit in which slides and turns can be compared; and which of its joints
is the elbow."""

from __future__ import annotations

import numpy as np

from ..arguments import Array
from ..redundancy import nullspace
from .task import Task


def arm_length(task: Task, q: Array) -> float:
    """Sum the distances from one turning joint to the next, and to the frame, m; 0 if no joint
    turns.

    Parameters
    ----------
    task
        Whose chain is measured; in changed coordinates, too.
    q : (n,) array
        Configuration.
    """
    turning = np.append(np.linalg.norm(task.axes(q), axis=1) > 0.5, True)
    stations = np.vstack([task.joint_origins(q), task.placement(q).translation])[turning]
    return float(np.linalg.norm(np.diff(stations, axis=0), axis=1).sum())


def joint_scale(task: Task, q: Array) -> Array:
    """Choose a unit for every joint: 1 rad, and for a prismatic joint the length of the arm, m:
    (n,).

    In these units joint motions of both kinds can be compared. An arm that has no length, of
    prismatic joints alone, is measured in m.
    """
    if task.revolute.all():
        return np.ones(task.n)
    return np.where(task.revolute, 1.0, arm_length(task, q) or 1.0)


def elbow(task: Task, q: Array) -> int:
    """Find the joint whose origin moves most when the arm moves in its null space, q̇ = N ż: its
    elbow.

    Of all self-motions with ‖ż‖ = 1 alike: the largest ``Σ_i ‖dp/dz_i‖²``, p the joint's origin.

    Parameters
    ----------
    task
        Whose joints are looked at.
    q : (n,) array
        Configuration.
    """
    step = 1e-4
    here = task.joint_origins(q)
    moved = [task.joint_origins(q + step * n) for n in nullspace(task.jacobian(q)).T]
    return int(np.argmax(sum(np.linalg.norm(p - here, axis=1) ** 2 for p in moved)))
