r"""Inverse kinematic function of a cell as pure JAX functions; requires the extra ``jax``.

A cell is a box of poses over which a function F gives one configuration per pose. The chart of F
consists of two polynomials of the cell's coordinates u. q_ref is a configuration near the solution;
n_ref are the directions along the self-motion, in which the level c is measured. For learning, JAX
compiles these functions, maps them over many poses, and differentiates them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np

from ...base.arguments import require_type
from ...base.errors import InputError
from ...model.chain_formulas import skew
from ...model.task import Task
from ..cells.function import InverseFunction
from ..cells.geometry.cell import EDGE, TURNED, Cell
from ..cells.geometry.sector import Sector
from ..cells.targets import ROTATION
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

_CONVERGED = 1e-6
"""Length of the last Newton step, rad or m, below which q is a solution, as for F in Python; its
error is of the order of its square."""

_ROUNDINGS = 64
"""Tolerance of Newton's method, rad or m, as a multiple of the machine epsilon."""


def inverse_function(F: InverseFunction) -> Callable[..., Numbers]:
    r"""Convert ``q = F(x; c)`` to a pure, jitted JAX function.

    The function can be vmapped and differentiated. Newton's method starts from q_ref, a polynomial
    of F. n_ref (n, r) are the directions in which the level c, the position along the self-motion,
    is measured. The derivative comes from the implicit function theorem, not from the iterations:

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
        floating-point type of x. Where F would raise an error, q is NaN: outside the cell or the
        limits, or if x is not a rigid transform to within 1e-6.

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
    r, solution = F.task.r, _solution(F)

    def function(x: Numbers, leaf: Numbers | None = None) -> Numbers:
        x = _pose(x)
        c = jnp.zeros(r, x.dtype) if leaf is None else jnp.asarray(leaf, x.dtype).reshape(r)
        q = solution(x, c)
        within = ((q >= F.task.lower) & (q <= F.task.upper)).all()
        if not F.keep_limits:
            within |= (c == 0).all()
        good = _rigid(F.task, x) & _inside(F.cell, x) & within
        return jnp.where(good, q, jnp.nan)

    return jax.jit(function)


def _system(F: InverseFunction) -> Callable[..., tuple[Numbers, Numbers]]:
    """Create the linear system of Newton's method: ``J_V = [J; n_refᵀ]`` (n, n) and g (n,).

    ``g = [x − f(q); c − n_refᵀ (q − q_ref)]`` is the error of q from the pose x and the level c.
    The last argument of the created function, ``chart``, is the pair q_ref (n,) and n_ref (n, r),
    the polynomials of F at x.
    """
    frame = _kinematics(F)

    def system(
        x: Numbers, c: Numbers, q: Numbers, chart: tuple[Numbers, Numbers]
    ) -> tuple[Numbers, Numbers]:
        p, R, J = frame(q)
        q_ref, n_ref = chart
        g = jnp.concatenate([_error(F.cell, x, p, R), c - n_ref.T @ (q - q_ref)])
        return jnp.concatenate([J, n_ref.T]), g

    return system


def _solution(F: InverseFunction) -> Callable[[Numbers, Numbers], Numbers]:
    """Create the function from a pose x and a level c to q, by Newton's method.

    q is NaN where the iterations do not converge. The derivative comes from the implicit function
    theorem.
    """
    system, reference = _system(F), _reference(F)

    @jax.custom_jvp
    def solution(x: Numbers, c: Numbers) -> Numbers:
        (q_ref, n_ref), exact = reference(x), _ROUNDINGS * _eps(x)

        def unfinished(state: tuple[Numbers, Numbers, Numbers]) -> Numbers:
            _, size, count = state
            return (size > exact) & (count < _ITERATIONS)

        def newton(state: tuple[Numbers, Numbers, Numbers]) -> tuple[Numbers, Numbers, Numbers]:
            q, _, count = state
            dq = jnp.linalg.solve(*system(x, c, q, (q_ref, n_ref)))
            size = jnp.abs(dq).max()
            return (q + dq * jnp.minimum(1.0, _STEP / jnp.maximum(size, exact)), size, count + 1)

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

    return solution


def pose_and_leaf(F: InverseFunction) -> Callable[[Numbers], tuple[Numbers, Numbers]]:
    """Make a pure JAX function that inverts F: from a configuration to its pose and level.

    The level c is the position of the configuration along the self-motion. ``x = f(q)`` and
    ``c = n_ref(x)ᵀ (q − q_ref(x))``, with q_ref and n_ref the polynomials of F. So ``F(x; c) = q``
    if q is near F(x; 0).

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
            away = away.at[joint].add(-2 * jnp.pi * jnp.rint(away[joint] / (2 * jnp.pi)))
        return x, jnp.where(_inside(F.cell, x), n_ref.T @ away, jnp.nan)

    return jax.jit(back)


