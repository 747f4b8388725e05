"""The gradient of an arm angle in Arb's ball arithmetic, from the derivative of its arctangent."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from arb_closure import _add, _apply, _balls, _cross, _minus
from arb_margin import _eye, _product, _turn
from flint import arb, ctx

import repctl_pin as rp

ctx.prec = 160

Vector = list[arb]


def gradient_in_balls(angle: rp.ArmAngle, q: Vector) -> Vector:
    """Evaluate ∂ψ/∂q at balls q (n,): revolute joints, none of which mimics another."""
    model = angle.task.model
    data, neutral = model.createData(), pin.neutral(model)
    R, o, joints, points = _eye(), [arb(0)] * 3, [], {}
    for j in range(1, model.njoints):
        placement = model.jointPlacements[j]
        axis = pin.computeJointJacobian(model, data, neutral, j)[3:, j - 1]
        o = _add(o, _apply(R, _balls(placement.translation)))
        R = _product(R, [_balls(row) for row in placement.rotation])
        joints.append((_apply(R, _balls(axis)), o))
        R = _product(R, _turn(axis, q[j - 1]))
        for i in angle._ids:
            frame = model.frames[i]
            if frame.parentJoint == j:
                place = _add(o, _apply(R, _balls(frame.placement.translation)))
                points[i] = place, j
    shoulder, elbow, wrist = (points[i] for i in angle._ids)
    e, w = (_minus(x[0], shoulder[0]) for x in (elbow, wrist))
    found = []
    for j, (axis, place) in enumerate(joints, 1):
        still, de, dw = (
            _cross(axis, _minus(x, place)) if j <= by else [arb(0)] * 3
            for x, by in (shoulder, elbow, wrist)
        )
        found.append(_slope(angle, e, w, _minus(de, still), _minus(dw, still)))
    return found


def _slope(angle: rp.ArmAngle, e: Vector, w: Vector, de: Vector, dw: Vector) -> arb:
    """The derivative of ``atan2(ŵ · (y × e), y · e)`` where e and w change by de and dw."""
    length = _dot(w, w).sqrt()
    n = [x / length for x in w]
    rate = _dot(n, dw)
    dn = [(x - y * rate) / length for x, y in zip(dw, n, strict=True)]
    r = _balls(angle.reference)
    if angle.singular is None:
        y = _minus(r, _scaled(_dot(n, r), n))
        dy = [-v for v in _add(_scaled(_dot(dn, r), n), _scaled(_dot(n, r), dn))]
    else:
        k, dk = _cross(_minus(n, _balls(angle.singular)), r), _cross(dn, r)
        y, dy = _cross(k, n), _add(_cross(dk, n), _cross(k, dn))
    s, c = _dot(n, _cross(y, e)), _dot(y, e)
    ds = _dot(dn, _cross(y, e)) + _dot(n, _add(_cross(dy, e), _cross(y, de)))
    dc = _dot(dy, e) + _dot(y, de)
    return (c * ds - s * dc) / (s * s + c * c)


def _dot(a: Vector, b: Vector) -> arb:
    return sum((x * y for x, y in zip(a, b, strict=True)), arb(0))


def _scaled(s: arb, x: Vector) -> Vector:
    return [s * v for v in x]


def at(Q: np.ndarray, half: np.ndarray, t: np.ndarray) -> Vector:
    """The balls of ``Q + half t``."""
    return [
        arb(float(q)) + arb(float(h)) * arb(float(v)) for q, h, v in zip(Q, half, t, strict=True)
    ]
