r"""F and G_r as functions of arrays: NumPy, JAX, torch, CuPy, and others of the array API standard.

A cell is a box of poses over which a function F gives one configuration per pose; G_r is the
control law of a repeatable inverse. Both are pure functions of arrays with any leading axes. Their
results have the type and the device of their input. Inside, the K poses of a batch are the last
axis, and a placement is the list of its columns (3, K): three of the rotation, and the position, m,
in base axes. ``xp`` is the namespace of the arrays, such as jax.numpy. q_ref and n_ref are the
polynomials of F: q_ref approximates F, and n_ref the null space of J. The level c is the position
along the self-motion; a leaf is the set of configurations F(x; c) with one level c. A chart is the
pair q_ref and n_ref, polynomials of the coordinates u of a cell, from −1 to 1. By a symmetry of the
arm, such as the turn of its first joint, one joint alone may move the frame along a coordinate; u
leaves such a coordinate out. A sector is a cell in cylindrical coordinates: radius, angle and
height about an axis, two tilts of the tool, and its spin, the rotation about its own axis.

Letters: n joints, m task coordinates, r = n − m components of c, k coordinates u, N monomials of u.
The offsets y are the m task coordinates of a pose relative to the middle of its cell, m and rad:
m arrays (K,). Private functions that have ``xp`` as first argument compute in that namespace.

``Chart`` is the chart of a function F, with its cell. ``JointChain`` is the serial chain of joints
from the base to the frame of a task, as arrays. ``Kind`` is the kind of a task, such as ``pose``,
with the coordinates that it commands. ``FourierMap`` is r potentials h(q) as Fourier series.
``PolynomialMap`` is r potentials h(q) as polynomials.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache, partial
from inspect import signature
from itertools import count
from math import prod
from typing import Any, TypeAlias
from weakref import WeakValueDictionary

import numpy as np
from array_api_compat import (
    array_namespace,
    device,
    is_array_api_obj,
    is_jax_namespace,
    is_torch_namespace,
)

from ...base.arguments import Array, require_type, shown
from ...base.errors import InputError
from ...model.joint_chain import JointChain, along_z, joint_chain
from ...model.kind import Kind
from ...model.task import Task
from ...potentials.basis import SumMap
from ...potentials.fourier import FourierMap
from ...potentials.polynomial import PolynomialMap
from ...redundancy.inverses import RANK_TOLERANCE
from ...strategies import RepeatableInverse
from ..cells.chart.chart import CellPotentials, Chart
from ..cells.function import InverseFunction
from ..cells.geometry.cell import EDGE, TURNED, Cell
from ..cells.geometry.sector import ANGLE, HEIGHT, RADIUS, Sector
from ..cells.targets import ROTATION

Numbers: TypeAlias = Any  # an array of any namespace
Namespace: TypeAlias = Any  # the module of its functions

_STEP = 0.3
"""Longest Newton step of any joint, rad or m."""

_ITERATIONS, _LAST = 12, 2
"""Maximum number of Newton steps, and number of those that are differentiated."""

_NEAR, _CONVERGED, _ROUNDINGS = 1e-4, 1e-6, 64
"""Length of a Newton step, rad or m, after which the last steps follow; length of the last step
below which q is a solution; least square of both, in units of the machine epsilon."""

_FAR = 1e7
"""Level c, rad or m, and number in a pose, from which on rounding leaves no solution."""

_A_FUNCTION = "a cell's function, such as found.function"


def inverse_function(F: InverseFunction, xp: Namespace) -> Callable[..., Numbers]:
    r"""Convert ``q = F(x; c)`` to a pure function of arrays.

    Newton's method finds q, in at most 12 steps. The method begins at q_ref, a polynomial of F;
    n_ref (n, r) are the directions in which the level c, the position along the self-motion, is
    measured. The last two steps alone are differentiated. At a solution, this is the implicit
    derivative:

    .. math:: \begin{bmatrix} J \\ n_{ref}^T \end{bmatrix} dq = \begin{bmatrix} dx \\
              dc + d(n_{ref}^T q_{ref}) - (dn_{ref}^T) q \end{bmatrix}

    Parameters
    ----------
    F
        Function of a cell: ``found.function``, with ``found`` the design of a cell.
    xp
        Namespace of the arrays: numpy, jax.numpy, torch, cupy, or another one of the standard.

    Returns
    -------
    function (x, leaf=None) → q
        x (..., 4, 4) are homogeneous matrices, leaf (..., r) levels c, by default 0; q (..., n).
        Leading axes are broadcast. The type is float32 or float64. Where F would raise an error, q
        is NaN, and its derivative 0: outside the cell or the limits, or if x is not a rigid
        transform to within 1e-6. In JAX the function is jitted.

    Raises
    ------
    InputError
        If F is not the function of a cell or sector, or ``xp`` is not a namespace of arrays.

    Examples
    --------
    >>> f = rp.arrays.inverse_function(found.function, np)
    >>> poses = [x.homogeneous for x in map(found.cell.at, found.cell.sample(8))]
    >>> f(np.array(poses)).shape  # (8, 4, 4) → (8, n)
    (8, 3)
    """
    require_type(F, InverseFunction, "F", _A_FUNCTION)
    xp, task, r = _namespace(xp), F.task, F.task.r
    solve = _solution(xp, F.chart)

    def function(x: Numbers, leaf: Numbers | None = None) -> Numbers:
        x = _floats(xp, x, "x", 4, 4)
        c = _zeros(xp, (r,), x) if leaf is None else _floats(xp, leaf, "leaf", r)
        lead = _broadcast(x.shape[:-2], c.shape[:-1])
        rows = _last(xp, xp.broadcast_to(x, (*lead, 4, 4)), 2)
        c = _last(xp, xp.broadcast_to(xp.astype(c, x.dtype), (*lead, r)), 1)
        good = _rigid(xp, task.kind, rows) & xp.all(xp.abs(xp.stack(c)) < _FAR, axis=0)
        X, good = _within_cell(xp, F.cell, rows, good)
        q, found = solve(X, xp.where(good, xp.stack(c), 0.0))
        # Check the limits
        within = _within(xp, task, q)
        if not F.keep_limits:
            within = within | xp.all(xp.stack(c) == 0, axis=0)
        return _first(xp, xp.where(good & found & within, q, xp.nan), lead)

    return _compiled(xp, function)


def pose_and_leaf(
    F: InverseFunction, xp: Namespace
) -> Callable[[Numbers], tuple[Numbers, Numbers]]:
    """Create the inverse of F, from a configuration q to its pose x and level c, for arrays.

    ``x = f(q)`` and ``c = n_ref(x)ᵀ (q − q_ref(x))``, with q_ref and n_ref the polynomials of F. So
    ``F(x; c) = q`` if q is near F(x; 0).

    Parameters
    ----------
    F
        Function of a cell: ``found.function``, with ``found`` the design of a cell.
    xp
        Namespace of the arrays: numpy, jax.numpy, torch, cupy, or another one of the standard.

    Returns
    -------
    function q → (x, c)
        From q (..., n) to the homogeneous matrices x (..., 4, 4) and the levels c (..., r) along
        the self-motion; c is NaN if the pose lies outside the cell.
    """
    require_type(F, InverseFunction, "F", _A_FUNCTION)
    xp, n = _namespace(xp), F.task.n
    kinematics, reference = _kinematics(xp, F.task), _reference(xp, F.chart)

    def back(q: Numbers) -> tuple[Numbers, Numbers]:
        q = _floats(xp, q, "q", n)
        lead, q = q.shape[:-1], xp.stack(_last(xp, q, 1))
        X, _ = kinematics(q)
        _, _, q_ref, n_ref = reference(X)
        c = xp.sum(n_ref * _away(xp, F.chart.cell, q - q_ref)[:, None, :], axis=0)
        c = xp.where(_inside(xp, F.cell, X), c, xp.nan)
        x = xp.stack([xp.permute_dims(column, (1, 0)) for column in X], axis=2)
        last = xp.broadcast_to(_like(xp, np.eye(4)[3:], q), (x.shape[0], 1, 4))
        return xp.reshape(xp.concat([x, last], axis=1), (*lead, 4, 4)), _first(xp, c, lead)

    return _compiled(xp, back)


def velocity(inverse: RepeatableInverse, xp: Namespace) -> Callable[[Numbers, Numbers], Numbers]:
    """Convert the control law ``q̇ = G_r(q) ẋ`` of a repeatable inverse to a function of arrays.

    The joint velocity solves ``J q̇ = ẋ``, and the potentials of the inverse stay constant:
    ``Vᵀ q̇ = 0``, with V (n, r) their gradients (37).

    Parameters
    ----------
    inverse
        ``design.inverse``, with polynomials, Fourier series or their sums as potentials, or
        ``found.inverse``, with ``found`` the design of a cell.
    xp
        Namespace of the arrays: numpy, jax.numpy, torch, cupy, or another one of the standard.

    Returns
    -------
    function (q, xdot) → qdot
        q (..., n), ẋ (..., m) as for :meth:`RepeatableInverse.velocity`, q̇ (..., n). Leading axes
        are broadcast. q̇ is NaN in three cases: q violates a joint limit, [J; Vᵀ] is singular, or
        the pose is outside the cell, if the inverse is that of a cell. The region Ω of a design
        without a cell is not checked.

    Raises
    ------
    InputError
        If ``inverse`` has other potentials, or ``xp`` is not a namespace of arrays.

    Examples
    --------
    >>> G_r = rp.arrays.velocity(found.inverse, np)
    >>> G_r(Q, Xdot).shape  # (K, n), (K, m) → (K, n)
    """
    require_type(inverse, RepeatableInverse, "inverse", "a repeatable inverse: design.inverse")
    xp, task = _namespace(xp), inverse.task
    kinematics, held = _kinematics(xp, task), _held(xp, inverse.potentials)

    def law(q: Numbers, xdot: Numbers) -> Numbers:
        q, xdot = _floats(xp, q, "q", task.n), _floats(xp, xdot, "xdot", task.m)
        lead = _broadcast(q.shape[:-1], xdot.shape[:-1])
        q = xp.stack(_last(xp, xp.broadcast_to(q, (*lead, task.n)), 1))
        xdot = _last(xp, xp.broadcast_to(xp.astype(xdot, q.dtype), (*lead, task.m)), 1)
        good = _within(xp, task, q)
        q = xp.where(good, q, _like(xp, task.reference, q)[:, None])
        X, J = kinematics(q)
        V, rate, inside = held(q, X, xdot)
        qdot, regular = _solved(xp, xp.concat([J, V], axis=1), xp.concat([xp.stack(xdot), rate]))
        return _first(xp, xp.where(good & inside & regular, qdot, xp.nan), lead)

    return _compiled(xp, law)


# ---- what the array API has no word for


def _compiled(xp: Namespace, function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a function in JAX; in torch, make it one operator of torch.compile.

    In other namespaces, return it unchanged.
    """
    if is_torch_namespace(xp):
        return _operator(function)
    if not is_jax_namespace(xp):
        return function
    import jax

    return jax.jit(function)


