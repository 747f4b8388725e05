"""The rates of G_r in Arb's ball arithmetic: every digit is certain."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from arb_closure import Matrix, Vector, _add, _apply, _balls, _cross, _minus
from arb_margin import _eye, _product, _turn
from flint import arb, arb_mat

import repctl_pin as rp


def rates_in_balls(design: rp.Design, q: np.ndarray, ratio: float) -> Vector:
    """Evaluate ``‖g_v‖ + ratio ‖g_ω‖`` of the rows g of G_r at q (n,), of polynomials: from the
    base outward."""
    task = design.task
    J, m = _jacobian(task, q), task.m
    inverse = arb_mat([*J, *_gradients(design.inverse.potentials, q)]).inv()
    k = 3 if task.kind in ("pose", "axis", "position") else 2
    G = [[inverse[i, a] for a in range(m)] for i in range(task.n)]
    return [_norm(g[:k]) + arb(ratio) * _norm(g[k:]) for g in G]


def _norm(x: Vector) -> arb:
    return sum((v * v for v in x), arb(0)).sqrt()


def _jacobian(task: rp.Task, q: np.ndarray) -> Matrix:
    """J at the frame, in base axes; the rotation of an axis task in the tool's."""
    model = task.model
    data, zero = model.createData(), pin.neutral(model)
    R, o, joints = _eye(), [arb(0)] * 3, []
    for j in range(1, model.njoints):
        placement = model.jointPlacements[j]
        o = _add(o, _apply(R, _balls(placement.translation)))
        R = _product(R, [_balls(row) for row in placement.rotation])
        axis = pin.computeJointJacobian(model, data, zero, j)[:, j - 1]
        slides, theta = bool(axis[:3].any()), arb(float(q[j - 1]))
        joints.append((slides, _apply(R, _balls(axis[:3] if slides else axis[3:])), o))
        if slides:
            o = _add(o, [theta * x for x in joints[-1][1]])
        else:
            R = _product(R, _turn(axis[3:], theta))
    frame = model.frames[model.getFrameId(task.frame)].placement
    tip = _add(o, _apply(R, _balls(frame.translation)))
    R = _product(R, [_balls(row) for row in frame.rotation])
    columns = []
    for slides, a, o in joints:
        v = a if slides else _cross(a, _minus(tip, o))
        w = [arb(0)] * 3 if slides else a
        if task.kind == "axis":
            w = _apply([list(row) for row in zip(*R, strict=True)], w)[:2]
        rows = [v["xyz".index(c)] for c in task.kind] if len(task.kind) == 2 else v
        columns.append([*rows, *w] if task.kind in ("pose", "axis") else rows)
    return [list(row) for row in zip(*columns, strict=True)]


def _gradients(potentials: object, q: np.ndarray) -> Matrix:
    """∂h/∂q, (r, n), of polynomials from their coefficients."""
    u = [
        (arb(float(x)) - arb(float(c))) / arb(float(s))
        for x, c, s in zip(q, potentials.center, potentials.scale, strict=True)
    ]
    V = [[arb(0)] * len(q) for _ in next(iter(potentials.terms.values()))]
    for beta, c in potentials.terms.items():
        for i, power in enumerate(beta):
            if not power:
                continue
            term = arb(power) / arb(float(potentials.scale[i]))
            for k, e in enumerate(beta):
                term *= u[k] ** (e - (k == i))
            for a, row in enumerate(V):
                row[i] += arb(float(c[a])) * term
    return V
