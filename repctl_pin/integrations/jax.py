r"""Inverse kinematic function of a cell as pure JAX functions; requires the extra ``jax``."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np

from ..arguments import require_type
from ..errors import InputError
from ..inverse_function import Cell, InverseFunction
from ..inverse_function.cell import TURNED
from ..inverse_function.rotations import skew
from ..proof.chain import chain_of

try:
    import jax
    import jax.numpy as jnp
except ImportError as error:
    raise ImportError("this module requires JAX; run `pip install jax`") from error

Numbers: TypeAlias = Any  # jax.Array, or a tracer of one

_ITERATIONS = 12
_STEP = 0.3
"""Longest Newton step of any joint, rad or m."""

_INSIDE = 1e-9
_ROUNDINGS = 64
"""Accuracy of the configuration, in units of the last place of 1."""


def inverse_function(F: InverseFunction) -> Callable[..., Numbers]:
    r"""Make ``q = F(x; c)`` a pure function of JAX: it is jitted, and can be vmapped and
    differentiated.

    Newton's method finds q. The derivative is the implicit one, not taken through the iterations:

    .. math:: \begin{bmatrix} J \\ n_{ref}^T \end{bmatrix} dq = \begin{bmatrix} dx \\
              dc + d(n_{ref}^T q_{ref}) - (dn_{ref}^T) q \end{bmatrix}

    Parameters
    ----------
    F
        Function of a cell, such as ``found.function``.

    Returns
    -------
    function (x, leaf=None) → q
        x is a homogeneous matrix (4, 4), leaf the level c (r,), by default 0; q (n,) has the
        precision of x. Where F would raise, outside the cell or the limits, q is NaN.

    Raises
    ------
    InputError
        If F is not the function of a cell, or its task is not supported.

    Examples
    --------
    >>> from repctl_pin.integrations import jax as repctl_jax
    >>> f = jax.vmap(repctl_jax.inverse_function(found.function))
    >>> Q = f(X)  # X (K, 4, 4) → (K, n)
    """
    require_type(F, InverseFunction, "F", "a cell's function, such as found.function")
    cell, r = _cell(F), F.task.r
    frame, reference = _kinematics(F), _reference(F)

    def system(x: Numbers, c: Numbers, q: Numbers, u: Numbers) -> tuple[Numbers, Numbers]:
        """Evaluate ``J_V = [J; n_refᵀ]`` and ``g = [x − f(q); c − n_refᵀ (q − q_ref)]``."""
        p, R, J = frame(q)
        q_ref, n_ref = reference(u)
        g = jnp.concatenate([_error(cell, x, p, R), c - n_ref.T @ (q - q_ref)])
        return jnp.concatenate([J, n_ref.T]), g

    @jax.custom_jvp
    def solution(x: Numbers, c: Numbers) -> Numbers:
        u, exact = _coordinates(cell, x), _ROUNDINGS * _eps(x)
        q_ref, n_ref = reference(u)

        def unfinished(state: tuple[Numbers, Numbers, Numbers]) -> Numbers:
            _, size, count = state
            return (size > exact) & (count < _ITERATIONS)

        def newton(state: tuple[Numbers, Numbers, Numbers]) -> tuple[Numbers, Numbers, Numbers]:
            q, _, count = state
            dq = jnp.linalg.solve(*system(x, c, q, u))
            size = jnp.abs(dq).max()
            return q + dq * jnp.minimum(1.0, _STEP / jnp.maximum(size, exact)), size, count + 1

        first = (q_ref + n_ref @ c, jnp.asarray(jnp.inf, x.dtype), 0)
        q, size, _ = jax.lax.while_loop(unfinished, newton, first)
        return jnp.where(size < jnp.sqrt(exact), q, jnp.nan)

    @solution.defjvp
    def tangent(
        at: tuple[Numbers, Numbers], along: tuple[Numbers, Numbers]
    ) -> tuple[Numbers, Numbers]:
        q = solution(*at)  # where ∂g/∂q is −J_V, because g is 0

        def residual(x: Numbers, c: Numbers) -> tuple[Numbers, Numbers]:
            return system(x, c, q, _coordinates(cell, x))[::-1]

        _, dg, J_V = jax.jvp(residual, at, along, has_aux=True)
        return q, jnp.linalg.solve(J_V, dg)

    def function(x: Numbers, leaf: Numbers | None = None) -> Numbers:
        x = _pose(x)
        c = jnp.zeros(r, x.dtype) if leaf is None else jnp.asarray(leaf, x.dtype).reshape(r)
        q = solution(x, c)
        good = _inside(cell, x)
        if F.keep_limits:
            good &= ((q >= F.task.lower) & (q <= F.task.upper)).all()
        return jnp.where(good, q, jnp.nan)

    return jax.jit(function)


def pose_and_leaf(F: InverseFunction) -> Callable[[Numbers], tuple[Numbers, Numbers]]:
    """Make the way back a pure function of JAX: pose and leaf of a configuration.

    ``x = f(q)``, ``c = n_ref(x)ᵀ (q − q_ref(x))``, so that ``F(x; c) = q`` near the function.

    Parameters
    ----------
    F
        Function of a cell, such as ``found.function``.

    Returns
    -------
    function q → (x, c)
        q (n,) → homogeneous matrix (4, 4) and c (r,); c is NaN if the pose lies outside the cell.
    """
    require_type(F, InverseFunction, "F", "a cell's function, such as found.function")
    cell, frame, reference = _cell(F), _kinematics(F), _reference(F)

    def back(q: Numbers) -> tuple[Numbers, Numbers]:
        q = jnp.asarray(q)
        p, R, _ = frame(q)
        top = jnp.concatenate([R, p[:, None]], axis=1)
        x = jnp.concatenate([top, jnp.asarray([[0.0, 0.0, 0.0, 1.0]], top.dtype)])
        q_ref, n_ref = reference(_coordinates(cell, x))
        return x, jnp.where(_inside(cell, x), n_ref.T @ (q - q_ref), jnp.nan)

    return jax.jit(back)


def _cell(F: InverseFunction) -> Cell:
    if type(F.cell) is not Cell:
        raise InputError(
            f"JAX's form takes the function of a Cell, not of a {type(F.cell).__name__}",
            remedy="design one over a Cell",
        )
    return F.cell


def _pose(x: Numbers) -> Numbers:
    x = jnp.asarray(x)
    if x.shape != (4, 4):
        raise InputError(f"a pose is a homogeneous matrix (4, 4); got an array of shape {x.shape}")
    return x if jnp.issubdtype(x.dtype, jnp.floating) else x.astype(float)


def _kinematics(F: InverseFunction) -> Callable[[Numbers], tuple[Numbers, Numbers, Numbers]]:
    """Make the function q → p (3,), R (3, 3), J (m, n)."""
    chain, task = chain_of(F.task), F.task
    S, turns = chain.S[:, : task.n], chain.revolute[:, None]
    links = (chain.R, chain.p, chain.a, skew(chain.a), chain.revolute)

    def frame(q: Numbers) -> tuple[Numbers, Numbers, Numbers]:
        def link(at: tuple[Numbers, Numbers], joint: Any) -> Any:
            (p, R), (theta, R_0, p_0, axis, hat, turning) = at, joint
            p, R = p + R @ p_0, R @ R_0
            z, o = R @ axis, p
            turn = jnp.sin(theta) * hat + (1 - jnp.cos(theta)) * (hat @ hat)
            R = jnp.where(turning, R + R @ turn, R)
            return (jnp.where(turning, p, p + z * theta), R), (z, o)

        theta = S.astype(q.dtype) @ q + chain.o.astype(q.dtype)
        base = (jnp.zeros(3, q.dtype), jnp.eye(3, dtype=q.dtype))
        typed = [a if a.dtype == bool else a.astype(q.dtype) for a in links]
        (p, R), (z, o) = jax.lax.scan(link, base, (theta, *typed))
        v, omega = jnp.where(turns, jnp.cross(z, p - o), z), jnp.where(turns, z, 0)
        if task.kind == "axis":  # ω along the frame's own x and y
            J = jnp.concatenate([v, omega @ R[:, :2]], axis=1)
        else:
            J = jnp.concatenate([v, omega], axis=1)[:, task.rows]
        return p, R, J.T @ S.astype(q.dtype)

    return frame


def _reference(F: InverseFunction) -> Callable[[Numbers], tuple[Numbers, Numbers]]:
    """Make the function u → q_ref (n,), n_ref (n, r)."""
    monomials, C = F.chart.monomials, np.asarray(F.chart.coefficients)
    blocks = [
        slice(*pair) for pair in zip(monomials.starts[1:], monomials.starts[2:], strict=False)
    ]

    def reference(u: Numbers) -> tuple[Numbers, Numbers]:
        T = jnp.ones(1, u.dtype)
        for block in blocks:  # u^α = u^α[parent] · u[variable], degree by degree
            T = jnp.concatenate([T, T[monomials.parent[block]] * u[monomials.variable[block]]])
        both = jnp.tensordot(T, jnp.asarray(C, u.dtype), axes=1)
        return both[:, 0], both[:, 1:]

    return reference


def _coordinates(cell: Cell, x: Numbers) -> Numbers:
    """Convert a pose to the cell's coordinates u (k,)."""
    y, on = _measured(cell, x), np.flatnonzero(cell.widths)
    return y[on] / jnp.asarray(cell.widths[on], x.dtype)