_functions: WeakValueDictionary[int, Callable[..., Any]] = WeakValueDictionary()
"""Functions that the operators of torch call, by the number that a graph has of each."""

_numbers = count()


def _operator(function: Callable[..., Any]) -> Callable[..., Any]:
    """Wrap a function of torch's arrays as one operator, which torch.compile does not unroll.

    Otherwise torch.compile would unroll all Newton steps, and compile for minutes.
    """
    import torch

    call, number = _operators(), next(_numbers)
    names = list(signature(function).parameters)
    _functions[number] = function

    def called(*given: Numbers, **named: Numbers) -> Any:
        if not torch.compiler.is_compiling():
            return function(*given, **named)
        given += tuple(named[name] for name in names[len(given) :] if name in named)
        results = call(number, *given)
        return tuple(results) if len(results) > 1 else results[0]

    return called


@cache
def _operators() -> Callable[..., Any]:
    """Register torch's operator for all wrapped functions, with its derivative, and return it.

    The operator calls ``_functions[number]``, in which :func:`_operator` has stored a wrapped
    function. The operator's arguments are ``number``, and the one or two arrays for the function.
    """
    import torch

    def call(number: int, one: Numbers, two: Numbers | None = None) -> list[Numbers]:
        results = _functions[number](*(each for each in (one, two) if each is not None))
        return list(results) if isinstance(results, tuple) else [results]

    def pull(number: int, one: Numbers, two: Numbers | None, rates: list[Numbers]) -> list[Numbers]:
        given = [each for each in (one, two) if each is not None]
        with torch.enable_grad():
            own = [each.detach().requires_grad_() for each in given]
            results = call(number, *own)
            return list(torch.autograd.grad(results, own, rates, materialize_grads=True))

    def shapes(number: int, one: Numbers, two: Numbers | None, rates: Any) -> list[Numbers]:
        return [torch.empty_like(each) for each in (one, two) if each is not None]

    def keep(ctx: Any, inputs: Any, output: Any) -> None:
        ctx.number, *given = inputs
        ctx.save_for_backward(*given)

    def backward(ctx: Any, rates: list[Numbers]) -> tuple[Numbers | None, ...]:
        slopes = torch.ops.repctl_pin.pull(ctx.number, *ctx.saved_tensors, rates)
        return (None, *slopes, None)[:3]

    given = "(int number, Tensor one, Tensor? two"
    library = torch.library
    library.define("repctl_pin::pull", f"{given}, Tensor[] rates) -> Tensor[]")
    library.impl("repctl_pin::pull", "default", pull)
    library.register_fake("repctl_pin::pull", shapes)
    schema = f"{given}=None) -> Tensor[]"
    operator = library.custom_op("repctl_pin::call", call, mutates_args=(), schema=schema)
    operator.register_fake(call)
    operator.register_autograd(backward, setup_context=keep)
    return operator


