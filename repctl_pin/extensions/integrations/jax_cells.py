r"""Coordinates of cells and sectors as pure JAX functions of a pose, a matrix (4, 4)."""

from __future__ import annotations

from typing import Any, TypeAlias

import jax.numpy as jnp
import numpy as np

from ...model.task import Task
from ..cells.cell import EDGE, TURNED, Cell
from ..cells.sector import Sector
from ..cells.targets import ROTATION

Numbers: TypeAlias = Any  # jax.Array, or a tracer of one


def coordinates(cell: Cell, x: Numbers) -> Numbers:
    """Convert a pose to the cell's scaled coordinates u (k,), in [−1, 1] inside the cell."""
    y = _measured(cell, x) - jnp.asarray(cell._offset, x.dtype)
    return y[cell.moved] / jnp.asarray(cell.widths[cell.moved], x.dtype)


def rigid(task: Task, x: Numbers) -> Numbers:
    """Test whether a matrix (4, 4) is a rigid transform, as :func:`is_rotation` and ``F.batch`` do.

    The rotation is tested only if the task commands one.
    """
    R = x[:3, :3]
    off = [x[3] - jnp.asarray([0.0, 0.0, 0.0, 1.0], x.dtype)]
    if task.kind.turns:
        squares = jnp.stack([R[0] @ R[0] - 1, R[1] @ R[1] - 1, R[0] @ R[1]])
        off += [squares, jnp.cross(R[0], R[1]) - R[2]]
    return (jnp.abs(jnp.concatenate(off)) < max(ROTATION, 8 * eps(x))).all()


def inside(cell: Cell, x: Numbers) -> Numbers:
    """Test whether a pose lies in a cell, which must have all its coordinates (``cell.whole``)."""
    y = _measured(cell, x)
    held = np.flatnonzero(cell.widths == 0)
    most = cell._bounds
    near = jnp.abs(coordinates(cell, x)) <= jnp.asarray(
        most + max(EDGE, 8 * eps(x)), x.dtype
    )
    return near.all() & (jnp.abs(y[held]) <= max(TURNED, 8 * eps(x))).all()


def shift(cell: Cell, x: Numbers) -> Numbers:
    """Evaluate the joint angles (n,) to add to q_ref for the coordinates that u leaves out.

    Along these, by a symmetry of the arm, F changes by these angles only.
    """
    return (
        jnp.asarray(cell.along, x.dtype)
        @ _measured(cell, x)[np.array(cell._removed, int)]
    )


def eps(x: Numbers) -> float:
    """Return the machine epsilon of an array's type."""
    return float(np.finfo(x.dtype).eps)


def _measured(cell: Cell, x: Numbers) -> Numbers:
    """Compute the coordinates (m,) of a pose from the cell's middle, m and rad, not scaled."""
    if isinstance(cell, Sector):
        return _cylindrical(cell, x)
    placement, kind = cell.placement, cell.task.kind
    rows = np.asarray(cell.task.rows[: len(cell.half_width)])
    away = (x[:3, 3] - jnp.asarray(placement.translation, x.dtype))[rows]
    R_0 = jnp.asarray(placement.rotation, x.dtype)
    if not kind.turns:
        return away
    turn = tilts(R_0, x[:3, :3]) if kind.tool_axes else log3(x[:3, :3] @ R_0.T)
    return jnp.concatenate([away, turn])


def _cylindrical(sector: Sector, x: Numbers) -> Numbers:
    """Compute the coordinates (m,) of a pose in a sector, m and rad, not scaled.

    They are radius, angle and height about the sector's axis, from its middle, and the tilts and
    the spin of the tool.
    """
    (rho, z), B = sector.middle, jnp.asarray(sector.directions, x.dtype)
    a, b, height = B @ (x[:3, 3] - jnp.asarray(sector.axis[0], x.dtype))
    angle = jnp.arctan2(b, a)
    y = jnp.stack([jnp.hypot(a, b) - rho, angle, height - z])[: sector.task.m]
    if sector.task.m <= 3:
        return y
    c = jnp.cos(angle)
    s = jnp.sin(angle)
    one = jnp.ones_like(c)
    none = jnp.zeros_like(c)
    back = jnp.stack([c, s, none, -s, c, none, none, none, one]).reshape(
        3, 3
    )  # R_a(-φ)
    R_0 = jnp.asarray(sector.placement.rotation, x.dtype)
    turned = R_0.T @ B.T @ back @ B @ x[:3, :3]
    t = tilts(jnp.eye(3, dtype=x.dtype), turned)
    if sector.task.m < 6:
        return jnp.concatenate([y, t])
    first = _tilted_back(t, turned[:, 0])
    spin = jnp.arctan2(first[1], first[0])
    spin -= 2 * jnp.pi * jnp.rint((spin - sector.spin_middle) / (2 * jnp.pi))
    return jnp.concatenate([y, t, spin[None]])


def _tilted_back(t: Numbers, v: Numbers) -> Numbers:
    """Rotate a vector v (3,) by ``exp(-t)``, where t (2,) is a rotation vector in the x-y plane.

    It is differentiable at t = 0, too.
    """
    square = t @ t
    small = square < 1e-6
    theta = jnp.sqrt(jnp.where(small, 1.0, square))
    sine = jnp.where(small, 1 - square / 6, jnp.sin(theta) / theta)
    versine = jnp.where(small, 0.5 - square / 24, (1 - jnp.cos(theta)) / theta**2)
    w = -jnp.stack([t[0], t[1], jnp.zeros_like(t[0])])
    once = jnp.cross(w, v)
    return v + sine * once + versine * jnp.cross(w, once)


def log3(R: Numbers) -> Numbers:
    """Evaluate the rotation vector ω (3,), exp(ω̂) = R, for angles below π; differentiable at 0."""
    w = jnp.stack([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / 2
    return w * _angle_over_sine(w @ w, (jnp.trace(R) - 1) / 2)


def tilts(R: Numbers, goal: Numbers) -> Numbers:
    """Compute the rotation (2,), rad, about a tool's x and y that aligns its z with a goal's z."""
    aim = R.T @ goal[:, 2]
    turn = jnp.stack([-aim[1], aim[0]])
    return turn * _angle_over_sine(turn @ turn, aim[2])


def _angle_over_sine(square: Numbers, cosine: Numbers) -> Numbers:
    """Evaluate θ / sin θ from s² = sin² θ and cos θ; by its series, 1 + s²/6 + 3 s⁴/40, near 0."""
    small = (square < 1e-6) & (cosine > 0)
    sine = jnp.sqrt(jnp.where(small, 1.0, square))
    series = 1 + square / 6 + 3 * square**2 / 40
    return jnp.where(small, series, jnp.arctan2(sine, cosine) / sine)
