"""One evaluation of q = F(x), from nothing: a polynomial for where to begin, and two or three Newton steps.

Closures over preallocated memory, see :mod:`repctl_pin.robot.inplace`: in 20 µs it is the calls that count.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin
from scipy.linalg.blas import daxpy, dgemv, idamax
from scipy.linalg.lapack import dgesv

from ..arguments import Array
from ..robot import inplace as kinematics_of
from ..robot.task import Task
from .cell import TURNED
from .chart import Chart
from .inplace import in_place, monomials_at

_MOST = 12
_STEP = 0.3
_EDGE = 1 + 1e-9
_ENOUGH = 1e-6
"""A Newton step, rad or m, after which the error, quadratic in it, is at rounding level."""


class OutsideError(Exception):
    """The target has to be looked at more closely: it is outside the cell, or Newton's method does not converge."""


def evaluation(chart: Chart) -> Callable[[pin.SE3, Array | None], Array]:
    """Make the function (target, leaf or None) → q (n,) of a chart. Not to be shared between threads."""
    task = chart.cell.task
    n, m, r = task.n, task.m, task.r
    memory = np.zeros(n * n + n)
    J_V, rhs = memory[: n * n].reshape((n, n), order="F"), memory[n * n :]
    upper, lower, bottom = J_V[:m], J_V[m:], rhs[m:]
    jacobian = kinematics_of.in_place(task, upper, rhs[:m]).jacobian
    aim, error = _errors(task, upper, rhs[:m])
    coordinates = in_place(chart.cell)
    u, locate = coordinates.u, coordinates.locate
    T, monomials = monomials_at(chart.monomials, u)
    C_T = np.asfortranarray(np.moveaxis(chart.coefficients, 0, -1).swapaxes(0, 1).reshape(n * (1 + r), -1))
    both = np.zeros(n * (1 + r))
    q_ref, n_T = both[:n], both[n:].reshape(r, n)
    n_F = n_T.T  # (n, r), column-major: a view
    away, k, subtract = np.zeros(n), len(u), np.subtract

    def evaluate(target: pin.SE3, leaf: Array | None = None) -> Array:
        p, R = target.translation, target.rotation
        if not (locate(p, R) <= TURNED and abs(u[idamax(u, k)]) <= _EDGE):
            raise OutsideError
        monomials()
        dgemv(1.0, C_T, T, 0.0, both, 0, 1, 0, 1, 0, 1)
        q = q_ref.copy()
        if leaf is not None:
            q += leaf @ n_T
        aim(target, p, R)
        for _ in range(_MOST):
            jacobian(q)
            lower[:] = n_T
            error()
            subtract(q_ref, q, away)
            dgemv(1.0, n_F, away, 0.0, bottom, 0, 1, 0, 1, 1, 1)
            if leaf is not None:
                bottom[:] += leaf
            _, _, step, info = dgesv(J_V, rhs, 1, 0)
            size = abs(step[idamax(step, n)])
            if info or not size < np.inf:
                raise OutsideError
            daxpy(step, q, n, 1.0 if size <= _STEP else _STEP / size)
            if size < _ENOUGH:
                return q
        raise OutsideError

    return evaluate


def _errors(task: Task, J: Array, e: Array) -> tuple[Callable[[pin.SE3, Array, Array], None], Callable[[], None]]:
    """Take a target once, and write the task error to it, at the q of the last Jacobian, as often as asked."""
    if task.kind == "pose":
        here = task._data.oMf[task._frame_id]
        p, R_T, turn, log3 = here.translation, here.rotation.T, np.empty((3, 3)), pin.log3
        p_goal, R_goal, linear, angular = np.zeros(3), np.zeros((3, 3)), e[:3], e[3:]
        multiply, subtract = R_goal.dot, np.subtract

        def aim(target: pin.SE3, p: Array, R: Array) -> None:
            p_goal[:] = p
            R_goal[:] = R

        def error() -> None:
            subtract(p_goal, p, linear)
            angular[:] = log3(multiply(R_T, turn))

        return aim, error
    write, goal = kinematics_of.in_place(task, J, e).error, [pin.SE3.Identity()]

    def aim_at(target: pin.SE3, p: Array, R: Array) -> None:
        goal[0] = target

    return aim_at, lambda: write(goal[0])
