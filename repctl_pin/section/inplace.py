"""A cell's coordinates and their monomials at one placement after another, into memory that is there already.

Closures over preallocated memory, see :mod:`repctl_pin.robot.inplace`: in 20 µs it is the calls that count.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from scipy.linalg.blas import dcopy, idamax

from ..arguments import Array
from ..robot.formulas import axis_turn
from .cell import Cell
from .monomials import Monomials


@dataclass(frozen=True)
class InPlace:
    """Coordinates u of one placement after another. Not to be shared between threads.

    Attributes
    ----------
    u : (k,) array
        Where the coordinates are written.
    locate : function (p, R) → float
        Writes u of a placement, and says how far it is off what the cell holds, m or rad.
    pull : function (D, X) → None
        Writes ``X = D ∂u/∂x`` (r, m) for D (r, k), at the placement last located; X is 0 at first.
    """

    u: Array
    locate: Callable[[Array, Array], float]
    pull: Callable[[Array, Array], None]


def in_place(cell: Cell) -> InPlace:
    """Make the functions of a cell."""
    p_0, R_0T = cell.placement.translation.copy(), cell.placement.rotation.T.copy()
    R_0 = R_0T.T
    m, on = cell.task.m, np.flatnonzero(cell.widths > 0)
    held, inverse = np.flatnonzero(cell.widths == 0), 1.0 / cell.widths[on]
    rows = cell.task.rows[: len(cell.half_width)]
    middle = p_0[rows]
    u, y, turn, fixed = np.zeros(cell.k), np.zeros(m), np.eye(3), np.zeros(len(held))
    linear, log3, Jlog3, Jexp3, subtract, multiply = y[:3], pin.log3, pin.Jlog3, pin.Jexp3, np.subtract, np.multiply
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
        return InPlace(u, locate_axis, pull_axis)
    if cell.task.kind == "pose":
        return InPlace(u, locate_pose, pull_pose if cell.rotation.any() else pull)
    return InPlace(u, locate_point, pull)


def monomials_at(monomials: Monomials, u: Array) -> tuple[Array, Callable[[], None]]:
    """Memory for the monomials T (N,), and the function that evaluates them at u: by products of shorter ones."""
    T = np.ones(monomials.size)
    at = {tuple(e): i for i, e in enumerate(monomials.exponents.tolist())}
    linear = T[1 : 1 + monomials.k]
    stages, done = [], 1
    while done < monomials.degree:
        following = min(2 * done, monomials.degree)
        part = slice(monomials.starts[done + 1], monomials.starts[following + 1])
        first, second = [], []
        for alpha in monomials.exponents[part].tolist():
            left, taken = [0] * len(alpha), 0
            for i, power in enumerate(alpha):  # the factors of the first ``done`` degrees, and the rest
                left[i] = min(power, done - taken)
                taken += left[i]
            first.append(at[tuple(left)])
            second.append(at[tuple(a - b for a, b in zip(alpha, left, strict=True))])
        stages.append((np.array(first), np.array(second), np.empty(len(first)), np.empty(len(first)), T[part]))
        done = following
    take, multiply = T.take, np.multiply

    def evaluate() -> None:
        linear[:] = u
        for first, second, a, b, out in stages:
            take(first, None, a, "clip")
            take(second, None, b, "clip")
            multiply(a, b, out)

    return T, evaluate
