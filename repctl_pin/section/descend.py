"""Gauss–Newton on the coefficients of a section, damped where a step does not help."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arguments import Array
from .cost import Cost, Value

_MOST = 30
_ENOUGH = 1e-4


@dataclass(frozen=True)
class Descent:
    """Where Gauss–Newton ended.

    Attributes
    ----------
    a : (N, r) array
    value : Value
        The cost there.
    start : float
        The cost where it began.
    steps : int
    """

    a: Array
    value: Value
    start: float
    steps: int


def descend(cost: Cost, a: Array, *, enough: float = _ENOUGH) -> Descent:
    """Minimise the cost from coefficients a (N, r), by Levenberg and Marquardt's method.

    Parameters
    ----------
    cost
        What to minimise.
    a
        Where to start; the section has to exist there at every node.
    enough
        The relative decrease of the cost that is not worth another step.
    """
    value = cost.value(a)
    start, steps, damping = value.cost, 0, 0.0
    if not np.isfinite(start):
        return Descent(a, value, start, 0)
    while steps < _MOST:
        gradient, H = cost.model(value)
        scale = np.diag(H).copy() + 1e-12 * np.diag(H).max()
        before = value.cost
        while True:
            d = -np.linalg.solve(H + np.diag((damping + 1e-10) * scale), gradient)
            trial = cost.value(a + d.reshape(a.shape))
            if trial.cost < value.cost:
                a, value, damping = a + d.reshape(a.shape), trial, damping / 5 if damping > 1e-4 else 0.0
                break
            damping = max(4 * damping, 1e-3)
            if damping > 1e6:
                return Descent(a, value, start, steps)
        steps += 1
        if before - value.cost < enough * before:
            break
    return Descent(a, value, start, steps)