def _constant(xp: Namespace, *arrays: Numbers) -> tuple[Numbers, ...]:
    """Return the arrays in a form that JAX and torch do not differentiate."""
    if is_jax_namespace(xp):
        import jax

        return tuple(map(jax.lax.stop_gradient, arrays))
    return tuple(each.detach() for each in arrays) if is_torch_namespace(xp) else arrays


def _repeated(xp: Namespace, step: Callable[[Numbers], Any], q: Numbers, near: float) -> Numbers:
    """Repeat Newton steps on K configurations q (n, K) until all have converged; return them.

    ``step`` maps q to (new q, step lengths (K,)). A configuration has converged after a step
    shorter than ``near``, rad or m, and is then kept. At most ten steps are made; the caller makes
    the last two of 12, which are differentiated.
    """

    def again(state: tuple[Numbers, Numbers, int]) -> tuple[Numbers, Numbers, int]:
        q, moving, count = state
        new, size = step(q)
        return xp.where(moving, new, q), moving & ~(size <= near), count + 1

    state = (q, xp.all(q == q, axis=0), 0)
    if is_jax_namespace(xp):
        import jax

        return jax.lax.while_loop(
            lambda at: xp.any(at[1]) & (at[2] < _ITERATIONS - _LAST), again, state
        )[0]
    while state[2] < _ITERATIONS - _LAST and _some(xp, state[1]):
        state = again(state)
    return state[0]


def _some(xp: Namespace, flags: Numbers) -> bool:
    """Test whether any flag is set; True in torch.compile and vmap, where flags have no value."""
    if is_torch_namespace(xp) and type(flags) is not xp.Tensor:
        return True
    try:
        return bool(xp.any(flags))
    except RuntimeError:
        return True


def _scanned(xp: Namespace, body: Callable[..., Any], state: Any, *tables: Numbers) -> Any:
    """Call ``body`` on each row of some tables in turn; return the last state and all outputs.

    ``body`` maps (state, row of each table) to (next state, outputs); the outputs are stacked. In
    JAX the body is compiled once, as the step of a loop, instead of once per row.
    """
    if is_jax_namespace(xp):
        import jax

        return jax.lax.scan(lambda state, rows: body(state, *rows), state, tables)
    outputs = []
    for rows in zip(*map(_unstack, tables), strict=True):
        state, output = body(state, *rows)
        outputs.append(output)
    return state, [xp.stack(each) for each in zip(*outputs, strict=True)]


# ---- arguments and results


def _namespace(xp: Namespace) -> Namespace:
    """Return the namespace of the array API standard for a module such as numpy or torch."""
    try:
        return array_namespace(xp.empty(0))
    except (AttributeError, TypeError):
        raise InputError(
            f"xp must be a namespace of arrays, such as numpy, jax.numpy or torch; got {shown(xp)}"
        ) from None


def _floats(xp: Namespace, value: Numbers, name: str, *shape: int) -> Numbers:
    """Check that the argument ``name`` is an array (..., *shape) of floats, and return it.

    An array of another library is converted. InputError is raised unless its numbers are float32 or
    float64.
    """
    try:
        own = is_array_api_obj(value) and array_namespace(value) is xp
        array = value if own else xp.asarray(value)
    except (TypeError, ValueError):
        raise InputError(f"{name} must be an array of numbers; got {shown(value)}") from None
    if tuple(array.shape[-len(shape) :]) != shape:
        form = ", ".join(map(str, shape))
        raise InputError(f"{name} must be an array (..., {form}); got shape {tuple(array.shape)}")
    if not xp.isdtype(array.dtype, (xp.float32, xp.float64)):
        raise InputError(f"{name} must be float32 or float64; got {array.dtype}; convert it")
    return array


def _broadcast(one: Sequence[int], other: Sequence[int]) -> tuple[int, ...]:
    """Broadcast the leading axes of two arguments, given as shapes; return the common shape.

    InputError is raised if they do not fit.
    """
    if tuple(one) == tuple(other) or not other:
        return tuple(one)
    try:
        return np.broadcast_shapes(tuple(one), tuple(other))
    except ValueError:
        raise InputError(
            f"the leading axes of the arguments, {tuple(one)} and {tuple(other)}, do not fit; "
            "make them equal or 1"
        ) from None


def _last(xp: Namespace, a: Numbers, axes: int) -> list[Numbers]:
    """Split the last ``axes`` axes of an array into a flat list of arrays (K,), one per entry.

    K is the number of the leading indices, which become one axis.
    """
    size = prod(a.shape[-axes:])
    rows = xp.reshape(a, (-1, size))
    return [rows[:, i] for i in range(size)]


