"""A cell's function, and the gradient of its potential, in Arb's ball arithmetic."""

from __future__ import annotations

import numpy as np
from arb_margin import _eye, _product, _turn
from flint import arb, arb_mat, ctx

ctx.prec = 240

_STEP = arb("1e-24")
"""Step of central differences in u, whose error is about its square."""

Vector = list[arb]
Matrix = list[Vector]


def function_in_balls(problem: object, u: Vector, start: np.ndarray) -> tuple[Vector, Vector]:
    """Evaluate F and V at u, r = 1, pose task, by Newton's method from a configuration near F.

    ``V = n_ref + g' E⁻¹ J``, with g' and E the derivatives by u, at constant q, of ``n_refᵀ (q −
    q_ref)`` and of the displacement from f(q) to x(u).
    """
    q, n = [arb(float(x)).mid() for x in start], len(start)
    for _ in range(7):
        J, xi = closure_in_balls(problem, u, q)
        normal = _chart(problem.chart, u, 1)
        rows = arb_mat([*J, normal])
        right = arb_mat([[x] for x in [*xi, -_label(problem.chart, u, q)]])
        step = rows.solve(right)
        q = [(x + step[i, 0]).mid() for i, x in enumerate(q)]
    J, _ = closure_in_balls(problem, u, q)
    E, slopes = [], []
    for i in range(len(u)):
        up, down = ([*u[:i], u[i] + d, *u[i + 1 :]] for d in (_STEP, -_STEP))
        xi = [closure_in_balls(problem, v, q)[1] for v in (up, down)]
        E.append([(a - b) / (2 * _STEP) for a, b in zip(*xi, strict=True)])
        both = [_label(problem.chart, v, q) for v in (up, down)]
        slopes.append((both[0] - both[1]) / (2 * _STEP))
    W = arb_mat(E).solve(arb_mat([[x] for x in slopes]))  # (row W) E = slopes, E by columns
    normal = _chart(problem.chart, u, 1)
    V = [normal[c] + sum((W[a, 0] * J[a][c] for a in range(6)), arb(0)) for c in range(n)]
    return q, V


def _label(chart: object, u: Vector, q: Vector) -> arb:
    away = _minus(q, _chart(chart, u))
    return sum((a * b for a, b in zip(away, _chart(chart, u, 1), strict=True)), arb(0))


def closure_in_balls(problem: object, u: Vector, q: Vector) -> tuple[Matrix, Vector]:
    """Evaluate J (6, 7) at q, and ``(e + p × s, s)`` to the pose at u: revolute joints."""
    chain, cell = problem.chain, problem.cell
    frames, R, o = [], _eye(), [arb(0)] * 3
    for joint in range(len(chain.p)):
        if joint == chain.middle:
            origin, middle = _add(o, _apply(R, _balls(chain.shift))), R
        o = _add(o, _apply(R, _balls(chain.p[joint])))
        R = _product(R, [_balls(row) for row in chain.R[joint]])
        frames.append((_apply(R, _balls(chain.a[joint])), o))
        tool = R
        if joint < len(q):
            R = _product(R, _turn(chain.a[joint], q[joint]))
    back = [list(row) for row in zip(*middle, strict=True)]
    columns = []
    for axis, place in frames[: len(q)]:
        w, p = _apply(back, axis), _apply(back, _minus(place, origin))
        columns.append([*_cross(p, w), *w])
    x, R_x = _pose(cell, u)
    p = _apply(back, _minus(frames[-1][1], origin))
    e = _minus(_apply(back, _minus(x, origin)), p)
    R_t, R_x = _product(back, tool), _product(back, R_x)
    s = [arb(0)] * 3
    for i in range(3):
        s = _add(s, _cross([row[i] for row in R_t], [row[i] for row in R_x]))
    s = [v / 2 for v in s]
    return [[c[a] for c in columns] for a in range(6)], [*_add(e, _cross(p, s)), *s]


def _pose(cell: object, u: Vector) -> tuple[Vector, Matrix]:
    """The pose of a cell of six coordinates: ``p_0 + w u``, ``exp(ω̂) R_0``."""
    y = [arb(float(w)) * a for w, a in zip(cell.widths, u, strict=True)]
    hat = arb_mat([[0, -y[5], y[4]], [y[5], 0, -y[3]], [-y[4], y[3], 0]])
    E = hat.exp()
    R = [[E[i, j] for j in range(3)] for i in range(3)]
    place = _add(_balls(cell.placement.translation), y[:3])
    return place, _product(R, [_balls(row) for row in cell.placement.rotation])


def _chart(chart: object, u: Vector, column: int = 0) -> Vector:
    monomials, values = chart.monomials, [arb(1)]
    for i in range(1, monomials.size):
        values.append(values[monomials.parent[i]] * u[monomials.variable[i]])
    C = chart.coefficients[:, :, column]
    return [
        sum((arb(float(C[i, j])) * v for i, v in enumerate(values)), arb(0))
        for j in range(C.shape[1])
    ]


def _balls(x: np.ndarray) -> Vector:
    return [arb(float(v)) for v in x]


def _apply(R: Matrix, x: Vector) -> Vector:
    return [sum((a * b for a, b in zip(row, x, strict=True)), arb(0)) for row in R]


def _add(a: Vector, b: Vector) -> Vector:
    return [x + y for x, y in zip(a, b, strict=True)]


def _minus(a: Vector, b: Vector) -> Vector:
    return [x - y for x, y in zip(a, b, strict=True)]


def _cross(a: Vector, b: Vector) -> Vector:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
