"""A task's kinematics at one q after another, into memory that is there already: what a control
loop needs.

The functions made here are closures, and copy short vectors by BLAS: in a step of 5 µs it is the
calls and the look-ups that count, not the arithmetic."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from scipy.linalg.blas import daxpy, dcopy

from ..arguments import Array
from .formulas import axis_turn, is_rotation, require_rotation
from .model import SHARED
from .task import Task


@dataclass(frozen=True)
class InPlace:
    """Evaluates J, and then the task error, at one q after another.

    It works in the scratch memory of the thread that made it, and serves that thread alone. Nothing
    else is checked; a caller who was given bad numbers asks :meth:`Task.jacobian` for the reason.

    Attributes
    ----------
    jacobian : function q → None
        Writes J(q) (m, n).
    error : function target → None
        Writes the task error (m,) from the placement at that q to a target, as :meth:`Task.error`
        does; refuses a target whose rotation counts and is none.
    task_velocity : function twist → (m,) array
        Takes ẋ out of a frame's twist (v, ω) at that q, as :meth:`Task.task_velocity` does.
    """

    jacobian: Callable[[Array], None]
    error: Callable[[pin.SE3], None]
    task_velocity: Callable[[Array], Array]


def in_place(task: Task, J: Array, e: Array) -> InPlace:
    """Make the functions that write a task's J into an array (m, n), and its errors into one
    (m,)."""
    here = task._data.oMf[task._frame_id]
    p, R = here.translation, here.rotation  # views that follow every evaluation
    return InPlace(_jacobian(task, J), _error(task, e, p, R), _rate(task, R))


def _jacobian(task: Task, J: Array) -> Callable[[Array], None]:
    evaluate, model, data, frame, shared = (
        pin.computeFrameJacobian,
        task.model,
        task._data,
        task._frame_id,
        SHARED,
    )

    def whole(q: Array) -> None:
        J[:] = evaluate(model, data, q, frame, shared)

    def rows(q: Array) -> None:
        J[:] = task._task_rows(evaluate(model, data, q, frame, shared))

    if task.drive is None:
        return whole if task.kind == "pose" else rows
    drive = task.drive

    def driven(q: Array) -> None:
        J[:] = task._task_rows(evaluate(model, data, drive.joints(q), frame, shared)) @ drive.S

    return driven


def _error(task: Task, e: Array, p: Array, R: Array) -> Callable[[pin.SE3], None]:
    R_T, turn, rows, log3 = R.T, np.empty((3, 3)), task.rows, pin.log3
    flat = turn.reshape(9)

    def pose(target: pin.SE3) -> None:
        dcopy(target.translation, e, 3)
        daxpy(p, e, 3, -1.0)
        goal = target.rotation
        goal.dot(R_T, turn)
        if not is_rotation(flat.tolist()):  # R is one, so turn is where the goal is
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
