"""Allocation-free evaluation of q = F(x) in a control loop, one placement at a time.

The steps are the coordinates u of the placement in the cell, their monomials, and Newton's method.
The functions are closures over preallocated memory, see :mod:`repctl_pin.strategies.fast_loop`."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin
from scipy.linalg.blas import dcopy, dgemv, idamax
from scipy.linalg.lapack import dgesv

from ...arguments import Array
from ...model import fast_kinematics
from ...model.chain_formulas import axis_turn, is_rotation
from ...model.task import Task
from ...solvers import newton
from .cell import EDGE, TURNED, Cell
from .chart import Chart
from .fast_sector import FastCoordinates, sector_coordinates
from .monomials import Monomials
from .sector import Sector

_MOST = 12
_STEP = 0.3
_ENOUGH = 1e-6
"""Largest entry of the last Newton step, rad or m; the error after it is at rounding level."""


def fast_coordinates(cell: Cell) -> FastCoordinates:
    """Make the functions that convert placements to coordinates of a cell."""
    if isinstance(cell, Sector):
        return sector_coordinates(cell)
    p_0, R_0T = cell.placement.translation.copy(), cell.placement.rotation.T.copy()
    R_0 = R_0T.T
    m, on = cell.task.m, np.flatnonzero(cell.widths > 0)
    held, inverse = np.flatnonzero(cell.widths == 0), 1.0 / cell.widths[on]
    rows = cell.task.rows[: len(cell.half_width)]
    middle = p_0[rows]
    u, y, turn, fixed = np.zeros(cell.k), np.zeros(m), np.eye(3), np.zeros(len(held))
    linear, log3, Jlog3, Jexp3, subtract, multiply = (
        y[:3],
        pin.log3,
        pin.Jlog3,
        pin.Jexp3,
        np.subtract,
        np.multiply,
    )
    whole, frame = len(held) == 0, [R_0]

    def finish() -> float:
        if whole:
            multiply(y, inverse, u)
            return 0.0
        y.take(held, None, fixed, "clip")
        multiply(y.take(on), inverse, u)
        return abs(float(fixed[idamax(fixed)]))

    def locate_pose(p: Array, R: Array) -> float:
        subtract(p, p_0, linear)
        dcopy(log3(R.dot(R_0T, turn)), y, 3, 0, 1, 3)
        return finish()

    def locate_axis(p: Array, R: Array) -> float:
        subtract(p, p_0, linear)
        y[3:] = axis_turn(R_0, R)
        frame[0] = R
        return finish()

    def locate_point(p: Array, R: Array) -> float:
        subtract(p.take(rows), middle, y)
        return finish()

    def pull(D: Array, X: Array) -> None:
        X[:, on] = D * inverse

    def pull_pose(D: Array, X: Array) -> None:
        X[:, on] = D * inverse
        X[:, held] = 0.0
        X[:, 3:] = X[:, 3:].dot(Jlog3(turn).T)  # the transpose of J_r⁻¹(ω) is J_l⁻¹(ω)

    def pull_axis(D: Array, X: Array) -> None:
        X[:, on] = D * inverse
        X[:, held] = 0.0
        J_l = Jexp3(R_0[:, :2].dot(y[3:])).T
        (a, b), (c, d) = (frame[0][:, :2].T.dot(J_l).dot(R_0[:, :2])).tolist()
        det = a * d - b * c
        X[:, 3:] = X[:, 3:].dot(np.array([[d / det, -b / det], [-c / det, a / det]]))

    if cell.task.kind == "axis":
        return FastCoordinates(u, locate_axis, pull_axis)
    if cell.task.kind == "pose":
        return FastCoordinates(
            u, locate_pose, pull_pose if cell.rotation.any() else pull
        )
    return FastCoordinates(u, locate_point, pull)


def monomials_at(monomials: Monomials, u: Array) -> tuple[Array, Callable[[], None]]:
    """Make an array T (N,) for monomials, and a function without arguments that evaluates them.

    The function reads the coordinates from the array u (k,), and writes the monomials into T.
    """
    T = np.ones(monomials.size)
    at = {tuple(e): i for i, e in enumerate(monomials.exponents.tolist())}
    linear = T[1 : 1 + monomials.k]
    stages, done = [], 1
    while done < monomials.degree:
        following = min(2 * done, monomials.degree)
        part = slice(monomials.starts[done + 1], monomials.starts[following + 1])
        first, second = [], []
        for alpha in monomials.exponents[part].tolist():
            left: list[int] = []  # the factor of degree ``done``; the other is the rest
            for power in alpha:
                left.append(min(power, done - sum(left)))
            first.append(at[tuple(left)])
            second.append(at[tuple(a - b for a, b in zip(alpha, left, strict=True))])
        stages.append(
            (
                np.array(first),
                np.array(second),
                np.empty(len(first)),
                np.empty(len(first)),
                T[part],
            )
        )
        done = following
    take, multiply = T.take, np.multiply

    def evaluate() -> None:
        linear[:] = u
        for first, second, a, b, out in stages:
            take(first, None, a, "clip")
            take(second, None, b, "clip")
            multiply(a, b, out)

    return T, evaluate


class OutsideError(Exception):
    """The target is outside the cell or no rigid transform, or Newton's method fails."""