def _inside(cell: Cell, x: Numbers) -> Numbers:
    y, held = _measured(cell, x), np.flatnonzero(cell.widths == 0)
    near = jnp.abs(_coordinates(cell, x)) <= 1 + max(_INSIDE, 8 * _eps(x))
    return near.all() & (jnp.abs(y[held]) <= max(TURNED, 8 * _eps(x))).all()


def _eps(x: Numbers) -> float:
    return float(np.finfo(x.dtype).eps)


def _measured(cell: Cell, x: Numbers) -> Numbers:
    """Measure all m coordinates of a pose, m and rad."""
    placement, kind = cell.placement, cell.task.kind
    rows = np.asarray(cell.task.rows[: len(cell.half_width)])
    away = (x[:3, 3] - jnp.asarray(placement.translation, x.dtype))[rows]
    R_0 = jnp.asarray(placement.rotation, x.dtype)
    if kind == "pose":
        return jnp.concatenate([away, _log3(x[:3, :3] @ R_0.T)])
    if kind == "axis":
        return jnp.concatenate([away, _tilts(R_0, x[:3, :3])])
    return away


def _error(cell: Cell, x: Numbers, p: Numbers, R: Numbers) -> Numbers:
    """Evaluate the task error (m,) from a placement of the frame to a pose."""
    away = x[:3, 3] - p
    if cell.task.kind == "pose":
        return jnp.concatenate([away, _log3(x[:3, :3] @ R.T)])
    if cell.task.kind == "axis":
        return jnp.concatenate([away, _tilts(R, x[:3, :3])])
    return away[np.asarray(cell.task.rows)]


def _log3(R: Numbers) -> Numbers:
    """Evaluate ω with exp(ω̂) = R, for angles below π, also differentiable at 0."""
    w = jnp.stack([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / 2
    return w * _angle_over_sine(w @ w, (jnp.trace(R) - 1) / 2)


def _tilts(R: Numbers, goal: Numbers) -> Numbers:
    """Measure the rotations (2,), rad, about a tool's x and y that align its z with a goal's."""
    aim = R.T @ goal[:, 2]
    turn = jnp.stack([-aim[1], aim[0]])
    return turn * _angle_over_sine(turn @ turn, aim[2])


def _angle_over_sine(square: Numbers, cosine: Numbers) -> Numbers:
    """Evaluate θ / sin θ from sin² θ and cos θ; near θ = 0 by its series, 1 + s²/6 + 3 s⁴/40."""
    small = (square < 1e-6) & (cosine > 0)
    sine = jnp.sqrt(jnp.where(small, 1.0, square))
    series = 1 + square / 6 + 3 * square**2 / 40
    return jnp.where(small, series, jnp.arctan2(sine, cosine) / sine)