def _pose(x: Numbers) -> Numbers:
    """Check that a pose is a matrix (4, 4), and convert integers to floating-point numbers."""
    x = jnp.asarray(x)
    if x.shape != (4, 4):
        raise InputError(f"a pose is a homogeneous matrix (4, 4); got an array of shape {x.shape}")
    return x if jnp.issubdtype(x.dtype, jnp.floating) else x.astype(float)


def _link(at: tuple[Numbers, Numbers], joint: Any) -> Any:
    """Go from one joint's frame (p, R) past the next joint, whose axis z passes through o."""
    (p, R), (theta, R_0, p_0, axis, hat, turning) = at, joint
    p, R = p + R @ p_0, R @ R_0
    z, o = R @ axis, p
    turn = jnp.sin(theta) * hat + (1 - jnp.cos(theta)) * (hat @ hat)
    R = jnp.where(turning, R + R @ turn, R)
    return (jnp.where(turning, p, p + z * theta), R), (z, o)


def _kinematics(F: InverseFunction) -> Callable[[Numbers], tuple[Numbers, Numbers, Numbers]]:
    """Create the function from q (n,) to p (3,), m, and R (3, 3) of the frame, and J (m, n).

    This is forward kinematics along the chain of joints, in JAX.
    """
    chain, task = chain_of(F.task), F.task
    S, turns = chain.S[:, : task.n], chain.revolute[:, None]
    links = (chain.R, chain.p, chain.a, skew(chain.a), chain.revolute)

    def frame(q: Numbers) -> tuple[Numbers, Numbers, Numbers]:
        theta = S.astype(q.dtype) @ q + chain.o.astype(q.dtype)
        base = (jnp.zeros(3, q.dtype), jnp.eye(3, dtype=q.dtype))
        typed = [a if a.dtype == bool else a.astype(q.dtype) for a in links]
        (p, R), (z, o) = jax.lax.scan(_link, base, (theta, *typed))
        v, omega = jnp.where(turns, jnp.cross(z, p - o), z), jnp.where(turns, z, 0)
        if task.kind.tool_axes:  # ω along the frame's own x and y
            J = jnp.concatenate([v, omega @ R[:, :2]], axis=1)
        else:
            J = jnp.concatenate([v, omega], axis=1)[:, task.rows]
        return p, R, J.T @ S.astype(q.dtype)

    return frame


def _reference(F: InverseFunction) -> Callable[[Numbers], tuple[Numbers, Numbers]]:
    """Create the function from a pose x (4, 4) to q_ref (n,) and n_ref (n, r), polynomials of F.

    Newton's method starts from q_ref, a configuration near F(x); the level c is measured along
    n_ref. q_ref includes the joint angles that symmetries of the arm, such as a turn about its
    base, add to the polynomials.
    """
    monomials, C = F.chart.monomials, np.asarray(F.chart.coefficients)
    blocks = [
        slice(*pair) for pair in zip(monomials.starts[1:], monomials.starts[2:], strict=False)
    ]

    def reference(x: Numbers) -> tuple[Numbers, Numbers]:
        u = _coordinates(F.chart.cell, x)
        T = jnp.ones(1, u.dtype)
        for block in blocks:  # u^α = u^α[parent] · u[variable], degree by degree
            T = jnp.concatenate([T, T[monomials.parent[block]] * u[monomials.variable[block]]])
        both = jnp.tensordot(T, jnp.asarray(C, u.dtype), axes=1)
        return both[:, 0] + _shift(F.chart.cell, x), both[:, 1:]

    return reference


