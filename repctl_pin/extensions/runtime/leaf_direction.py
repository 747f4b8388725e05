"""Joint direction on a leaf from one configuration to another, which leads around singularities."""

from __future__ import annotations

from math import sqrt

import numpy as np

from ...arguments import Array
from ...errors import SingularityError
from ...strategies.repeatable import RepeatableInverse
from .governor_law import TINY, regularity

ALONG = 0.05
"""Regularity below which the direction does not lead nearer to a singularity."""

PUSH = 0.5
"""Maximum sine of the angle by which the direction leads away from a singularity."""

_STEP = 1e-5
"""Step of the finite differences of the regularity, rad or m."""


def leaf_direction(inverse: RepeatableInverse, q: Array, goal: Array) -> Array:
    """Compute the joint direction from q towards a goal q* on its leaf: ``d = (I − V V⁺)(q* − q)``.

    Near a singularity, the component of d along the gradient of the regularity is raised until d
    leads away from the singularity, and thus around it. The required component grows from 0 at the
    regularity :data:`ALONG`.

    Returns
    -------
    (n,) array
        The direction d, rad or m; ``Vᵀ d = 0``, so that ``d = G J d``.
    """
    V = np.linalg.qr(inverse.potentials.gradients(q[None])[0])[0]
    d = _tangent(V, goal - q)
    here = _regularity(inverse, q)
    if here >= ALONG:
        return d
    steps = q + _STEP * np.eye(len(q))
    slope = _tangent(
        V, np.array([_regularity(inverse, x) - here for x in steps]) / _STEP
    )
    square = max(float(slope @ slope), TINY)
    push = PUSH * (1 - here / ALONG) * sqrt(square * float(d @ d)) - float(slope @ d)
    return np.asarray(d + max(push, 0.0) / square * slope, float)


def _tangent(V: Array, x: Array) -> Array:
    """Project a vector (n,) on the tangent space of the leaf; V (n, r) is orthonormal."""
    return np.asarray(x - V @ (V.T @ x), float)


def _regularity(inverse: RepeatableInverse, q: Array) -> float:
    try:
        return regularity(inverse.task.jacobian(q), inverse(q))
    except SingularityError:
        return 0.0