def _unstack(a: Numbers, axis: int = 0) -> list[Numbers]:
    """Split an array along an axis into a list, in a way that ``torch.func.vmap`` can map."""
    at = (slice(None),) * axis
    return [a[(*at, i, ...)] for i in range(a.shape[axis])]


def _first(xp: Namespace, a: Numbers, lead: Sequence[int]) -> Numbers:
    """Move the last axis to the front, and give it the shape ``lead``: (s, K) → (*lead, s)."""
    return xp.reshape(xp.permute_dims(a, (1, 0)), (*lead, a.shape[0]))


def _like(xp: Namespace, a: Any, other: Numbers) -> Numbers:
    """Convert a NumPy array to the type and device of another array."""
    return xp.asarray(np.array(a, float), dtype=other.dtype, device=_device(xp, other))


def _device(xp: Namespace, a: Numbers) -> Any:
    """Return the device of an array; None in JAX."""
    return None if is_jax_namespace(xp) else device(a)


def _zeros(xp: Namespace, shape: tuple[int, ...], other: Numbers) -> Numbers:
    """Return zeros of the type and device of another array."""
    return _like(xp, np.zeros(shape), other)


def _eps(xp: Namespace, a: Numbers) -> float:
    """Return the machine epsilon of an array's type."""
    return float(xp.finfo(a.dtype).eps)


# ---- F and G_r


def _solution(xp: Namespace, chart: Chart) -> Callable[..., tuple[Numbers, Numbers]]:
    """Create the function (placement, levels c (r, K)) → (q (n, K), converged (K,)) of a chart.

    The function solves q = F(x; c) by Newton's method.
    """
    kind = chart.cell.task.kind
    kinematics, reference = _kinematics(xp, chart.cell.task), _reference(xp, chart)

    def newton(
        q: Numbers, X: list[Numbers], c: Numbers, q_ref: Numbers, n_ref: Numbers
    ) -> tuple[Numbers, Numbers]:
        here, J = kinematics(q)
        level = c - xp.sum(n_ref * (q - q_ref)[:, None, :], axis=0)
        g = xp.concat([xp.stack(_displacement(xp, kind, here, X)), level])
        dq, _ = _solved(xp, xp.concat([J, n_ref], axis=1), g)
        size = xp.max(xp.abs(dq), axis=0)
        return q + dq * (_STEP / xp.where(size > _STEP, size, _STEP)), size

    def solution(X: list[Numbers], c: Numbers) -> tuple[Numbers, Numbers]:
        _, _, q_ref, n_ref = reference(X)
        given = X, c, q_ref, n_ref
        start, *held = _constant(xp, q_ref + xp.sum(n_ref * c, axis=1), c, q_ref, n_ref, *X)
        still = held[3:], *held[:3]
        least = (_ROUNDINGS * _eps(xp, c)) ** 0.5
        q = _repeated(xp, lambda q: newton(q, *still), start, max(_NEAR, least))
        last = _like(xp, np.zeros(_LAST), c)
        (q, size), _ = _scanned(
            xp, lambda at, _: (newton(at[0], *given), ()), (q, xp.zeros_like(c[0, :])), last
        )
        return q, size < max(_CONVERGED, least)

    return solution


def _solved(xp: Namespace, A: Numbers, b: Numbers) -> tuple[Numbers, Numbers]:
    """Solve ``Aᵀ x = b`` for A (n, n, K) and b (n, K): x (n, K), and a mask (K,).

    The n equations are orthonormalised in turn. The mask is True where the sine of the angle
    between each equation and the span of those before it exceeds 1e-6.
    """
    rows = xp.permute_dims(xp.concat([A, b[None, ...]]), (1, 0, 2))  # [a, b] (n, n + 1, K)
    x, regular = 0.0, True
    least = _unstack(xp.sum(rows[:, :-1, :] ** 2, axis=1) * RANK_TOLERANCE**2)
    for tiny in least:
        a = rows[0, :-1, :]
        square = xp.sum(a * a, axis=0)
        regular = (square > tiny) & regular
        one = rows[0, ...] / xp.sqrt(xp.where(square > 0, square, 1.0))
        x = x + one[:-1, :] * one[-1, :]
        along = xp.sum(rows[1:, :-1, :] * one[:-1, :], axis=1)
        rows = rows[1:, ...] - along[:, None, :] * one
    return x, regular


def _kinematics(xp: Namespace, task: Task) -> Callable[[Numbers], tuple[list[Numbers], Numbers]]:
    """Create the function q (n, K) → (placement of the frame, Jᵀ (n, m, K))."""
    chain = joint_chain(task)
    R, p = along_z(chain)  # each joint moves about or along its own z axis
    links = np.concatenate([R, p[:, :, None]], axis=2).swapaxes(1, 2)
    # Positions of the joints; the frame, at the end, does not move
    S, offset = np.pad(chain.S, ((0, 1), (0, 0))), np.pad(chain.offset, (0, 1))
    turns = np.append(chain.revolute, True)

    def kinematics(q: Numbers) -> tuple[list[Numbers], Numbers]:
        theta = _like(xp, S, q) @ q + _like(xp, offset[:, None], q)
        angles = theta * _like(xp, turns[:, None], q)
        R = xp.broadcast_to(_like(xp, np.eye(3)[:, :, None], q), (3, 3, q.shape[1]))
        at = R, xp.zeros_like(R[0, ...])
        (R, p), (z, o) = _scanned(
            xp, partial(_next_link, xp), at, _like(xp, links, q), theta - angles, angles
        )
        columns = _unstack(R)
        J = _jacobian(xp, task.kind, chain, columns, z[:-1, ...], p - o[:-1, ...])
        return [*columns, p], J

    return kinematics


def _next_link(
    xp: Namespace, at: tuple[Numbers, Numbers], table: Numbers, slide: Numbers, angle: Numbers
) -> Any:
    """Compute the placement of the next link of a chain from that of the link before.

    ``at`` is (R, p) of the link before, in the root frame: R[i] (3, K) is its unit axis x, y or z,
    and p (3, K) its origin, m. The rows of ``table`` (4, 3) are the axes x, y, z and the origin of
    the joint in the link before. The joint slides along its z axis by ``slide`` (K,), m, and
    rotates about it by ``angle`` (K,), rad. Return (R, p) of the next link, and the pair (z axis of
    the joint, origin of the joint before it slides), (3, K) each.
    """
    R, p = at
    x, y, z, step = _unstack(
        xp.reshape(table @ xp.reshape(R, (3, 3 * R.shape[-1])), (4, 3, R.shape[-1]))
    )
    cos, sin, o = xp.cos(angle), xp.sin(angle), p + step
    R = xp.stack([cos * x + sin * y, cos * y - sin * x, z])
    return (R, o + slide * z), (z, o)


