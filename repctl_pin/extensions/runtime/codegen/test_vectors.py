"""Test vectors for the exported C code: valid and invalid inputs, and Python's results for them.

The exported program ``check.c`` calls the C functions with these inputs, and compares their results
with those of Python. A status is the return value of a C function: OK, SINGULAR (the arm is near a
singularity), BAD_NUMBER (an input is invalid) or OUTSIDE (q is outside the region of the design). A
leaf is the set h(q) = c of r potentials h, which the inverse keeps constant; c (r,) is its level. A
cell is a box of poses over which a function F(x; c) gives one configuration per pose x and level c.
The torque law is that of :class:`LeafImpedance`; its observer estimates a disturbance. n is the
number of joints, m that of task coordinates.

``Bounded`` is a region of joint space that computes how far inside or outside configurations lie.
``Vector`` is a test vector: a configuration, and the other inputs of the exported C functions.
``Gains`` are the gains of the torque law: stiffness, damping ratios, leaf frequency, and those of
the observer.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pinocchio as pin

from ....base.arguments import Array, read_only
from ....base.errors import InputError, SingularityError
from ....model.task import Task
from ....regions import Region
from ....strategies.repeatable import Bounded, RepeatableInverse
from ...cells.function import InverseFunction
from ..torque_law import Gains, NumPyTorques, Observer

STATUS = ("OK", "SINGULAR", "BAD_NUMBER", "OUTSIDE")
OK, SINGULAR, BAD_NUMBER, OUTSIDE = range(4)
_EDGE = 1e-9
"""Tolerance beyond the edge of a region, and beyond joint limits, that counts as inside."""

_DT = 1e-3
_GAINS = (20.0, None, 500.0, 0.0)
_COUNT = 48
"""Number of test vectors."""

_DRAWS = 100
"""Maximum number of draws of a configuration outside the region."""

_ILL_CONDITIONED = 1e3
"""Condition number of J_V from which a configuration is drawn anew."""


@dataclass(frozen=True, eq=False)
@read_only
class Vector:
    """Test vector: a configuration q (n,), and the other inputs of the exported C functions.

    ``xdot`` (m,) is ẋ for ``RepeatableInverse.velocity``. ``target``, ``dt``, ``twist``, ``leaf``,
    ``gain``, ``limit`` (n,) (the speed limits) and ``damping`` are arguments of
    ``RepeatableInverse.step``, where ``leaf`` (r,) is the level c; with ``stay_inside``, a step
    from outside the region, or to joints beyond their limits, has the status OUTSIDE. Inputs of the
    torque law are ``joint_speed`` (n,), q̇; ``M`` (n, n), the inertia; ``bias`` (n,), the gravity
    and velocity terms; ``gains``; and ``observer`` (r,), the observer's state. An optional input
    that is left out is None.
    """

    q: Array
    xdot: Array
    target: tuple[pin.SE3, ...]
    dt: float
    twist: Array | None
    leaf: Array | None
    gain: float | None
    limit: Array | None
    damping: float
    stay_inside: bool
    joint_speed: Array
    M: Array
    bias: Array
    gains: Gains
    observer: Array | None


def vectors(inverse: RepeatableInverse, region: Bounded | None, start: Array) -> list[Vector]:
    """Sample 48 test vectors, most of them with a configuration in the region.

    In the others, the configuration is outside the region, or an input is invalid. Without a
    region, or if it is a cell, the configurations lie around ``start`` (n,). Optional inputs are
    None in some vectors. Every call gives the same vectors.
    """
    task, rng = inverse.task, np.random.default_rng(0)
    near_start = start + rng.uniform(-0.2, 0.2, (_COUNT, task.n))
    Q = region.random(_COUNT, 0)[:_COUNT] if isinstance(region, Region) else near_start
    found = [_valid(inverse, k, q, rng) for k, q in enumerate(Q)]
    for k, (what, value) in _bad(task, found).items():
        if k < len(found):
            if what in ("q", "xdot"):
                value = np.append(getattr(found[k], what)[:-1], value)
            found[k] = replace(found[k], **{what: value})
    return found


def _valid(inverse: RepeatableInverse, k: int, q: Array, rng: np.random.Generator) -> Vector:
    """Sample the valid test vector number k, at the configuration q (n,) or away from it.

    In every sixth vector, q is moved, in most cases out of the region. All random numbers are drawn
    from ``rng``.
    """
    task = inverse.task
    if k % 6 == 5:
        q = _moved(inverse, q, rng)
    near = task.placements(q + 0.01 * rng.normal(size=task.n))
    turn = 2.0 if k % 7 == 6 else 0.01
    away = tuple(_turned(x, rng.normal(size=3) * turn) for x in near)
    return Vector(
        q=q,
        xdot=rng.normal(size=task.m),
        target=away,
        dt=_DT,
        twist=None if k % 3 == 0 else rng.normal(size=task.twist_size),
        leaf=None if k % 4 == 0 else inverse.leaf(q) + 0.01 * rng.normal(size=task.r),
        gain=_GAINS[k % len(_GAINS)],
        limit=None if k % 2 else rng.uniform(0.1, 2.0, task.n),
        damping=0.0 if k % 5 else 0.2,
        stay_inside=k % 8 < 3,
        joint_speed=rng.normal(size=task.n) * (k % 9 > 0),
        M=_inertia(rng, task.n),
        bias=rng.normal(size=task.n),
        gains=_gains(rng, task),
        observer=None if k % 5 == 0 else 0.1 * rng.normal(size=task.r),
    )


def _moved(inverse: RepeatableInverse, q: Array, rng: np.random.Generator) -> Array:
    """Return q (n,) plus normal random numbers of standard deviation 1 rad or m.

    The numbers are drawn anew while J_V is ill-conditioned at the new configuration, because C and
    Python, which round differently, would disagree at it. After 100 draws, q is returned unchanged.
    """
    for _ in range(_DRAWS):
        moved = q + rng.normal(size=len(q))
        J, V = inverse.task.jacobian(moved), inverse.potentials.gradients(moved[None])[0]
        if np.linalg.cond(np.vstack([J, V.T])) < _ILL_CONDITIONED:
            return moved
    return q


def _bad(task: Task, found: Sequence[Vector]) -> dict[int, tuple[str, Any]]:
    """Choose invalid inputs: a dict ``{number of the vector: (name of the input, its value)}``.

    For q and ẋ, the value replaces the last entry; for other inputs, it replaces the whole input.
    ``found`` are the valid vectors.
    """
    bad: dict[int, tuple[str, Any]] = {
        7: ("q", np.nan),
        13: ("q", np.inf),
        19: ("xdot", np.nan),
        25: ("dt", 0.0),
        31: ("gain", 3000.0),
        32: ("M", np.diag(-np.ones(task.n))),
    }
    if task.kind.turns:  # reflected and scaled R
        mirror = pin.SE3(np.diag([1.0, 1.0, -1.0]), np.zeros(3))
        scaled = (pin.SE3((1 + 1e-5) * x.rotation, x.translation) for x in found[43].target)
        bad |= {37: ("target", (mirror,) * len(task.frames))}
        bad |= {43: ("target", tuple(scaled))}
    return bad


def answers(inverse: RepeatableInverse, region: Bounded | None, vector: Vector) -> dict[str, Any]:
    """Compute Python's results for a test vector, as a dict of statuses and outputs.

    Five keys have statuses: ``usable``, OK if q is finite; ``inside``, OUTSIDE if q is outside the
    region; ``velocity`` and ``step``, the status of these methods of the inverse; and ``torque``,
    that of the torque law. With ``stay_inside``, ``step`` can also be OUTSIDE. The outputs are
    ``placement``, ``J`` and the level ``c`` at q; ``qdot`` from ``velocity``; ``q_next`` from
    ``step``; and from the torque law ``tau`` and the new state of the ``observer``. The output of a
    method that raises an error is 0. If q is not finite, all statuses are BAD_NUMBER, and only
    ``qdot``, ``q_next`` and ``tau`` are there, all 0.
    """
    task, q = inverse.task, vector.q
    # numbers that are not finite are refused by all functions
    if not np.isfinite(q).all():
        refused = dict.fromkeys(("usable", "inside", "velocity", "step", "torque"), BAD_NUMBER)
        return refused | dict.fromkeys(("qdot", "q_next", "tau"), np.zeros(task.n))
    # placement, Jacobian and level
    said: dict[str, Any] = {
        "placement": task.placements(q),
        "J": task.jacobian(q),
        "c": inverse.leaf(q),
        "usable": OK,
    }
    beyond = region is not None and not region.ratio(q[None])[0] <= 1 + _EDGE
    said["inside"] = OUTSIDE if beyond else OK
    # velocity, step and torque; the step stays inside if the vector asks for it
    said["velocity"], said["qdot"] = asked(lambda: inverse.velocity(q, vector.xdot), task.n)
    said["step"], said["q_next"] = asked(
        lambda: inverse.step(
            q,
            vector.target,
            vector.dt,
            vector.twist,
            leaf=vector.leaf,
            gain=vector.gain,
            velocity_limit=vector.limit,
            damping=vector.damping,
        ),
        task.n,
    )
    if vector.stay_inside and said["step"] in (OK, SINGULAR) and beyond:
        said["step"] = OUTSIDE
    if (
        vector.stay_inside
        and said["step"] == OK
        and task.limit_margin(said["q_next"]).min() < -_EDGE
    ):
        said["step"] = OUTSIDE
    said["torque"], said["tau"], said["observer"] = _torque(inverse, vector)
    return said


def _torque(inverse: RepeatableInverse, vector: Vector) -> tuple[int, Array, Array]:
    """Evaluate the torque law: return its status, τ (n,), and the observer's new state (r,).

    Without an observer in the vector, the returned state is 0. Without a level in the vector, the
    law is evaluated at the level 0.
    """
    task, observer = inverse.task, None
    if vector.observer is not None:
        observer = Observer(vector.observer.copy(), vector.dt)
    leaf = np.zeros(task.r) if vector.leaf is None else vector.leaf
    law = NumPyTorques(task, inverse.potentials, vector.gains)
    q, qdot, M, b = vector.q, vector.joint_speed, vector.M, vector.bias
    status, tau = asked(
        lambda: law(q, qdot, M, b, vector.target, vector.twist, leaf, observer), task.n
    )
    return status, tau, np.zeros(task.r) if observer is None else observer.state


def _turned(placement: pin.SE3, w: Array) -> pin.SE3:
    """Rotate a placement about the origin of the base by the rotation vector w (3,), rad.

    Both its position and its orientation turn.
    """
    return pin.SE3(pin.exp3(w), np.zeros(3)) * placement


def _inertia(rng: np.random.Generator, n: int) -> Array:
    """Sample a random positive definite matrix (n, n) as the joint-space inertia."""
    A = rng.normal(size=(n, n))
    return np.eye(n) + A @ A.T / n


def _gains(rng: np.random.Generator, task: Task) -> Gains:
    """Sample random gains of the torque law."""
    zeta, omega, zeta_h, kappa = rng.uniform(0.5, 20.0, 4).tolist()
    stiffness, limit = rng.uniform(20.0, 2000.0, task.m), rng.uniform(0.5, 5.0, task.n)
    return Gains(stiffness, zeta, omega, zeta_h, kappa, limit)


def targets(function: InverseFunction, count: int = 24) -> list[tuple[pin.SE3, Array]]:
    """Sample ``count`` pairs (pose, level c (r,)) to test an inverse kinematic function F(x; c).

    The poses lie inside and just outside the cell of F. The level selects one of the
    configurations of a pose; it is 0 in every second pair.
    """
    rng = np.random.default_rng(0)
    U = (
        rng.uniform(-1.1, 1.1, (count, function.cell.k))
        * np.where(np.arange(count) % 3, 0.8, 1.0)[:, None]
    )
    return [
        (function.cell.at(u), 0.05 * (k % 2) * rng.normal(size=function.task.r))
        for k, u in enumerate(U)
    ]


def asked(function: Callable[[], Array], n: int) -> tuple[int, Array]:
    """Call a function that takes no arguments: return the status as in C, and its result (n,).

    The status is OK, or SINGULAR after a SingularityError, or BAD_NUMBER after an InputError. After
    an error the result is 0.
    """
    try:
        with np.errstate(all="ignore"):  # inputs may be infinite or nan
            return OK, function()
    except SingularityError:
        return SINGULAR, np.zeros(n)
    except InputError:
        return BAD_NUMBER, np.zeros(n)
