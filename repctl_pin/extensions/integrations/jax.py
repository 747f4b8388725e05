r"""Inverse kinematic function of a cell as pure JAX functions; requires the extra ``jax``."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np

from ...arguments import require_type
from ...errors import InputError
from ...model.chain_formulas import skew
from ..cells.cell import Cell
from ..cells.function import InverseFunction
from ..cells.sector import Sector
from ..proof.chain import chain_of

try:
    import jax
    import jax.numpy as jnp
except ImportError as error:
    raise ImportError("this module requires JAX; run `pip install jax`") from error

from .jax_cells import coordinates, eps, inside, log3, rigid, shift, tilts

Numbers: TypeAlias = Any  # jax.Array, or a tracer of one

_ITERATIONS = 12
_STEP = 0.3
"""Longest Newton step of any joint, rad or m."""

_CONVERGED = 1e-6
"""Length of the last Newton step, rad or m, below which q is a solution, as for F in Python; its
error is of the order of its square."""

_ROUNDINGS = 64
"""Tolerance of Newton's method, rad or m, as a multiple of the machine epsilon."""


def inverse_function(F: InverseFunction) -> Callable[..., Numbers]:
    r"""Convert ``q = F(x; c)`` to a pure, jitted JAX function.

    It can be vmapped and differentiated. Newton's method finds q. The derivative is that of the
    implicit function theorem, not taken through the iterations:

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
        precision of x. Where F would raise, q is NaN: outside the cell or the limits, and where x
        is no rigid transform to 1e-6.

    Raises
    ------
    InputError
        If F is not the function of a cell or sector, or its task is not supported.

    Examples
    --------
    >>> from repctl_pin.extensions.integrations import jax as repctl_jax
    >>> f = jax.vmap(repctl_jax.inverse_function(found.function))
    >>> Q = f(X)  # X (K, 4, 4) → (K, n)
    """
    require_type(F, InverseFunction, "F", "a cell's function, such as found.function")
    r, frame, reference = F.task.r, _kinematics(F), _reference(F)

    def system(
        x: Numbers, c: Numbers, q: Numbers, chart: tuple[Numbers, Numbers]
    ) -> tuple[Numbers, Numbers]:
        """Evaluate ``J_V = [J; n_refᵀ]`` and ``g = [x − f(q); c − n_refᵀ (q − q_ref)]``."""
        p, R, J = frame(q)
        q_ref, n_ref = chart
        g = jnp.concatenate([_error(F.cell, x, p, R), c - n_ref.T @ (q - q_ref)])
        return jnp.concatenate([J, n_ref.T]), g

    @jax.custom_jvp
    def solution(x: Numbers, c: Numbers) -> Numbers:
        (q_ref, n_ref), exact = reference(x), _ROUNDINGS * eps(x)

        def unfinished(state: tuple[Numbers, Numbers, Numbers]) -> Numbers:
            _, size, count = state
            return (size > exact) & (count < _ITERATIONS)

        def newton(
            state: tuple[Numbers, Numbers, Numbers],
        ) -> tuple[Numbers, Numbers, Numbers]:
            q, _, count = state
            dq = jnp.linalg.solve(*system(x, c, q, (q_ref, n_ref)))
            size = jnp.abs(dq).max()
            return (
                q + dq * jnp.minimum(1.0, _STEP / jnp.maximum(size, exact)),
                size,
                count + 1,
            )

        first = (q_ref + n_ref @ c, jnp.asarray(jnp.inf, x.dtype), 0)
        q, size, _ = jax.lax.while_loop(unfinished, newton, first)
        last = jnp.maximum(jnp.sqrt(exact), _CONVERGED)
        return jnp.where(size < last, q, jnp.nan)

    @solution.defjvp
    def tangent(
        at: tuple[Numbers, Numbers], along: tuple[Numbers, Numbers]
    ) -> tuple[Numbers, Numbers]:
        q = solution(*at)  # where ∂g/∂q is −J_V, because g is 0

        def residual(x: Numbers, c: Numbers) -> tuple[Numbers, Numbers]:
            return system(x, c, q, reference(x))[::-1]

        _, dg, J_V = jax.jvp(residual, at, along, has_aux=True)
        return q, jnp.linalg.solve(J_V, dg)

    def function(x: Numbers, leaf: Numbers | None = None) -> Numbers:
        x = _pose(x)
        c = (
            jnp.zeros(r, x.dtype)
            if leaf is None
            else jnp.asarray(leaf, x.dtype).reshape(r)
        )
        q = solution(x, c)
        within = ((q >= F.task.lower) & (q <= F.task.upper)).all()
        if not F.keep_limits:
            within |= (c == 0).all()
        good = rigid(F.task, x) & inside(F.cell, x) & within
        return jnp.where(good, q, jnp.nan)

    return jax.jit(function)


