"""Taylor models of a chain's screws, and of its displacement to a pose.

The joint positions are Taylor models; the screws are in the middle link's frame.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...arguments import Array, read_only
from .chain import FREE, Chain
from .taylor import TaylorModel, cross, dot

TURNED = {"pose": 0, "axis": 2}
"""First of the frame's axes whose direction a kind of task controls; the others control none."""


@dataclass(frozen=True, eq=False)
@read_only
class Closure:
    """Taylor models on K boxes of a chain's screws, and of the displacement of its frame to a pose.

    Attributes
    ----------
    J : TaylorModel
        The screws (K, 6, N), in the middle link's frame.
    xi : TaylorModel
        The displacement ``(e + p × s, s)`` (K, 6). p is the position of the frame, e the vector
        from there to the position of the pose, and s the axis of the rotation to the pose times the
        sine of its angle: for an axis task, of the shortest rotation of the tool's z axis. Only
        the coordinates that the task controls are displaced.
    sizes : (3, K) array
        Bounds of |p|, |e| and |s|.
    near : (K,) array of bool
        True if the rotation is by less than a quarter turn at the centre, and its trace is
        above 1.
    """

    J: TaylorModel
    xi: TaylorModel
    sizes: Array
    near: NDArray[np.bool_]


def closure_of(
    chain: Chain,
    kind: str,
    pose: tuple[TaylorModel, TaylorModel],
    Q: TaylorModel,
    eps: float,
) -> Closure:
    """Compute models of a chain's screws at Q (K, n), and of the displacement to a pose.

    The pose is p (K, 3), and R (K, 3, 3) by columns; ``kind`` is that of the task, and ``eps`` the
    relative rounding error.
    """
    theta = Q.combined(chain.S[:, : chain.n])
    theta = theta + fixed(theta, chain.o)
    screws: list[TaylorModel] = [theta] * len(chain.p)
    R2, p2 = _outward(chain, theta, screws)
    R_b, o_b = _inward(chain, theta, screws)
    J = TaylorModel.constant(Q.k, np.zeros((len(Q.r), 6, chain.N)))
    P, r = J.P.copy(), J.r.copy()
    for joint, column in zip(*np.nonzero(chain.S), strict=True):
        part = screws[joint].scaled(chain.S[joint, column])
        P[:, :, column] += part.P
        r[:, :, column] += part.r
    e = o_b + _applied(R_b, pose[0]) - p2
    for axis in FREE[kind][0]:  # of the base: not controlled
        z = R_b["xyz".index(axis)]
        e = e - z * dot(z, e)
    first = TURNED.get(kind, 3)
    s, trace = _rotation(
        R2[first:], [_applied(R_b, pose[1][:, i]) for i in range(first, 3)], p2
    )
    moment = e + cross(p2, s)
    xi = TaylorModel(
        Q.k,
        np.concatenate([moment.P, s.P], axis=1),
        np.concatenate([moment.r, s.r], axis=1) + eps * (1 + _length(p2))[:, None],
    )
    sizes = np.stack([_length(x) for x in (p2, e, s)]) + eps
    return Closure(TaylorModel(Q.k, P, r), xi, sizes, trace > 1)


Columns = list[TaylorModel]


def _outward(
    chain: Chain, theta: TaylorModel, screws: list[TaylorModel]
) -> tuple[Columns, TaylorModel]:
    """Compute the frame's rotation (three columns) and position, relative to the middle link.

    The screws of the joints between the two are written into ``screws``.
    """
    R, o = identity(theta), fixed(theta, -chain.shift)
    for joint in range(chain.middle, len(chain.p)):
        o = o + combined(R, chain.p[joint])
        R = [combined(R, column) for column in chain.R[joint].T]
        screws[joint] = _screw(chain, joint, R, o)
        position = theta[:, joint : joint + 1]
        R, o = moved(chain.a[joint], chain.revolute[joint], R, o, position)
    return R, o


