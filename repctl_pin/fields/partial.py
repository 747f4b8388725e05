"""Potentials of some of the joints, seen by an arm that has more."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..arguments import Array
from .field import CurvedMap


class PartialMap:
    """``h(q) = h_part(q[variables])``: constant along every other joint.

    Parameters
    ----------
    part
        Potentials of the chosen joints alone.
    variables
        Which of the arm's joints these are, counted from 0.
    n
        How many joints the arm has.
    """

    def __init__(self, part: CurvedMap, variables: Sequence[int], n: int) -> None:
        self.part, self.variables, self.n = part, np.array(variables, int), int(n)

    def value(self, q: Array) -> Array:
        """Evaluate h(q): (r,)."""
        return self.part.value(q[self.variables])

    def gradient(self, q: Array) -> Array:
        """Evaluate V = ∂hᵀ/∂q: (n, r)."""
        inner = self.part.gradient(q[self.variables])
        V = np.zeros((self.n, inner.shape[1]))
        V[self.variables] = inner
        return V

    def gradients(self, Q: Array) -> Array:
        """Evaluate V at every row of Q (K, n): (K, n, r)."""
        inner = self.part.gradients(np.asarray(Q, float)[:, self.variables])
        V = np.zeros((len(inner), self.n, inner.shape[2]))
        V[:, self.variables] = inner
        return V

    def hessian(self, q: Array) -> Array:
        """Evaluate ∂V/∂q: (n, n, r)."""
        inner = self.part.hessian(q[self.variables])
        dV = np.zeros((self.n, self.n, inner.shape[2]))
        dV[np.ix_(self.variables, self.variables)] = inner
        return dV
