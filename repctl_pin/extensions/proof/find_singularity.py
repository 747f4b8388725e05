"""Search for a place at which a controller fails: two configurations with a singularity between.

Ω is the region of joint space that a proof is about. J_V is the task Jacobian stacked on the
potentials' gradients. n is the number of joints.

``Potentials`` are r functions h(q) that a repeatable controller holds constant.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...base.arguments import Array
from ...model.task import Task
from ...potentials.basis import Potentials
from ...regions import Region

_SAMPLES, _TRIES, _STEPS = 4096, 64, 16
_APART = 0.03
"""Distance of the two configurations, relative to the half-widths of Ω."""

_CERTAIN = 1e-10
"""``|det J_V|``, relative to the product of its rows, from which its sign is certain."""


def opposite_signs(
    task: Task, field: Potentials, region: Region, near: Array
) -> tuple[Array, Array] | None:
    """Find two configurations (n,) of Ω where det J_V has opposite signs; None if none are found.

    J_V, the task Jacobian stacked on the potentials' gradients, is continuous, and Ω is connected,
    so J_V is singular between the two. The search starts from random samples of Ω and from the
    configuration ``near`` (n,). The two configurations that it finds are then brought close
    together.
    """
    rng, half = np.random.default_rng(0), region.bounds.half_width
    Q = np.concatenate([region.center[None], near[None], region.random(_SAMPLES, 0)])
    Q = Q[region.ratio(Q) <= 1]
    values = _determinants(task, field, Q)
    sign = np.sign(np.median(values))
    for step in 0.5 ** np.arange(_STEPS):
        least = int(np.argmin(sign * values))
        if sign * values[least] < -_CERTAIN:
            break
        tries = Q[least] + step * half * rng.uniform(-1, 1, (_TRIES, task.n))
        tries = region.clip(tries)
        Q = np.concatenate([Q, tries])
        values = np.concatenate([values, _determinants(task, field, tries)])
    a, b = (Q[int(f(sign * values))] for f in (np.argmax, np.argmin))
    if not sign * values.min() * sign * values.max() < 0:
        return None

    def value(q: Array) -> float:
        return float(sign * _determinants(task, field, q[None])[0])

    return _close_pair(value, region, a, b)


def _close_pair(
    value: Callable[[Array], float], region: Region, a: Array, b: Array
) -> tuple[Array, Array] | None:
    """Bring two configurations a and b (n,), at which ``value`` has opposite signs, close together.

    ``value``, det J_V up to a factor, must be positive at a and negative at b. The line from a to b
    is bisected until the two configurations differ by at most 3 % of the half-width of ``region``
    in each joint, a sign becomes uncertain, or the line leaves ``region``. Return the two
    configurations, or None if the sign at a or at b is uncertain.
    """
    half = region.bounds.half_width
    if min(abs(value(a)), abs(value(b))) < _CERTAIN:
        return None
    while (np.abs(a - b) / half).max() > _APART:  # as long as both signs are certain
        middle = (a + b) / 2
        there = value(middle)
        if abs(there) < 1e3 * _CERTAIN or region.ratio(middle[None])[0] > 1:
            break
        a, b = (middle, b) if there > 0 else (a, middle)
    return a, b


def _determinants(task: Task, field: Potentials, Q: Array) -> Array:
    """Evaluate det J_V at Q (K, n), relative to the product of the norms of its rows: (K,).

    J_V is the task Jacobian J stacked on the gradients Vᵀ of the potentials ``field``.
    """
    V = np.swapaxes(field.gradients(Q), 1, 2)
    J_V = np.concatenate([task.jacobians(Q), V], axis=1)
    sizes = np.linalg.norm(J_V, axis=2).prod(axis=1)
    return np.asarray(np.linalg.det(J_V) / np.where(sizes > 0, sizes, 1.0))