def _jacobian(
    xp: Namespace, kind: Kind, chain: JointChain, R: Sequence[Numbers], z: Numbers, arm: Numbers
) -> Numbers:
    """Evaluate Jᵀ (n, m, K) from the axes ``z`` of the joints and the vectors ``arm`` to the frame.

    ``z`` and ``arm`` are (C, 3, K) in base axes, for the C joints of the chain, mimic joints
    included; ``arm`` leads from each joint to the frame, m. ``R`` are the columns of the frame's
    rotation.
    """
    turns = _like(xp, chain.revolute[:, None, None], z)
    v, omega = z + turns * (_cross(xp, z, arm, 1) - z), turns * z
    if kind.tool_axes:
        omega = xp.stack([xp.sum(omega * each, axis=1) for each in R[:2]], axis=1)
    twists = [*_unstack(v, axis=1), *_unstack(omega, axis=1)]
    J = xp.stack([twists[i] for i in kind.rows.tolist()], axis=1)
    m, K = J.shape[1:]
    flat = _like(xp, chain.S.T, z) @ xp.reshape(J, (z.shape[0], m * K))
    return xp.reshape(flat, (flat.shape[0], m, K))


def _reference(xp: Namespace, chart: Chart) -> Callable[[list[Numbers]], tuple[Any, ...]]:
    """Create the function from a placement to the polynomials of F there.

    The function returns the offsets y in the cell, a list of m arrays (K,); the monomials T (N, K)
    of the coordinates u; and q_ref (n, K) and n_ref (n, r, K). q_ref includes the joint angles that
    symmetries of the arm, such as a turn about its base, add to the polynomials.
    """
    cell, monomials = chart.cell, chart.monomials
    blocks = list(zip(monomials.starts[1:], monomials.starts[2:], strict=False))

    def reference(X: list[Numbers]) -> tuple[Any, ...]:
        y = _measured(xp, cell, X)
        u = xp.stack(_scaled(cell, y))
        T = _monomials(xp, u, monomials.parent, monomials.variable, blocks)
        q_ref, *n_ref = _unstack(_polynomials(xp, chart.coefficients, T), axis=1)
        return y, T, q_ref + _shift(xp, cell, y), xp.stack(n_ref, axis=1)

    return reference


def _monomials(xp: Namespace, u: Numbers, parent: Any, factor: Any, blocks: Any) -> Numbers:
    """Evaluate N monomials of u (k, K): (N, K).

    Monomial i is monomial ``parent[i]`` times coordinate ``factor[i]``. The monomials of one degree
    are computed together: ``blocks`` has a pair (first row, row after the last) for each degree
    from 1, and row 0 is the constant 1.
    """
    T = xp.ones_like(u[:1, :])
    for first, end in blocks:
        of, by = (xp.asarray(each[first:end], device=_device(xp, u)) for each in (parent, factor))
        T = xp.concat([T, xp.take(T, of, axis=0) * xp.take(u, by, axis=0)])
    return T


def _polynomials(xp: Namespace, coefficients: Array, T: Numbers) -> Numbers:
    """Evaluate polynomials (…, K) with coefficients (N, …) from their monomials T (N, K)."""
    table = _like(xp, coefficients.reshape(len(coefficients), -1).T, T)
    return xp.reshape(table @ T, (*coefficients.shape[1:], T.shape[-1]))


def _held(xp: Namespace, potentials: Any) -> Callable[..., tuple[Numbers, Numbers, Any]]:
    """Create the function (q, placement, ẋ) → (V (n, r, K), rates (r, K), inside (K,)).

    If ``Vᵀ q̇ = rates``, the potentials stay constant: V are their gradients, and the rates are 0,
    except for a cell, whose q_ref and n_ref move with the pose. ``inside`` is False for placements
    outside the cell, and just True without a cell. ``potentials`` are those of a cell, polynomials,
    Fourier series, or sums of them; an InputError is raised for others.
    """
    if type(potentials) is CellPotentials:
        return _held_by_cell(xp, potentials.chart)
    maps: list[Any] = list(potentials.maps if isinstance(potentials, SumMap) else [potentials])
    if not all(isinstance(each, PolynomialMap | FourierMap) for each in maps):
        raise InputError(
            "the potentials of this inverse are functions in Python, which cannot be converted",
            remedy="design with polynomials, Fourier series or their sums, or for a cell",
        )

    def held(q: Numbers, X: list[Numbers], xdot: list[Numbers]) -> tuple[Numbers, Numbers, Any]:
        V: Numbers = sum(_gradients(xp, each, q) for each in maps)
        return V, 0.0 * V[0, ...], True

    return held


def _gradients(xp: Namespace, one: PolynomialMap | FourierMap, q: Numbers) -> Numbers:
    """Evaluate V (n, r, K), the gradients of polynomials or Fourier series at q (n, K)."""
    if isinstance(one, FourierMap):
        phase, waves = _like(xp, one.waves, q) @ q, one.waves[:, :, None]
        rising = _polynomials(xp, waves * one.sines[:, None], xp.cos(phase))
        return rising - _polynomials(xp, waves * one.cosines[:, None], xp.sin(phase))
    joints, of = one.joints.tolist(), zip(one.center, one.scale, strict=True)
    u = [
        (q[j, :] - float(center)) / float(scale)
        for j, (center, scale) in zip(joints, of, strict=True)
    ]
    blocks = [(rows.start, rows.stop) for rows in one._rising]
    count, r, k = one._weight[:, :, 1:].shape
    slopes = np.zeros((count, one.n, r))
    slopes[:, joints] = one._slopes.reshape(count, k, r)
    T = _monomials(xp, xp.stack(u), one._parent, one._factor, blocks)
    return _polynomials(xp, slopes, T)


