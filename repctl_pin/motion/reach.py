"""Bring the frame to a placement: plain inverse kinematics for the start of a path."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError, SingularityError
from ..redundancy.inverses import pseudoinverse
from ..robot.task import Task
from .paths import Path

Array = NDArray[np.float64]


def reach(
    task: Task,
    q0: ArrayLike,
    target: pin.SE3,
    *,
    tolerance: float = 1e-12,
    iterations: int = 200,
    limits: bool = True,
) -> Array:
    """Find q near q0 with f(q) at the target, by Newton's method with J⁺ and bounded steps.

    Parameters
    ----------
    task, q0
        The task and where to start looking.
    target
        Where the frame should be.
    tolerance, iterations
        When to stop: task error (m and rad), Newton steps.
    limits
        Refuse a configuration outside the joint limits.

    Returns
    -------
    (n,) array

    Raises
    ------
    InputError
        If the target cannot be reached from there, or only outside the joint limits.
    """
    q = np.array(q0, dtype=float)
    error = task.error(q, target)
    where = np.array2string(np.asarray(target.translation), precision=3, separator=", ")
    for _ in range(iterations):
        if np.linalg.norm(error) < tolerance:
            break
        try:
            step = pseudoinverse(task.jacobian(q)) @ error
        except SingularityError:
            raise InputError(
                f"{task.frame!r} cannot reach {where} m: the arm ends stretched or folded at a singularity; "
                "move the path nearer"
            ) from None
        scale = min(1.0, 0.3 / max(float(np.abs(step).max()), 1e-12))
        size = np.linalg.norm(error)
        while True:  # halve the step until it helps
            trial = task.error(q + scale * step, target)
            if np.linalg.norm(trial) < size or scale < 1e-6:
                break
            scale /= 2
        if np.linalg.norm(trial) >= size:
            break
        q, error = q + scale * step, trial
    if not np.linalg.norm(error) < max(tolerance, 1e-9):
        raise InputError(
            f"{task.frame!r} cannot reach {where} m: it stays {np.linalg.norm(error[: min(3, task.m)]):.3g} m short; "
            "move the path nearer or choose another start"
        )
    return task.check(q, f"the start that reaches {where} m") if limits else q


def check_reach(task: Task, q0: ArrayLike, path: Path, *, points: int = 48) -> None:
    """Make sure that the frame can reach every point of a path, joint limits aside.

    Raises
    ------
    InputError
        If it cannot; the message names the first point out of reach.
    """
    q = np.asarray(q0, float)
    for s in np.union1d(np.linspace(0, 1, points), path.breaks):
        q = reach(task, q, path.placement(float(s)), tolerance=1e-9, limits=False)
