"""A chain at the chart's configuration, seen from the middle link, in Arb's ball arithmetic."""

from __future__ import annotations

import numpy as np
from arb_margin import _eye, _product, _turn
from flint import arb, arb_mat, ctx

ctx.prec = 160

Vector = list[arb]
Matrix = list[Vector]


def closure_in_balls(problem: object, u_c: np.ndarray, h: np.ndarray, t: np.ndarray):
    """Evaluate J (6, 7) at q_ref(u), u = u_c + h t, and ``(e + p × s, s)``: revolute joints."""
    chain, cell, chart = problem.chain, problem.cell, problem.chart
    u = [
        arb(float(a)) + arb(float(b)) * arb(float(c))
        for a, b, c in zip(u_c, h, t, strict=True)
    ]
    q = _chart(chart, u)
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


def _chart(chart: object, u: Vector) -> Vector:
    monomials, values = chart.monomials, [arb(1)]
    for i in range(1, monomials.size):
        values.append(values[monomials.parent[i]] * u[monomials.variable[i]])
    C = chart.coefficients[:, :, 0]
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
    return [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
