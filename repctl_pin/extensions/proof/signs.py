"""Singularities proved by signs: det J_V has opposite signs at two configurations of Ω.

J_V is continuous, and Ω connected, so det J_V is 0 between them.
"""

from __future__ import annotations

import numpy as np

from ...arguments import Array
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
    """Find two configurations of Ω at which det J_V has opposite signs.

    Samples of Ω and ``near`` (n,) are searched downhill. Returns the nearest pair found on the line
    between two of them, or None.
    """
    rng, half = np.random.default_rng(0), region.bounds.half_width
    Q = np.concatenate([region.center[None], near[None], region.random(_SAMPLES, 0)])
    Q = Q[region.ratio(Q) <= 1]
    values = determinants(task, field, Q)
    sign = np.sign(np.median(values))
    for step in 0.5 ** np.arange(_STEPS):
        least = int(np.argmin(sign * values))
        if sign * values[least] < -_CERTAIN:
            break
        tries = Q[least] + step * half * rng.uniform(-1, 1, (_TRIES, task.n))
        tries = region.clip(tries)
        Q = np.concatenate([Q, tries])
        values = np.concatenate([values, determinants(task, field, tries)])
    a, b = (Q[int(f(sign * values))] for f in (np.argmax, np.argmin))
    if not sign * values.min() * sign * values.max() < 0:
        return None
    if np.abs(determinants(task, field, np.array([a, b]))).min() < _CERTAIN:
        return None
    while (np.abs(a - b) / half).max() > _APART:  # as long as both signs are certain
        middle = (a + b) / 2
        value = float(sign * determinants(task, field, middle[None])[0])
        if abs(value) < 1e3 * _CERTAIN or region.ratio(middle[None])[0] > 1:
            break
        a, b = (middle, b) if value > 0 else (a, middle)
    return a, b


def determinants(task: Task, field: Potentials, Q: Array) -> Array:
    """Evaluate det J_V at configurations (K, n), relative to the product of the rows' norms."""
    V = np.swapaxes(field.gradients(Q), 1, 2)
    J_V = np.concatenate([task.jacobians(Q), V], axis=1)
    sizes = np.linalg.norm(J_V, axis=2).prod(axis=1)
    return np.asarray(np.linalg.det(J_V) / np.where(sizes > 0, sizes, 1.0))