def _error(cell: Cell, x: Numbers, p: Numbers, R: Numbers) -> Numbers:
    """Evaluate the task error (m,) from the frame's placement (p, R) to a pose x (4, 4), m and rad.

    The error has only the components that the kind of task commands.
    """
    away = x[:3, 3] - p
    kind = cell.task.kind
    if not kind.turns:
        return away[np.asarray(kind.rows)]
    turn = _tilts(R, x[:3, :3]) if kind.tool_axes else _log3(x[:3, :3] @ R.T)
    return jnp.concatenate([away, turn])


# ---- coordinates of cells and sectors


def _coordinates(cell: Cell, x: Numbers) -> Numbers:
    """Convert a pose x (4, 4) to the cell's scaled coordinates u (k,), in [−1, 1] inside the cell.

    The polynomials of F, the function of the cell, are in these coordinates.
    """
    y = _measured(cell, x) - jnp.asarray(cell._offset, x.dtype)
    return y[cell.moved] / jnp.asarray(cell.widths[cell.moved], x.dtype)


def _rigid(task: Task, x: Numbers) -> Numbers:
    """Test whether a matrix (4, 4) is a rigid transform, as ``F.batch`` does, to about 1e-6.

    The rotation is tested only if the task commands a rotation. The result is a JAX boolean,
    because a compiled function cannot raise an error.
    """
    R = x[:3, :3]
    off = [x[3] - jnp.asarray([0.0, 0.0, 0.0, 1.0], x.dtype)]
    if task.kind.turns:
        squares = jnp.stack([R[0] @ R[0] - 1, R[1] @ R[1] - 1, R[0] @ R[1]])
        off += [squares, jnp.cross(R[0], R[1]) - R[2]]
    return (jnp.abs(jnp.concatenate(off)) < max(ROTATION, 8 * _eps(x))).all()


def _inside(cell: Cell, x: Numbers) -> Numbers:
    """Test whether a pose x (4, 4) lies in a cell with all its coordinates (``cell.whole``).

    Coordinates of width 0, which are constant in the cell, are also tested. The tolerance depends
    on the floating-point type of x.
    """
    y = _measured(cell, x)
    held = np.flatnonzero(cell.widths == 0)
    most = cell._bounds
    near = jnp.abs(_coordinates(cell, x)) <= jnp.asarray(most + max(EDGE, 8 * _eps(x)), x.dtype)
    return near.all() & (jnp.abs(y[held]) <= max(TURNED, 8 * _eps(x))).all()


def _shift(cell: Cell, x: Numbers) -> Numbers:
    """Evaluate the joint angles (n,) to add to q_ref for the coordinates that u leaves out.

    Because of a symmetry of the arm, F changes by these angles only: to turn a pose around the
    base, for example, only the first joint turns. So u, the coordinates of the polynomials, leaves
    such coordinates out.
    """
    return jnp.asarray(cell.along, x.dtype) @ _measured(cell, x)[np.array(cell._removed, int)]


def _eps(x: Numbers) -> float:
    """Return the machine epsilon of an array's type."""
    return float(np.finfo(x.dtype).eps)