def pose_and_leaf(F: InverseFunction) -> Callable[[Numbers], tuple[Numbers, Numbers]]:
    """Convert the inverse of F, from a configuration to its pose and level, to a pure JAX function.

    ``x = f(q)`` and ``c = n_ref(x)ᵀ (q − q_ref(x))``, so that ``F(x; c) = q`` if q is near F(x; 0).

    Parameters
    ----------
    F
        Function of a cell, such as ``found.function``.

    Returns
    -------
    function q → (x, c)
        From q (n,) to the pose, a homogeneous matrix (4, 4), and the level c (r,); c is NaN if the
        pose lies outside the cell.
    """
    require_type(F, InverseFunction, "F", "a cell's function, such as found.function")
    frame, reference = _kinematics(F), _reference(F)
    cell = F.chart.cell
    turning = [one.joint for one in cell.removed] if isinstance(cell, Sector) else []

    def back(q: Numbers) -> tuple[Numbers, Numbers]:
        q = jnp.asarray(q)
        p, R, _ = frame(q)
        top = jnp.concatenate([R, p[:, None]], axis=1)
        x = jnp.concatenate([top, jnp.asarray([[0.0, 0.0, 0.0, 1.0]], top.dtype)])
        q_ref, n_ref = reference(x)
        away = q - q_ref
        for joint in turning:  # whole turns do not count
            away = away.at[joint].add(
                -2 * jnp.pi * jnp.rint(away[joint] / (2 * jnp.pi))
            )
        return x, jnp.where(inside(F.cell, x), n_ref.T @ away, jnp.nan)

    return jax.jit(back)


def _pose(x: Numbers) -> Numbers:
    x = jnp.asarray(x)
    if x.shape != (4, 4):
        raise InputError(
            f"a pose is a homogeneous matrix (4, 4); got an array of shape {x.shape}"
        )
    return x if jnp.issubdtype(x.dtype, jnp.floating) else x.astype(float)


def _kinematics(
    F: InverseFunction,
) -> Callable[[Numbers], tuple[Numbers, Numbers, Numbers]]:
    """Create the function from q (n,) to p (3,) and R (3, 3) of the frame, and J (m, n)."""
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
        if task.kind.tool_axes:  # ω along the frame's own x and y
            J = jnp.concatenate([v, omega @ R[:, :2]], axis=1)
        else:
            J = jnp.concatenate([v, omega], axis=1)[:, task.rows]
        return p, R, J.T @ S.astype(q.dtype)

    return frame


def _reference(F: InverseFunction) -> Callable[[Numbers], tuple[Numbers, Numbers]]:
    """Create the function from a pose x (4, 4) to q_ref (n,) and n_ref (n, r).

    q_ref includes the joint angles that symmetries of the arm add to the polynomials.
    """
    monomials, C = F.chart.monomials, np.asarray(F.chart.coefficients)
    blocks = [
        slice(*pair)
        for pair in zip(monomials.starts[1:], monomials.starts[2:], strict=False)
    ]

    def reference(x: Numbers) -> tuple[Numbers, Numbers]:
        u = coordinates(F.chart.cell, x)
        T = jnp.ones(1, u.dtype)
        for block in blocks:  # u^α = u^α[parent] · u[variable], degree by degree
            T = jnp.concatenate(
                [T, T[monomials.parent[block]] * u[monomials.variable[block]]]
            )
        both = jnp.tensordot(T, jnp.asarray(C, u.dtype), axes=1)
        return both[:, 0] + shift(F.chart.cell, x), both[:, 1:]

    return reference


def _error(cell: Cell, x: Numbers, p: Numbers, R: Numbers) -> Numbers:
    """Evaluate the task error (m,) from the frame's placement (p, R) to a pose x (4, 4)."""
    away = x[:3, 3] - p
    kind = cell.task.kind
    if not kind.turns:
        return away[np.asarray(kind.rows)]
    turn = tilts(R, x[:3, :3]) if kind.tool_axes else log3(x[:3, :3] @ R.T)
    return jnp.concatenate([away, turn])