def _held_by_cell(xp: Namespace, chart: Chart) -> Callable[..., tuple[Numbers, Numbers, Any]]:
    """Create the function (q, placement, ẋ) → (V, rates, inside) for a cell's potentials.

    The arguments are q (n, K), the columns of a placement, and m arrays (K,) of task velocity; the
    results are V (n, r, K), rates (r, K) and a mask (K,). ``inside`` is False for placements
    outside the cell. V is n_ref, and the rates are ``n_refᵀ dq_ref − dn_refᵀ (q − q_ref)``, with
    the time derivatives dq_ref and dn_ref of q_ref and n_ref along the motion.
    """
    reference, cell = _reference(xp, chart), chart.cell
    _, slopes = chart._differentiated

    def held(q: Numbers, X: list[Numbers], xdot: list[Numbers]) -> tuple[Numbers, Numbers, Any]:
        y, T, q_ref, n_ref = reference(X)
        dy = _rates(xp, cell, X, y, xdot)
        du = xp.stack([dy[i] / float(cell.widths[i]) for i in cell.moved.tolist()])
        d = xp.sum(_polynomials(xp, slopes, T[: len(slopes), :]) * du, axis=2)
        dq_ref, *dn_ref = _unstack(d, axis=1)
        dq_ref = dq_ref + _shift(xp, cell, dy)
        away = _away(xp, cell, q - q_ref)[:, None, :]
        rate = n_ref * dq_ref[:, None, :] - xp.stack(dn_ref, axis=1) * away
        return n_ref, xp.sum(rate, axis=0), _inside(xp, cell.whole, X)

    return held


# ---- coordinates of cells and sectors


def _displacement(
    xp: Namespace, kind: Kind, here: list[Numbers], goal: list[Numbers]
) -> list[Numbers]:
    """Evaluate the task error from the placement ``here`` to ``goal``: m arrays (K,), m and rad."""
    away = _unstack(goal[3] - here[3])
    if not kind.turns:
        return [away[i] for i in kind.rows.tolist()]
    if kind.tool_axes:
        return [*away, *_tilt(xp, [xp.sum(each * goal[2], axis=0) for each in here[:3]])]
    # log(R* Rᵀ), from Σ r_c × r*_c and Σ r_c · r*_c over the columns
    columns = list(zip(here[:3], goal[:3], strict=True))
    sine = sum(_cross(xp, *pair) for pair in columns) / 2
    cosine = (sum(xp.sum(a * b, axis=0) for a, b in columns) - 1) / 2
    return [*away, *_unstack(sine * _angle_over_sine(xp, xp.sum(sine**2, axis=0), cosine))]


def _measured(xp: Namespace, cell: Cell, X: list[Numbers]) -> list[Numbers]:
    """Compute the offsets y of a placement X from the cell's middle: m arrays (K,), m and rad.

    In a box, the offsets are the commanded components of the position, then a rotation vector (pose
    task) or two tilts of the tool (axis task). In a sector, a cell around an axis, they are the
    first m of radius, angle, height, two tilts of the tool, and spin.
    """
    if not isinstance(cell, Sector):
        return _displacement(xp, cell.task.kind, _middle(xp, cell, X), X)
    m, (rho, z) = cell.task.m, cell.middle
    angle, back = _about_axis(xp, cell, X)
    radius, _, height = _unstack(back(X[3] - _like(xp, cell.axis[0][:, None], X[3])))
    bend, stretch, *_ = _profiled(xp, cell, height - z)
    y = [(radius - rho - bend) / stretch, angle, height - z][:m]
    if m <= 3:
        return y
    t = _tilt(xp, _unstack(_from_middle(xp, cell, back(X[2]))))
    a, b, _ = _tilted_back(xp, t, _from_middle(xp, cell, back(X[0])))
    spin = xp.atan2(b, a)
    spin = spin - 2 * np.pi * xp.round((spin - cell.spin_middle) / (2 * np.pi))
    return [*y, *t, spin][:m]


def _profiled(xp: Namespace, cell: Sector, eta: Numbers) -> list[Any]:
    """Evaluate bend and stretch of a sector, and their slopes, at heights ``eta`` = η (K,), m.

    At the height η above the sector's middle, the bend, m, is added to the middle of the range of
    radius, and the half-width of the range is multiplied by the stretch. Both are constant above
    and below the sector. The result is bend, stretch, and the derivatives of both by η: arrays
    (K,), or floats if the range is the same at all heights.
    """
    if not cell.profile.degree:
        return [0.0, 1.0, 0.0, 0.0]
    half = float(cell.widths[HEIGHT]) * (1 + EDGE)
    x, within = xp.clip(eta, -half, half), xp.abs(eta) <= half
    values, slopes = [], []
    for c in cell.profile:
        value, slope = xp.zeros_like(x) + float(c[-1]), xp.zeros_like(x)
        for each in c[-2::-1].tolist():
            slope = slope * x + value
            value = value * x + each
        values.append(value)
        slopes.append(xp.where(within, slope, xp.zeros_like(x)))
    return [*values, *slopes]


def _rates(
    xp: Namespace, cell: Cell, X: list[Numbers], y: list[Numbers], xdot: list[Numbers]
) -> list[Numbers]:
    """Compute the time derivatives of the offsets y at the task velocity ẋ: m arrays (K,).

    ``y`` are the offsets of the placement X, and ``xdot`` is ẋ, m arrays (K,).
    """
    kind, sector = cell.task.kind, isinstance(cell, Sector)
    back: Callable[[Numbers], Numbers] = _same
    v, omega = xdot[:3], xdot[3:]
    if isinstance(cell, Sector):
        _, back = _about_axis(xp, cell, X)
        v = _sector_rates(xp, cell, y, xdot, back)
    if not kind.turns:
        return v
    if not kind.tool_axes:
        if not sector:
            return [*v, *_log_rate(xp, xp.stack(y[3:]), xp.stack(omega))]
        omega = [xp.sum(each * xp.stack(omega), axis=0) for each in X[:3]]
    # Spin the velocity from the tool's axes back, and leave out the turn about the axis
    t = y[3:5]
    a, b, _ = _tilted_back(xp, t, _from_middle(xp, cell, back(X[0])))
    w = [a * omega[0] - b * omega[1], b * omega[0] + a * omega[1], *omega[2:]]
    if sector:
        none = xp.zeros_like(v[ANGLE])
        about = xp.stack([none, none, v[ANGLE]])
        around = _tilted_back(xp, t, _from_middle(xp, cell, about))
        w = [one - other for one, other in zip(w, around, strict=False)]
    return [*v, *_tilt_rates(xp, t, w)]


