"""Allocation-free task kinematics for control loops.

The functions are closures and copy short vectors by BLAS: in a control step of 5 µs, Python's
function calls and attribute look-ups take longer than the arithmetic.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin
from scipy.linalg.blas import daxpy, dcopy

from ..arguments import Array
from .chain_formulas import axis_turn, is_rotation, require_rotation
from .model import SHARED
from .task import Task


def in_place(
    task: Task, J: Array, e: Array
) -> tuple[
    Callable[[Array], None], Callable[[pin.SE3], None], Callable[[Array], Array]
]:
    """Create the functions that write a task's Jacobian into J (m, n) and its error into e (m,).

    ``jacobian(q)`` is called first; ``error`` and ``task_velocity`` then refer to this q. They use
    scratch memory of the thread that created them, and only that thread may call them. Arguments
    are not checked: if a result is not finite, :meth:`Task.jacobian` raises an error with the
    reason.

    Returns
    -------
    jacobian : function q → None
        Write J(q) into J.
    error : function target → None
        Write the task error from f(q) to a target into e, as :meth:`Task.error` computes it; raise
        InputError if the target's rotation is needed and is not a rotation.
    task_velocity : function twist → (m,) array
        Extract ẋ from the twist (v, ω) of the frame at q, as :meth:`Task.task_velocity` does.
    """
    here = task._data.oMf[task._frame_id]
    p, R = here.translation, here.rotation  # views, updated by every evaluation
    return _jacobian(task, J), _error(task, e, p, R), _rate(task, R)


def _jacobian(task: Task, J: Array) -> Callable[[Array], None]:
    evaluate, shared = pin.computeFrameJacobian, SHARED
    model, data, frame = task.model, task._data, task._frame_id

    def whole(q: Array) -> None:
        J[:] = evaluate(model, data, q, frame, shared)

    def rows(q: Array) -> None:
        J[:] = task._task_rows(evaluate(model, data, q, frame, shared))

    if task.drive is None:
        return whole if task.kind == "pose" else rows
    drive = task.drive

    def driven(q: Array) -> None:
        J[:] = (
            task._task_rows(evaluate(model, data, drive.joints(q), frame, shared))
            @ drive.S
        )

    return driven


def _error(task: Task, e: Array, p: Array, R: Array) -> Callable[[pin.SE3], None]:
    R_T, turn, rows, log3 = R.T, np.empty((3, 3)), task.rows, pin.log3
    flat = turn.reshape(9)

    def pose(target: pin.SE3) -> None:
        dcopy(target.translation, e, 3)
        daxpy(p, e, 3, -1.0)
        goal = target.rotation
        goal.dot(R_T, turn)
        if not is_rotation(
            flat.tolist()
        ):  # R is a rotation, so R* Rᵀ is one if and only if R* is
            require_rotation(goal, "the target")
        dcopy(log3(turn), e, 3, 0, 1, 3)

    def axis(target: pin.SE3) -> None:
        goal = target.rotation
        turn[:] = goal
        if not is_rotation(flat.tolist()):
            require_rotation(goal, "the target")
        e[:3] = target.translation - p
        e[3:] = axis_turn(R, goal)

    def position(target: pin.SE3) -> None:
        e[:] = (target.translation - p)[rows]

    return {"pose": pose, "axis": axis}.get(task.kind, position)


def _rate(task: Task, R: Array) -> Callable[[Array], Array]:
    rows = task.rows

    def whole(twist: Array) -> Array:
        return twist

    def axis(twist: Array) -> Array:
        return np.concatenate([twist[:3], R.T[:2] @ twist[3:]])

    def part(twist: Array) -> Array:
        return np.asarray(twist)[rows]

    return {"pose": whole, "axis": axis}.get(task.kind, part)