def _measured(cell: Cell, x: Numbers) -> Numbers:
    """Compute the coordinates (m,) of a pose (4, 4) from the cell's middle, m and rad, not scaled.

    They are those components of the position, and of a rotation vector or the tilts of the tool,
    that the task commands. For a sector, which is a cell around the base, they are cylindrical.
    """
    if isinstance(cell, Sector):
        return _cylindrical(cell, x)
    placement, kind = cell.placement, cell.task.kind
    rows = np.asarray(cell.task.rows[: len(cell.half_width)])
    away = (x[:3, 3] - jnp.asarray(placement.translation, x.dtype))[rows]
    R_0 = jnp.asarray(placement.rotation, x.dtype)
    if not kind.turns:
        return away
    turn = _tilts(R_0, x[:3, :3]) if kind.tool_axes else _log3(x[:3, :3] @ R_0.T)
    return jnp.concatenate([away, turn])


def _cylindrical(sector: Sector, x: Numbers) -> Numbers:
    """Compute the coordinates (m,) of a pose in a sector, m and rad, not scaled.

    A sector is a cell around the base. The coordinates, relative to the middle, are radius, angle
    and height about the sector's axis, the tilts of the tool's axis, and the spin of the tool about
    that axis.
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
    back = jnp.stack([c, s, none, -s, c, none, none, none, one]).reshape(3, 3)  # R_a(-φ)
    R_0 = jnp.asarray(sector.placement.rotation, x.dtype)
    turned = R_0.T @ B.T @ back @ B @ x[:3, :3]
    t = _tilts(jnp.eye(3, dtype=x.dtype), turned)
    if sector.task.m < 6:
        return jnp.concatenate([y, t])
    first = _tilted_back(t, turned[:, 0])
    spin = jnp.arctan2(first[1], first[0])
    spin -= 2 * jnp.pi * jnp.rint((spin - sector.spin_middle) / (2 * jnp.pi))
    return jnp.concatenate([y, t, spin[None]])


def _tilted_back(t: Numbers, v: Numbers) -> Numbers:
    """Rotate a vector v (3,) by ``exp(-t)``, where t (2,) is a rotation vector in the x-y plane.

    The result has no tilt of the tool, only its spin. The function is differentiable also at t = 0.
    """
    square = t @ t
    small = square < 1e-6
    theta = jnp.sqrt(jnp.where(small, 1.0, square))
    sine = jnp.where(small, 1 - square / 6, jnp.sin(theta) / theta)
    versine = jnp.where(small, 0.5 - square / 24, (1 - jnp.cos(theta)) / theta**2)
    w = -jnp.stack([t[0], t[1], jnp.zeros_like(t[0])])
    once = jnp.cross(w, v)
    return v + sine * once + versine * jnp.cross(w, once)


def _log3(R: Numbers) -> Numbers:
    """Evaluate the rotation vector ω (3,), exp(ω̂) = R, for angles below π; differentiable at 0.

    The usual formula divides by 0 at R = I, which makes its derivative NaN.
    """
    w = jnp.stack([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / 2
    return w * _angle_over_sine(w @ w, (jnp.trace(R) - 1) / 2)


def _tilts(R: Numbers, goal: Numbers) -> Numbers:
    """Compute the rotation (2,), rad, about a tool's x and y that aligns its z with a goal's z.

    R and ``goal`` (3, 3) are the rotations of the tool and the goal. The result is the error of a
    task that leaves the rotation about the tool's axis free.
    """
    aim = R.T @ goal[:, 2]
    turn = jnp.stack([-aim[1], aim[0]])
    return turn * _angle_over_sine(turn @ turn, aim[2])


def _angle_over_sine(square: Numbers, cosine: Numbers) -> Numbers:
    """Evaluate θ / sin θ from s² = sin² θ and cos θ; by its series, 1 + s²/6 + 3 s⁴/40, near 0.

    The factor converts a vector of length sin θ to one of length θ. It is differentiable at 0.
    """
    small = (square < 1e-6) & (cosine > 0)
    sine = jnp.sqrt(jnp.where(small, 1.0, square))
    series = 1 + square / 6 + 3 * square**2 / 40
    return jnp.where(small, series, jnp.arctan2(sine, cosine) / sine)