def _sector_rates(
    xp: Namespace,
    cell: Sector,
    y: list[Numbers],
    xdot: list[Numbers],
    back: Callable[[Numbers], Numbers],
) -> list[Numbers]:
    """Compute the time derivatives of radius, angle and height of a sector at the task velocity ẋ.

    The result is a list of arrays (K,), in this order, without the height in a planar task.
    ``y`` are the offsets of the pose, and ``xdot`` has the commanded components of the velocity,
    base axes. ``back`` converts vectors (3, K) from base axes to the directions radial, tangential,
    and along the axis.
    """
    given = dict(zip(cell.task.kind.rows.tolist(), xdot, strict=True))
    none = xp.zeros_like(xdot[0])
    v = list(_unstack(back(xp.stack([given.get(i, none) for i in range(3)]))))
    bend, stretch, *slopes = _profiled(xp, cell, y[HEIGHT] if cell.task.m > HEIGHT else none)
    radius = cell.middle[0] + bend + stretch * y[RADIUS]
    radial = v[RADIUS] - (slopes[0] + slopes[1] * y[RADIUS]) * v[HEIGHT]
    return [radial / stretch, v[ANGLE] / radius, v[HEIGHT]][: cell.task.m]


def _tilt_rates(xp: Namespace, t: list[Numbers], w: list[Numbers]) -> list[Numbers]:
    """Compute the time derivatives of the tilts t, and of the spin ψ, from an angular velocity w.

    The orientation is exp(t_1, t_2, 0) exp(0, 0, ψ), and w is in the axes between the factors:
    tilted, not spun. So ``w = J_r(t) ṫ + ψ̇ e_z``; J_r is the right Jacobian of the rotation
    vector (t_1, t_2, 0). The result is the list ṫ_1, ṫ_2, ψ̇ of arrays (K,); ψ̇ is left out if w
    has no third component.
    """
    square, across = t[0] ** 2 + t[1] ** 2, t[0] * w[0] + t[1] * w[1]
    e = _by_angle(xp, square, 1 / 6 + 7 * square / 360, lambda a: (a / xp.sin(a) - 1) / a**2)
    dt = [w[i] + e * (square * w[i] - t[i] * across) for i in range(2)]
    spin = [each + _versine(xp, square) * (t[0] * dt[1] - t[1] * dt[0]) for each in w[2:]]
    return [*dt, *spin]


def _same(v: Numbers) -> Numbers:
    """Return vectors (3, K) unchanged: the directions of a box of poses are the base axes."""
    return v


def _middle(xp: Namespace, cell: Cell, X: list[Numbers]) -> list[Numbers]:
    """Return the placement in the middle of a cell, in the type and on the device of X."""
    return [_like(xp, each[:3, None], X[3]) for each in cell.placement.homogeneous.T]


def _about_axis(
    xp: Namespace, cell: Any, X: list[Numbers]
) -> tuple[Numbers, Callable[[Numbers], Numbers]]:
    """Compute the angle (K,), rad, of the placement X about the axis of a sector.

    Return also a function that converts vectors (3, K) from base axes to the directions at the
    placement: radial, tangential, and along the axis.
    """
    B = _like(xp, cell.directions, X[3])
    a, b, _ = _unstack(B @ (X[3] - _like(xp, cell.axis[0][:, None], X[3])))
    angle = xp.atan2(b, a)
    cos, sin = xp.cos(angle), xp.sin(angle)

    def back(v: Numbers) -> Numbers:
        a, b, height = _unstack(B @ v)
        return xp.stack([cos * a + sin * b, cos * b - sin * a, height])

    return angle, back


def _from_middle(xp: Namespace, cell: Cell, v: Numbers) -> Numbers:
    """Convert vectors (3, K) to the axes of the tool in the middle of a cell.

    For a box, the given vectors are in base axes; for a sector, they are in the directions radial,
    tangential, and along the axis.
    """
    R_0 = cell.placement.rotation
    return _like(xp, (cell.directions @ R_0 if isinstance(cell, Sector) else R_0).T, v) @ v


def _scaled(cell: Cell, y: list[Numbers]) -> list[Numbers]:
    """Convert offsets y to the cell's coordinates u, k arrays (K,), in [−1, 1] inside the cell."""
    moved = zip(cell.moved.tolist(), cell._offset[cell.moved], cell._active_widths, strict=True)
    return [(y[i] - float(offset)) / float(width) for i, offset, width in moved]


def _shift(xp: Namespace, cell: Cell, y: list[Numbers]) -> Numbers | float:
    """Evaluate the joint angles (n, K), rad, to add to q_ref for the coordinates that u leaves out.

    By a symmetry of the arm, a single joint moves the frame along such a coordinate. To turn a pose
    around the base, for example, only the first joint turns. If u leaves out none, the result is 0.
    """
    if not cell.removed:
        return 0.0
    return _like(xp, cell.along, y[0]) @ xp.stack([y[i] for i in cell._removed])


def _away(xp: Namespace, cell: Cell, away: Numbers) -> Numbers:
    """Remove full turns from ``away`` = q − q_ref (n, K), at the joints of the cell's symmetries.

    Such a joint alone moves the frame along one coordinate of the cell. Return the differences (n,
    K), which are from −π to π for these joints.
    """
    turning = np.zeros((cell.task.n, 1))
    turning[[one.joint for one in cell.removed]] = 2 * np.pi
    return away - _like(xp, turning, away) * xp.round(away / (2 * np.pi))


