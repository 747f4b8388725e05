"""Potentials made of others: ``a + b`` has those of both families; an arm with more joints sees
those of some."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from ..arguments import Array, as_configurations, require_type
from ..errors import InputError
from .basis import CurvedPotentials, PotentialBasis, Potentials, coefficients, joints_of, name_of


class Family:
    """What every family of potentials can do: be joined to another."""

    def __add__(self: PotentialBasis, other: PotentialBasis) -> Joined:
        return Joined(self, other)


class Joined(Family):
    """The potentials of several families, one family after the other: h_1 … h_N, N the sum of their
    sizes.

    Written ``a + b``. With PPR's ``{d_1, d_2, polynomials of θ_3}`` as an example::

        Polynomial(center, 1, scale, variables=[0, 1]) + Polynomial(center, 5, scale, variables=[2])

    Parameters
    ----------
    *parts : Field
        Families of potentials of the same q.

    Raises
    ------
    InputError
        If a part is not a family of potentials, or their numbers of joints differ.

    Examples
    --------
    >>> potentials = rp.Polynomial(q0, 2, 0.4) + rp.Fourier(3, 1, variables=[2])
    >>> potentials.size
    11
    """

    def __init__(self, *parts: PotentialBasis) -> None:
        flat: list[PotentialBasis] = []
        for part in parts:
            flat.extend(part.parts if isinstance(part, Joined) else [part])
        if not flat:
            raise InputError("joined basis need at least one family of potentials")
        for part in flat:
            require_type(
                part,
                PotentialBasis,
                "a joined basis",
                "a family of potentials, such as rp.Polynomial(q0, 2)",
            )
        self.parts: tuple[PotentialBasis, ...] = tuple(flat)
        self.n = one_number_of_joints(flat)
        self._ends = np.cumsum([part.size for part in self.parts])

    @property
    def size(self) -> int:
        """N, the number of potentials."""
        return int(self._ends[-1])

    @property
    def names(self) -> tuple[str, ...]:
        """What each potential is called in its own family."""
        return tuple(name_of(part, j) for part in self.parts for j in range(part.size))

    def values(self, Q: ArrayLike) -> Array:
        """Evaluate the potentials at every row of Q (K, n): (K, N)."""
        Q = as_configurations(Q, None, "this family")
        return np.concatenate([part.values(Q) for part in self.parts], axis=-1)

    def gradients(self, Q: ArrayLike) -> Array:
        """Evaluate the gradients at every row of Q (K, n): (K, n, N), per rad or m."""
        Q = as_configurations(Q, None, "this family")
        return np.concatenate([part.gradients(Q) for part in self.parts], axis=-1)

    def split(self, A: ArrayLike) -> list[Array]:
        """Cut coefficients A (N, r) into one array a part."""
        return np.split(coefficients(A, self.size), self._ends[:-1])

    def weighted(self, A: ArrayLike) -> SumMap:
        """Choose ``h = Aᵀ (h_1 … h_N)`` with coefficients A (N, r) (35)."""
        maps = [part.weighted(a) for part, a in zip(self.parts, self.split(A), strict=True)]
        curved = [part for part in maps if isinstance(part, CurvedPotentials)]
        return CurvedSumMap(curved) if len(curved) == len(maps) else SumMap(maps)

    def __str__(self) -> str:
        return " + ".join(map(str, self.parts))

    def __repr__(self) -> str:
        return (
            f"<{' + '.join(repr(part).strip('<>') for part in self.parts)}: {self.size} potentials>"
        )


def one_number_of_joints(parts: Sequence[PotentialBasis | Potentials]) -> int | None:
    """Take the number of joints that all parts are of; None where they take any."""
    numbers = sorted({n for part in parts if (n := joints_of(part)) is not None})
    if len(numbers) > 1:
        raise InputError(
            f"joined basis must be of the same joints; these are of {numbers[0]} and of {numbers[1]}"
        )
    return numbers[0] if numbers else None


class SumMap:
    """The sum of r potentials of each part: h = h_a + h_b + …"""

    def __init__(self, maps: Sequence[Potentials]) -> None:
        self.maps, self.n = tuple(maps), one_number_of_joints(maps)

    def value(self, q: Array) -> Array:
        """Evaluate h(q): (r,)."""
        return np.sum([part.value(q) for part in self.maps], axis=0)

    def gradient(self, q: Array) -> Array:
        """Evaluate V = ∂hᵀ/∂q: (n, r)."""
        return np.sum([part.gradient(q) for part in self.maps], axis=0)

    def gradients(self, Q: Array) -> Array:
        """Evaluate V at every row of Q (K, n): (K, n, r)."""
        return np.sum([part.gradients(Q) for part in self.maps], axis=0)


class CurvedSumMap(SumMap):
    """A sum of potentials that all know their second derivatives."""

    def __init__(self, maps: Sequence[CurvedPotentials]) -> None:
        super().__init__(maps)
        self._curved = tuple(maps)

    def hessian(self, q: Array) -> Array:
        """Evaluate ∂V/∂q: (n, n, r)."""
        return np.sum([part.hessian(q) for part in self._curved], axis=0)


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

    def __init__(self, part: CurvedPotentials, variables: Sequence[int], n: int) -> None:
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