def _inward(
    chain: Chain, theta: TaylorModel, screws: list[TaylorModel]
) -> tuple[Columns, TaylorModel]:
    """Compute the base's rotation (three columns) and position, relative to the middle link.

    The screws of the joints between the two are written into ``screws``.
    """
    R, o = identity(theta), fixed(theta, -chain.shift)
    for joint in range(chain.middle - 1, -1, -1):
        screws[joint] = _screw(chain, joint, R, o)
        position = -theta[:, joint : joint + 1]
        R, o = moved(chain.a[joint], chain.revolute[joint], R, o, position)
        R = [combined(R, column) for column in chain.R[joint]]
        o = o - combined(R, chain.p[joint])
    return R, o


def _screw(chain: Chain, joint: int, R: Columns, o: TaylorModel) -> TaylorModel:
    axis = (
        fixed(o, chain.a[joint]) if chain.level[joint] else combined(R, chain.a[joint])
    )
    zero = axis.scaled(0.0)
    v, w = (cross(o, axis), axis) if chain.revolute[joint] else (axis, zero)
    return TaylorModel(
        o.k, np.concatenate([v.P, w.P], axis=1), np.concatenate([v.r, w.r], axis=1)
    )


def moved(
    axis: Array, revolute: bool, R: Columns, o: TaylorModel, theta: TaylorModel
) -> tuple[Columns, TaylorModel]:
    """Move a frame, columns R and position o, by the position theta (K, 1) of a joint."""
    if not revolute:
        return R, o + theta * combined(R, axis)
    s, c = theta.sine_cosine()
    B = basis(axis)
    x, y, z = (combined(R, column) for column in B.T)
    turned = [c * x + s * y, c * y - s * x, z]
    return [combined(turned, row) for row in B], o


def basis(axis: Array) -> Array:
    """Create a rotation matrix (3, 3) whose third column is the unit vector ``axis``."""
    if axis[2] ** 2 > 1 - 1e-30:
        return np.diag([1.0, np.sign(axis[2]), np.sign(axis[2])])
    other = np.eye(3)[np.argmin(np.abs(axis))]
    x = np.cross(other, axis)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(axis, x), axis], axis=1)


def _rotation(
    R: Columns, goal: Columns, like: TaylorModel
) -> tuple[TaylorModel, Array]:
    """Compute the axis of the rotation from R to the goal times the sine of its angle, as a model.

    It is ``½ Σ R_i × goal_i`` over three columns, the product of one column with its goal for the
    shortest rotation of an axis, and 0 for none. The second result (K,) is the trace of the
    rotation at the centre.
    """
    zero = like.scaled(0.0)
    if not R:
        return zero, np.full(len(like.r), 3.0)
    s, trace = zero, 0.0
    for a, b in zip(R, goal, strict=True):
        s = s + cross(a, b)
        trace = trace + (a.P[..., 0] * b.P[..., 0]).sum(axis=1)
    if len(R) == 1:
        return s, 1 + 2 * np.asarray(trace)  # of a turn by the angle between the two
    return s.scaled(0.5), np.asarray(trace)


def combined(R: Columns, x: Array) -> TaylorModel:
    """Compute the model of R x for a constant vector x (3,)."""
    return R[0].scaled(x[0]) + R[1].scaled(x[1]) + R[2].scaled(x[2])


def _applied(R: Columns, x: TaylorModel) -> TaylorModel:
    """Compute the model of R x for a model x (K, 3)."""
    return R[0] * x[:, 0:1] + R[1] * x[:, 1:2] + R[2] * x[:, 2:3]


def fixed(like: TaylorModel, x: Array) -> TaylorModel:
    """Create the model of a constant vector on the boxes of another model."""
    return TaylorModel.constant(like.k, np.tile(x, (len(like.r), 1)))


def identity(like: TaylorModel) -> Columns:
    """Create the columns of the identity on the boxes of a model."""
    return [fixed(like, e) for e in np.eye(3)]


def _length(x: TaylorModel) -> Array:
    return np.asarray(np.linalg.norm(x.most, axis=1) * (1 + 1e-12))
