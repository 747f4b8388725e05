"""What a family of potentials must offer, and what a choice among them is."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class FieldMap(Protocol):
    """r potentials h(q) = c chosen from a family: the leaves of a repeatable control."""

    def value(self, q: Array) -> Array:
        """Evaluate h(q): (r,)."""
        ...

    def gradient(self, q: Array) -> Array:
        """Evaluate V = ∂hᵀ/∂q: (n, r)."""
        ...

    def gradients(self, Q: Array) -> Array:
        """Evaluate V at every row of Q: (K, n, r)."""
        ...


@runtime_checkable
class CurvedMap(FieldMap, Protocol):
    """Potentials that know their second derivatives too: what an exact Lie bracket needs."""

    def hessian(self, q: Array) -> Array:
        """Evaluate ∂V/∂q: (n, n, r), ``[i, k, j] = ∂²h_j/∂q_i∂q_k``."""
        ...


class Field(Protocol):
    """A family of N potentials h_1 … h_N of q (35)."""

    @property
    def size(self) -> int:
        """N, the number of potentials."""
        ...

    def potentials(self, Q: Array) -> Array:
        """Evaluate the potentials at every row of Q (K, n): (K, N)."""
        ...

    def gradients(self, Q: Array) -> Array:
        """Evaluate the gradients: (K, n, N), ``[k, i, j] = ∂h_j/∂q_i``."""
        ...

    def weighted(self, A: Array) -> FieldMap:
        """Choose ``h = Aᵀ (h_1 … h_N)`` with coefficients A (N, r) (35)."""
        ...


def name_of(fields: Field, index: int) -> str:
    """Name one potential of a family for a person: as the family's own ``names`` say, else by its number."""
    names = getattr(fields, "names", None)
    return f"{names[index]}" if names is not None else f"h_{index + 1}"
