"""Inverse kinematic function q = F(x; c) of Baker and Wampler on a leaf of a repeatable inverse.

The leaf is the set h(q) = c, with h the r potentials that the inverse keeps constant; c is its
level. f(q) is the pose of the frame. Pose x = f(q) and level c determine q (n,), up to the solution
branch. J_V = [J; Vᵀ], with V = ∂hᵀ/∂q, is the derivative of (f, h).

``Potentials`` are r functions h(q) that a repeatable controller holds constant. ``Placements`` is
the target of several frames: a tuple of pinocchio.SE3.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..base.arguments import Array, percentage, vector
from ..base.errors import InputError, SingularityError
from ..model.chain_formulas import Placement, Placements, axis_turn
from ..model.task import Task
from ..potentials.basis import Potentials
from ..redundancy.augmented import leaf_margin
from ..redundancy.inverses import inverse_condition_number
from ..redundancy.nullspace import nullspace
from ..solvers import newton

_STEP = 0.3
"""Longest first Newton step of any joint, rad or m."""

_SHORTEST = 2.0**-10
"""Smallest share of the path that is attempted in one solve."""

_ITERATIONS = 8
_CONTRACTION = 0.7
_NEAR, _EXACT = 1e-6, 1e-12


def solve(
    task: Task,
    potentials: Potentials,
    step: Callable[..., Array],
    target: Placement,
    q0: ArrayLike,
    leaf: ArrayLike | None = None,
) -> Array:
    """Evaluate q = F(x; c) by Newton's method on ``[x − f(q); c − h(q)] = 0`` along a path from q0.

    Along the path, the frame moves in a straight line and rotates about one axis, from f(q0) to the
    target, while the level changes linearly from h(q0) to c. The equation is solved at successive
    points of the path. The distance to the next point is halved if Newton's method requires a long
    step or does not converge, or if ``det J_V`` changes sign; so q stays on the solution branch of
    q0. Joint limits are not checked.

    Parameters
    ----------
    task, potentials
        Task, and potentials h, of a repeatable inverse.
    step
        The method :meth:`RepeatableInverse.step` of that inverse.
    target
        Desired placement x of the frame, in the base frame.
    q0 : (n,) array
        Initial configuration.
    leaf : (r,) array, optional
        Level c; by default h(q0).

    Returns
    -------
    (n,) array
        Configuration at which f(q) = x and h(q) = c hold within 1e-12.

    Raises
    ------
    InputError
        If the target cannot be reached on the leaf; the message gives the share of the path that
        was followed, and the cause.
    SingularityError
        If q0 is singular.
    """
    q = vector(q0, task.n, "q0")
    target = task.as_target(target, "the target")
    if not np.isfinite(target.homogeneous).all():
        raise InputError(
            "the target contains nan or inf; give a finite position, m, and a rotation matrix"
        )
    c_start = potentials.value(q)
    c_end = c_start if leaf is None else vector(leaf, task.r, "the leaf c", "one per potential")
    between = _line(task, task.placements(q), target)
    side = _side(task, potentials, q)
    if side == 0:
        raise SingularityError(
            "the start is singular: J_V loses rank; begin at another configuration"
        )

    done, part = 0.0, 1.0
    while done < 1.0:
        ahead = min(1.0, done + part)
        here = target if ahead == 1.0 else between(ahead)
        c = c_start + ahead * (c_end - c_start)
        found = _newton(step, q, here, c, _EXACT if ahead == 1.0 else _NEAR)
        if found is not None and _side(task, potentials, found) == side:
            q, done, part = found, ahead, 2 * part
            continue
        part /= 2
        if part < _SHORTEST:
            raise _unreached(task, potentials, target, q, done)
    return q


def _newton(
    step: Callable[..., Array], q: Array, target: pin.SE3, c: Array, tolerance: float
) -> Array | None:
    """Solve ``[x − f(q); c − h(q)] = 0`` near q by Newton's method, to a tolerance, rad or m.

    ``step`` is :meth:`RepeatableInverse.step`, which makes a Newton step if dt = 1. ``target`` is
    the placement x, and ``c`` the level (r,). Return the solution (n,), or None if the first step
    is too long, the steps do not shrink, or J_V is singular.
    """

    def correction(q: Array) -> Array:
        return step(q, target, 1.0, leaf=c) - q

    try:
        return newton(
            correction,
            q,
            longest=_STEP,
            tolerance=tolerance,
            iterations=_ITERATIONS,
            contraction=_CONTRACTION,
        )
    except SingularityError:
        return None


def _side(task: Task, potentials: Potentials, q: Array) -> int:
    """Return the sign of det J_V at q: −1, 0 or 1.

    The sign changes only across a singularity of J_V. So two configurations on one solution branch
    have equal signs.
    """
    J_V = np.vstack([task.jacobian(q), potentials.gradient(q).T])
    return int(np.sign(np.linalg.det(J_V)))


def _line(
    task: Task, start: Sequence[pin.SE3], target: Any
) -> Callable[[float], pin.SE3 | Placements]:
    """Create the function s → placement on a straight line to the target, for s from 0 to 1.

    ``start`` has one placement per frame. For one frame, ``target`` and the result of the function
    are one placement; for several frames, they are :class:`Placements`.
    """
    if not isinstance(target, Placements):
        turn = _turn(task.kind, start[0], target)
        return lambda s: _between(start[0], target, turn, s)
    lines = [
        _line(single, [begin], end)
        for single, begin, end in zip(task.single_tasks, start, target, strict=True)
    ]
    return lambda s: Placements(line(s) for line in lines)


def _turn(kind: str, start: pin.SE3, target: pin.SE3) -> Array:
    """Compute the rotation vector (3,), rad, base axes, by which the frame turns to the target.

    ``kind`` is the kind of task, such as "pose" or "axis". The vector is 0 if the task does not
    control the orientation.
    """
    if kind == "pose":
        return pin.log3(target.rotation @ start.rotation.T)
    if kind == "axis":
        return start.rotation[:, :2] @ axis_turn(start.rotation, target.rotation)
    return np.zeros(3)


def _between(start: pin.SE3, target: pin.SE3, turn: Array, s: float) -> pin.SE3:
    """Interpolate between the placements ``start`` (s = 0) and ``target`` (s = 1).

    The position moves in a straight line, and the orientation turns by s times the rotation vector
    ``turn`` (3,), rad, in base axes.
    """
    p = start.translation + s * (target.translation - start.translation)
    return pin.SE3(pin.exp3(s * turn) @ start.rotation, p)


def _unreached(
    task: Task, potentials: Potentials, target: pin.SE3, q: Array, done: float
) -> InputError:
    """Create the error for a target that cannot be reached on the leaf; the path ends at q (n,).

    The message gives ``done``, the share of the path that was followed, 0 to 1, and the cause at
    q: J is nearly singular or, otherwise, the leaf margin, which is 1 at best and 0 where J_V is
    singular.
    """
    where = np.array2string(np.asarray(target.translation), precision=3, separator=", ")
    J = task.jacobian(q)
    if inverse_condition_number(J) < 0.02:
        why = "the arm is stretched or folded at a singularity there"
    else:
        clear = float(leaf_margin(nullspace(J), potentials.gradient(q)))
        why = f"the leaf margin of the controller is {clear:.2g} there"
    return InputError(
        f"{task.frame!r} cannot reach {where} m on this leaf: "
        f"the path ends at {percentage(done)} ({why}); "
        "move the target nearer, or start from another leaf"
    )
