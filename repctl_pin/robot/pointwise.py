"""A task's kinematics at one q after another, into memory that is there already: what a control loop needs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from .axis import axis_turn

if TYPE_CHECKING:
    from .task import Task

Array = NDArray[np.float64]

_frame_jacobian = pin.computeFrameJacobian
_log3 = pin.log3
_SHARED = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED


class Pointwise:
    """Evaluates J, and then the task error, at one q after another.

    ``jacobian(q)`` writes J (m, n); ``error(target)`` then writes the task error (m,) from the placement at
    that q, the same as :meth:`Task.error`.

    Nothing is checked here: a caller who is given bad numbers asks :meth:`Task.jacobian` for the reason.
    It works in the task's own scratch memory, so neither is to be shared between threads.

    Parameters
    ----------
    task
        The task.
    J : (m, n) array
        Where the Jacobian is written.
    e : (m,) array
        Where errors and velocities are written.
    """

    def __init__(self, task: Task, J: Array, e: Array) -> None:
        self.task, self.J, self.e = task, J, e
        self._model, self._data, self._frame = task.model, task._data, task._frame_id
        here = self._data.oMf[self._frame]
        self._here = here  # keeps the two views below alive; they follow every evaluation
        self._p, self._R = here.translation, here.rotation
        self._R_T = self._R.T
        self._turn = np.empty((3, 3))
        self._linear, self._angular = e[:3], e[3:]
        self._T = None if task.coordinates is None else task.coordinates.T
        pose = task.kind == "pose"
        self.jacobian = self._jacobian_whole if pose and self._T is None else self._jacobian_rows
        self.error = self._error_pose if pose else self._error_other

    def _jacobian_whole(self, q: Array) -> None:
        self.J[:] = _frame_jacobian(self._model, self._data, q, self._frame, _SHARED)

    def _jacobian_rows(self, q: Array) -> None:
        """Write J(q) (m, n)."""
        if self._T is None:
            self.J[:] = self.task._task_rows(_frame_jacobian(self._model, self._data, q, self._frame, _SHARED))
        else:
            J = _frame_jacobian(self._model, self._data, self._T @ q, self._frame, _SHARED)
            self.J[:] = self.task._task_rows(J) @ self._T

    def _error_pose(self, target: pin.SE3) -> None:
        np.subtract(target.translation, self._p, self._linear)
        self._angular[:] = _log3(target.rotation.dot(self._R_T, self._turn))

    def _error_other(self, target: pin.SE3) -> None:
        if self.task.kind == "axis":
            self._angular[:] = axis_turn(self._R, target.rotation)
            np.subtract(target.translation, self._p, self._linear)
        else:
            self.e[:] = (target.translation - self._p)[self.task.rows]

    def rate(self, twist: Array) -> Array:
        """Take ẋ (m,) out of a frame's twist (v, ω), world axes, at the last q."""
        if self.task.kind == "pose":
            return twist
        if self.task.kind != "axis":
            return twist[self.task.rows]
        return np.concatenate([twist[:3], self._R_T[:2] @ twist[3:]])
