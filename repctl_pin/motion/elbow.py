"""The elbow: where drift shows most."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..redundancy import nullspace
from ..robot.task import Task


def elbow(task: Task, q: NDArray[np.float64]) -> int:
    """Find the joint whose origin moves most when the arm moves in its null space, q̇ = N ż: its elbow.

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