def _rigid(xp: Namespace, kind: Kind, rows: list[Numbers]) -> Numbers:
    """Test which of K matrices (4, 4) are rigid transforms, to within 1e-6: (K,).

    ``rows`` are the 16 entries of the matrices, row by row, arrays (K,) each. Rotations are tested
    only if the task commands them. A matrix with an entry of 1e7 or more in size fails the test.
    """
    near = xp.all(xp.abs(xp.stack(rows)) < _FAR, axis=0)
    rows = [xp.where(near, each, 0.0) for each in rows]
    off = [*rows[12:15], rows[15] - 1]
    if kind.turns:
        a, b, c = (xp.stack(rows[i : i + 3]) for i in (0, 4, 8))
        off += [xp.sum(a * a, axis=0) - 1, xp.sum(b * b, axis=0) - 1, xp.sum(a * b, axis=0)]
        off += _unstack(_cross(xp, a, b) - c)
    limit = max(ROTATION, 8 * _eps(xp, rows[0]))
    return near & xp.all(xp.abs(xp.stack(off)) < limit, axis=0)


def _within_cell(
    xp: Namespace, cell: Cell, rows: list[Numbers], good: Numbers
) -> tuple[list[Numbers], Numbers]:
    """Replace poses outside the cell, and poses that are not ``good`` (K,), by its middle.

    ``rows`` are the numbers of homogeneous matrices, 16 arrays (K,). Return the placements, with
    which the equations can be solved, and a mask (K,) of the poses that were kept.
    """
    X = [xp.stack([rows[j], rows[4 + j], rows[8 + j]]) for j in range(4)]
    middle = _middle(xp, cell, X)
    X = [xp.where(good, *pair) for pair in zip(X, middle, strict=True)]
    good = good & _inside(xp, cell, X)
    return [xp.where(good, *pair) for pair in zip(X, middle, strict=True)], good


def _inside(xp: Namespace, cell: Cell, X: list[Numbers]) -> Numbers:
    """Test which of K placements X lie in a cell: (K,).

    ``cell`` must be a cell whose u includes the symmetric coordinates: the attribute ``whole`` of a
    chart's cell. Coordinates of width 0, which the cell holds constant, are tested, too. The
    tolerance depends on the floating-point type.
    """
    y, rounding = _measured(xp, cell, X), 8 * _eps(xp, X[3])
    most = (cell._bounds + max(EDGE, rounding)).tolist()
    off = [xp.abs(u) / bound for u, bound in zip(_scaled(cell, y), most, strict=True)]
    held = np.flatnonzero(cell.widths == 0).tolist()
    off += [xp.abs(y[i]) / max(TURNED, rounding) for i in held]
    return xp.all(xp.stack(off) <= 1, axis=0)


def _within(xp: Namespace, task: Task, q: Numbers) -> Numbers:
    """Test which configurations (n, K) lie within the joint limits: (K,)."""
    lower, upper = (_like(xp, each[:, None], q) for each in (task.lower, task.upper))
    return xp.all((q >= lower) & (q <= upper), axis=0)


# ---- rotations


def _cross(xp: Namespace, a: Numbers, b: Numbers, axis: int = 0) -> Numbers:
    """Evaluate cross products along an axis of length 3."""
    a, b = _unstack(a, axis=axis), _unstack(b, axis=axis)
    turns = ((1, 2), (2, 0), (0, 1))
    return xp.stack([a[i] * b[j] - a[j] * b[i] for i, j in turns], axis=axis)


def _tilt(xp: Namespace, aim: Sequence[Numbers]) -> list[Numbers]:
    """Compute the rotation vector (its x and y, rad) that turns z to a direction ``aim``.

    The direction and the result are lists of arrays (K,).
    """
    ratio = _angle_over_sine(xp, aim[0] ** 2 + aim[1] ** 2, aim[2])
    return [-aim[1] * ratio, aim[0] * ratio]


def _tilted_back(xp: Namespace, t: list[Numbers], v: Numbers) -> Sequence[Numbers]:
    """Rotate vectors v (3, K) by the inverse of rotations about tilt axes: three arrays (K,).

    The rotation vectors are (t_1, t_2, 0), rad; ``t`` has two arrays (K,), or more, which are not
    used.
    """
    square = t[0] ** 2 + t[1] ** 2
    sine = _by_angle(xp, square, 1 - square / 6, lambda a: xp.sin(a) / a)
    w = xp.stack([-t[0], -t[1], xp.zeros_like(t[0])])
    once = _cross(xp, w, v)
    return _unstack(v + sine * once + _versine(xp, square) * _cross(xp, w, once))


def _log_rate(xp: Namespace, w: Numbers, omega: Numbers) -> Sequence[Numbers]:
    """Compute the time derivatives of rotation vectors w (3, K), as three arrays (K,).

    The angular velocities ``omega`` (3, K) are in the fixed axes: R = exp w turns by Ṙ = [ω] R.
    """
    square, once = xp.sum(w * w, axis=0), _cross(xp, w, omega)
    k = _by_angle(xp, square, 1 / 12 + square / 720, lambda a: (1 - a / (2 * xp.tan(a / 2))) / a**2)
    return _unstack(omega - once / 2 + k * _cross(xp, w, once))


def _versine(xp: Namespace, square: Numbers) -> Numbers:
    """Evaluate (1 − cos θ) / θ² from θ² = ``square``."""
    return _by_angle(xp, square, 0.5 - square / 24, lambda a: 2 * (xp.sin(a / 2) / a) ** 2)


def _by_angle(
    xp: Namespace, square: Numbers, series: Numbers, closed: Callable[[Numbers], Numbers]
) -> Numbers:
    """Evaluate a function of an angle θ from θ² = ``square``; near 0 by its series.

    ``closed`` is the function of θ, ``series`` its value by the series. The result is
    differentiable at 0.
    """
    small = square < 1e-6
    return xp.where(small, series, closed(xp.sqrt(xp.where(small, 1.0, square))))


def _angle_over_sine(xp: Namespace, square: Numbers, cosine: Numbers) -> Numbers:
    """Evaluate θ / sin θ from ``square`` = sin² θ and ``cosine`` = cos θ.

    Near 0, its series 1 + s²/6 + 3 s⁴/40 with s = sin θ is used. The factor converts vectors of
    length sin θ to those of length θ. It is NaN at exactly half a turn, where the vector has no
    direction.
    """
    small = (square < 1e-6) & (cosine > 0)
    sine = xp.sqrt(xp.where(small, 1.0, xp.where(square > 0, square, xp.nan)))
    series = 1 + square / 6 + 3 * square**2 / 40
    return xp.where(small, series, xp.atan2(sine, cosine) / sine)
