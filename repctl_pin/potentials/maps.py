"""r potentials h(q) whose level sets h(q) = c are leaves: their protocol, and classes for them.

The classes are weighted sums of a basis, sums of potentials, and potentials of selected joints.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from ..arguments import Array, as_matrices
from ..errors import InputError


@runtime_checkable
class Potentials(Protocol):
    """r potentials h(q), whose level sets h(q) = c are the leaves of a repeatable controller.

    A class that inherits from it needs no ``gradient`` of its own.
    """

    def value(self, q: Array) -> Array:
        """Evaluate h(q): (r,)."""

    def gradient(self, q: Array) -> Array:
        """Evaluate V = ∂hᵀ/∂q: (n, r)."""
        return self.gradients(np.asarray(q, float)[None])[0]

    def gradients(self, Q: Array) -> Array:
        """Evaluate V at every row of Q (K, n): (K, n, r)."""


@runtime_checkable
class CurvedPotentials(Potentials, Protocol):
    """Potentials with second derivatives, which an exact Lie bracket requires."""

    def hessian(self, q: Array) -> Array:
        """Evaluate ∂V/∂q: (n, n, r), ``[i, k, j] = ∂²h_j/∂q_i∂q_k``."""


def check_joints(potentials: object, n: int) -> None:
    """Check that potentials are of n joints, as many as a task has, or take any number.

    Raises
    ------
    InputError
        If they are of another number of joints; the message names both numbers.
    """
    of = getattr(potentials, "n", None)
    if of not in (None, n):
        raise InputError(f"the potentials are of {of} joints, but the task has {n}")


def common_joints(parts: Sequence[object]) -> int | None:
    """Return the common number of joints of several potentials; None if they take any number.

    Raises
    ------
    InputError
        If their numbers of joints differ.
    """
    known = (getattr(part, "n", None) for part in parts)
    numbers = sorted({n for n in known if n is not None})
    if len(numbers) > 1:
        raise InputError(
            f"joined potentials must be of the same joints; these are of {numbers[0]} "
            f"and of {numbers[1]}"
        )
    return numbers[0] if numbers else None


def coefficients(A: ArrayLike, size: int) -> Array:
    """Convert the coefficients A of ``h = Aᵀ (h_1 … h_N)`` to an array (N, r), where N = ``size``.

    Raises
    ------
    InputError
        If A has another shape, or is not of finite numbers.
    """
    (A,) = as_matrices(("the coefficients", A, f"{size} r"), exact=True)
    return A


class SumMap(Potentials):
    """Sum of several maps of r potentials each: ``h = h_a + h_b + …``"""

    def __init__(self, maps: Sequence[Potentials]) -> None:
        self.maps, self.n = tuple(maps), common_joints(maps)

    def value(self, q: Array) -> Array:
        """Evaluate h(q): (r,)."""
        return np.sum([part.value(q) for part in self.maps], axis=0)

    def gradients(self, Q: Array) -> Array:
        """Evaluate V at every row of Q (K, n): (K, n, r)."""
        return np.sum([part.gradients(Q) for part in self.maps], axis=0)


class CurvedSumMap(SumMap):
    """Sum of several maps of r potentials each, all with second derivatives."""

    def __init__(self, maps: Sequence[CurvedPotentials]) -> None:
        super().__init__(maps)
        self._curved = tuple(maps)

    def hessian(self, q: Array) -> Array:
        """Evaluate ∂V/∂q: (n, n, r)."""
        return np.sum([part.hessian(q) for part in self._curved], axis=0)


class PartialMap(Potentials):
    """Potentials of selected joints, ``h(q) = h_part(q[variables])``; other joints have no effect.

    Parameters
    ----------
    part
        Potentials of the selected joints alone.
    variables
        Selected joints of the arm, counted from 0.
    n
        Number of joints of the arm.
    """

    def __init__(
        self, part: CurvedPotentials, variables: Sequence[int], n: int
    ) -> None:
        self.part = part
        self.variables = np.array(variables, int)
        self.n = int(n)

    def value(self, q: Array) -> Array:
        """Evaluate h(q): (r,)."""
        return self.part.value(q[self.variables])

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