def evaluation(chart: Chart) -> Callable[[pin.SE3, Array | None], Array]:
    """Make the function (target, leaf or None) → q (n,) that evaluates a chart in a control loop.

    It evaluates the polynomials q_ref and n_ref, then takes a few Newton steps. It uses its own
    preallocated memory, so each thread needs its own function. It raises OutsideError if the target
    is outside the cell or Newton's method does not converge.
    """
    task = chart.cell.task
    n, m, r = task.n, task.m, task.r
    memory = np.zeros(n * n + n)
    J_V, rhs = memory[: n * n].reshape((n, n), order="F"), memory[n * n :]
    upper, lower, bottom = J_V[:m], J_V[m:], rhs[m:]
    jacobian, *_ = fast_kinematics.in_place(task, upper, rhs[:m])
    aim, error = _errors(task, upper, rhs[:m])
    coordinates = fast_coordinates(chart.cell)
    u, locate, shift = coordinates.u, coordinates.locate, coordinates.shift
    T, monomials = monomials_at(chart.monomials, u)
    C_T = np.asfortranarray(
        np.moveaxis(chart.coefficients, 0, -1).swapaxes(0, 1).reshape(n * (1 + r), -1)
    )
    both = np.zeros(n * (1 + r))
    q_ref, n_T = both[:n], both[n:].reshape(r, n)
    n_F = n_T.T  # (n, r), column-major: a view
    away, k, subtract, add = np.zeros(n), len(u), np.subtract, np.add
    c: Array | None = None

    def correction(q: Array) -> Array:
        jacobian(q)
        lower[:] = n_T
        error()
        subtract(q_ref, q, away)
        dgemv(1.0, n_F, away, 0.0, bottom, 0, 1, 0, 1, 1, 1)
        if c is not None:
            bottom[:] += c
        _, _, step, info = dgesv(J_V, rhs, 1, 0)
        if info:
            raise OutsideError
        return step

    def evaluate(target: pin.SE3, leaf: Array | None = None) -> Array:
        nonlocal c
        p, R = target.translation, target.rotation
        if not (locate(p, R) <= TURNED and abs(u[idamax(u, k)]) <= 1 + EDGE):
            raise OutsideError
        monomials()
        dgemv(1.0, C_T, T, 0.0, both, 0, 1, 0, 1, 0, 1)
        if shift is not None:
            add(q_ref, shift, q_ref)
        c = leaf
        aim(target, p, R)
        start = q_ref if leaf is None else q_ref + leaf @ n_T
        q = newton(
            correction, start, longest=_STEP, tolerance=_ENOUGH, iterations=_MOST
        )
        if q is None:
            raise OutsideError
        return q

    return evaluate


def _errors(
    task: Task, J: Array, e: Array
) -> tuple[Callable[[pin.SE3, Array, Array], None], Callable[[], None]]:
    """Make two functions: one sets a target, the other writes the task error to that target into e.

    The error is that at the configuration at which the Jacobian J was last evaluated.
    """
    if task.kind not in ("pose", "axis"):
        _, write, _ = fast_kinematics.in_place(task, J, e)
        goal = [pin.SE3.Identity()]

        def aim_at(target: pin.SE3, p: Array, R: Array) -> None:
            goal[0] = target

        return aim_at, lambda: write(goal[0])
    here = task._data.oMf[task._frame_id]
    p, R = here.translation, here.rotation  # views that follow every evaluation
    R_T, turn, log3 = R.T, np.empty((3, 3)), pin.log3
    p_goal, R_goal, linear, angular = np.zeros(3), np.zeros((3, 3)), e[:3], e[3:]
    nine, multiply, subtract = R_goal.reshape(9), R_goal.dot, np.subtract

    def aim(target: pin.SE3, p: Array, R: Array) -> None:
        p_goal[:] = p
        R_goal[:] = R
        if not is_rotation(nine.tolist()):
            raise OutsideError

    def pose() -> None:
        subtract(p_goal, p, linear)
        angular[:] = log3(multiply(R_T, turn))

    def axis() -> None:
        subtract(p_goal, p, linear)
        angular[:] = axis_turn(R, R_goal)

    return aim, pose if task.kind == "pose" else axis
