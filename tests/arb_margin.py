"""The leaf margin of an arm with one degree of redundancy in Arb's ball arithmetic: every digit is
certain."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from flint import arb, arb_mat, ctx

import repctl_pin as rp

ctx.prec = 160


def leaf_margin_in_balls(design: rp.Design, q: np.ndarray) -> arb:
    """Evaluate the leaf margin at q (n,), r = 1, pose task, revolute joints, polynomials: from the
    base outward."""
    task = design.task
    J = _jacobian(task, q)
    v = _gradient(design.inverse.potentials, q)
    J_V = arb_mat([[J[i][j] for j in range(task.n)] for i in range(6)] + [v])
    unit = arb_mat([[arb(0)]] * 6 + [[arb(1)]])
    x = J_V.solve(unit)
    size = sum((x[i, 0] * x[i, 0] for i in range(task.n)), arb(0)) * sum((c * c for c in v), arb(0))
    return arb(1) / size.sqrt()


def _jacobian(task: rp.Task, q: np.ndarray) -> list[list[arb]]:
    """The geometric Jacobian at the base's origin, whose null space is that of any other point."""
    model = task.model
    R, p = _eye(), [arb(0)] * 3
    columns = []
    for j in range(1, model.njoints):
        placement, axis = model.jointPlacements[j], _axis(model, j)
        p = [
            p[i] + sum((R[i][k] * arb(float(placement.translation[k])) for k in range(3)), arb(0))
            for i in range(3)
        ]
        R = _product(R, [[arb(float(x)) for x in row] for row in placement.rotation])
        w = [sum((R[i][k] * arb(float(axis[k])) for k in range(3)), arb(0)) for i in range(3)]
        v = [p[1] * w[2] - p[2] * w[1], p[2] * w[0] - p[0] * w[2], p[0] * w[1] - p[1] * w[0]]
        columns.append([*v, *w])
        R = _product(R, _turn(axis, arb(float(q[j - 1]))))
    return [[column[i] for column in columns] for i in range(6)]


def _axis(model: pin.Model, joint: int) -> np.ndarray:
    data = model.createData()
    return pin.computeJointJacobian(model, data, pin.neutral(model), joint)[3:, joint - 1]


def _turn(axis: np.ndarray, angle: arb) -> list[list[arb]]:
    c, s = angle.cos(), angle.sin()
    x, y, z = (arb(float(v)) for v in axis)
    a, hat = (x, y, z), [[arb(0), -z, y], [z, arb(0), -x], [-y, x, arb(0)]]
    return [
        [(c if i == j else arb(0)) + s * hat[i][j] + (1 - c) * a[i] * a[j] for j in range(3)]
        for i in range(3)
    ]


def _gradient(potentials: object, q: np.ndarray) -> list[arb]:
    """∂h/∂q of a polynomial from its coefficients."""
    u = [
        (arb(float(x)) - arb(float(c))) / arb(float(s))
        for x, c, s in zip(q, potentials.center, potentials.scale, strict=True)
    ]
    v = [arb(0)] * len(q)
    for beta, (c,) in potentials.terms.items():
        for i, power in enumerate(beta):
            if not power:
                continue
            term = arb(float(c)) * power / arb(float(potentials.scale[i]))
            for k, e in enumerate(beta):
                term *= u[k] ** (e - (k == i))
            v[i] += term
    return v


def _eye() -> list[list[arb]]:
    return [[arb(int(i == j)) for j in range(3)] for i in range(3)]


def _product(A: list[list[arb]], B: list[list[arb]]) -> list[list[arb]]:
    return [
        [sum((A[i][k] * B[k][j] for k in range(3)), arb(0)) for j in range(3)] for i in range(3)
    ]
