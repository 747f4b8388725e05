"""Bases h_1 … h_N of potentials h(q) (35): the base class, and joined bases ``a + b``."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from operator import index
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..arguments import Array, as_configurations, require_type, shown
from ..errors import InputError
from .maps import CurvedPotentials as CurvedPotentials
from .maps import CurvedSumMap, SumMap, coefficients, common_joints
from .maps import Potentials as Potentials
from .maps import check_joints as check_joints

A_BASIS = (
    "a basis of potentials, such as rp.Polynomial(q0, 2); a user-defined class inherits from "
    "repctl_pin.potentials.PotentialBasis"
)
"""Description of a basis of potentials, for messages on a wrong argument."""


class PotentialBasis(ABC):
    """Base class of bases h_1 … h_N of potentials h(q) (35).

    A subclass has a ``size`` and defines ``values`` and ``gradients``.

    Attributes
    ----------
    size : int
        N, the number of potentials.
    n : int or None
        Number of joints; None if the basis takes any number.
    """

    n: int | None = None

    if TYPE_CHECKING:

        @property
        def size(self) -> int: ...

    @property
    def names(self) -> tuple[str, ...]:
        """Name of each potential."""
        return tuple(f"h_{j + 1}" for j in range(self.size))

    @abstractmethod
    def values(self, Q: ArrayLike) -> Array:
        """Evaluate the potentials at every row of Q (K, n): (K, N)."""

    @abstractmethod
    def gradients(self, Q: ArrayLike) -> Array:
        """Evaluate the gradients at every row of Q (K, n): (K, n, N), per rad or m.

        Entry ``[k, i, j]`` is ∂h_j/∂q_i at row k.
        """

    def weighted(self, A: ArrayLike) -> Potentials:
        """Create the r potentials ``h = Aᵀ (h_1 … h_N)`` with coefficients A (N, r) (35)."""
        return CustomMap(self, coefficients(A, self.size))

    def __add__(self, other: PotentialBasis) -> Joined:
        return Joined(self, other)

    def __str__(self) -> str:
        return f"{self.size} potential{'s' * (self.size != 1)}"

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self}>"


class CustomMap(Potentials):
    """r weighted sums ``h = Aᵀ (h_1 … h_N)`` of the potentials of any basis."""

    def __init__(self, basis: PotentialBasis, A: Array) -> None:
        self.basis, self.A, self.n = basis, A, basis.n

    def __repr__(self) -> str:
        return f"<{len(self.A[0])} weighted sums of {self.basis!r}>"

    def value(self, q: Array) -> Array:
        """Evaluate h(q): (r,)."""
        return self.basis.values(np.asarray(q, float)[None])[0] @ self.A

    def gradients(self, Q: Array) -> Array:
        """Evaluate V at every row of Q (K, n): (K, n, r)."""
        return self.basis.gradients(Q) @ self.A


class Joined(PotentialBasis):
    """Concatenation of several bases of potentials, written ``a + b``; N is the sum of their sizes.

    As an example, d_1, d_2 and polynomials of θ_3 of the planar arm PPR::

        Polynomial(center, 1, scale, variables=[0, 1]) + Polynomial(center, 5, scale, variables=[2])

    Parameters
    ----------
    *parts : PotentialBasis
        Bases of potentials of the same joints.

    Raises
    ------
    InputError
        If a part is not a basis of potentials, or their numbers of joints differ.

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
            raise InputError("Joined needs at least one basis of potentials")
        for part in flat:
            require_type(part, PotentialBasis, "each part of a joined basis", A_BASIS)
        self.parts: tuple[PotentialBasis, ...] = tuple(flat)
        self.n = common_joints(flat)
        self._ends = np.cumsum([part.size for part in self.parts])

    @property
    def size(self) -> int:
        """N, the number of potentials."""
        return int(self._ends[-1])

    @property
    def names(self) -> tuple[str, ...]:
        """Name of each potential in its own basis."""
        return tuple(name for part in self.parts for name in part.names)

    def values(self, Q: ArrayLike) -> Array:
        """Evaluate the potentials at every row of Q (K, n): (K, N)."""
        Q = as_configurations(Q, None, "a joined basis")
        return np.concatenate([part.values(Q) for part in self.parts], axis=-1)

    def gradients(self, Q: ArrayLike) -> Array:
        """Evaluate the gradients at every row of Q (K, n): (K, n, N), per rad or m."""
        Q = as_configurations(Q, None, "a joined basis")
        return np.concatenate([part.gradients(Q) for part in self.parts], axis=-1)

    def split(self, A: ArrayLike) -> list[Array]:
        """Split coefficients A (N, r) into one array per part."""
        return np.split(coefficients(A, self.size), self._ends[:-1])

    def weighted(self, A: ArrayLike) -> SumMap:
        """Create the r potentials ``h = Aᵀ (h_1 … h_N)`` with coefficients A (N, r) (35)."""
        maps = [
            part.weighted(a) for part, a in zip(self.parts, self.split(A), strict=True)
        ]
        curved = [part for part in maps if isinstance(part, CurvedPotentials)]
        return CurvedSumMap(curved) if len(curved) == len(maps) else SumMap(maps)

    def __str__(self) -> str:
        return " + ".join(map(str, self.parts))


def as_joint_indices(variables: Sequence[int] | None, n: int) -> tuple[int, ...]:
    """Convert the indices of the joints on which potentials depend; None stands for all n joints.

    Returns them sorted and without duplicates, counted from 0.

    Raises
    ------
    InputError
        If there is no index, or one is not from 0 to n − 1.
    """
    if variables is None:
        return tuple(range(n))
    try:
        numbers = tuple(sorted({index(v) for v in variables}))
    except TypeError:
        numbers = ()
    if not numbers or not set(numbers) <= set(range(n)):
        raise InputError(
            f"variables must be joint numbers from 0 to {n - 1}, not {shown(variables)}"
        )
    return numbers
