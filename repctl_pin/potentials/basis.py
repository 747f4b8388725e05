"""Potentials h(q), whose level sets are leaves, and bases h_1 … h_N of them.

A repeatable controller keeps r potentials h = Aᵀ (h_1 … h_N) constant, the paper's equation (35); a
design chooses the coefficients A (N, r). V = ∂hᵀ/∂q (n, r) are their gradients, one column per
potential. q (n,) is one configuration, Q (K, n) are K configurations. An object of a class named
``…Map`` is r potentials with fixed coefficients A; the method ``weighted`` of a basis creates such
objects. A joined basis ``a + b`` has the potentials of a, then those of b.

``CurvedPotentials`` are potentials with second derivatives. ``PotentialBasis`` is a basis of N
functions of q, whose combinations are the potentials h of a design. ``SumMap`` is a sum of maps h
with r potentials each.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from operator import index
from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from ..base.arguments import Array, as_configurations, as_matrices, require_type, shown
from ..base.errors import InputError

A_BASIS = (
    "a basis of potentials, such as rp.Polynomial(q0, 2); a user-defined class inherits from "
    "repctl_pin.potentials.PotentialBasis"
)
"""Description of a basis of potentials, for messages on a wrong argument."""


@runtime_checkable
class Potentials(Protocol):
    """r potentials h(q), whose level sets h(q) = c are the leaves of a repeatable controller.

    Each motion stays on one leaf. A subclass defines ``value(q)`` (r,), and ``gradients(Q)`` (K, n,
    r) at the rows of Q (K, n); ``gradient(q)`` (n, r) is derived from the latter.
    """

    def value(self, q: Array) -> Array:
        """Evaluate the r potentials h(q) at one q (n,): (r,)."""

    def gradient(self, q: Array) -> Array:
        """Evaluate V = ∂hᵀ/∂q, the gradients of the r potentials h, at one q (n,): (n, r)."""
        return self.gradients(np.asarray(q, float)[None])[0]

    def gradients(self, Q: Array) -> Array:
        """Evaluate V = ∂hᵀ/∂q, the gradients of the r potentials h, at Q (K, n): (K, n, r)."""


@runtime_checkable
class CurvedPotentials(Potentials, Protocol):
    """Potentials with second derivatives.

    Lie brackets, which test repeatability, are exact with second derivatives; without them they
    are computed by finite differences.
    """

    def hessian(self, q: Array) -> Array:
        """Evaluate the second derivatives of the r potentials h at q (n,): (n, n, r).

        Entry ``[i, k, j]`` is ∂²h_j/∂q_i∂q_k.
        """


def check_joints(potentials: object, n: int) -> None:
    """Check that potentials are functions of n joints, like the task, or of any number of joints.

    Otherwise a design for another arm would fail later, with an error about array shapes.

    Raises
    ------
    InputError
        If the potentials are functions of another number of joints; the message names both numbers.
    """
    of = getattr(potentials, "n", None)
    if of not in (None, n):
        raise InputError(
            f"the potentials are functions of {of} joints, but the task has {n} joints; "
            f"use potentials of {n} joints"
        )


def _common_joints(parts: Sequence[object]) -> int | None:
    """Return the number of joints of which all ``parts`` are functions; None if any number will do.

    Parts are potentials or bases; those of different arms cannot be joined.

    Raises
    ------
    InputError
        If their numbers of joints differ.
    """
    known = (getattr(part, "n", None) for part in parts)
    numbers = sorted({n for n in known if n is not None})
    if len(numbers) > 1:
        raise InputError(
            f"potentials of {numbers[0]} and of {numbers[1]} joints cannot be joined; "
            "make all of them for the joints of one task"
        )
    return numbers[0] if numbers else None


def coefficients(A: ArrayLike, size: int) -> Array:
    """Convert the coefficients A of ``h = Aᵀ (h_1 … h_N)`` to an array (N, r), where N = ``size``.

    Raises
    ------
    InputError
        If A has another shape, or a number that is not finite.
    """
    (A,) = as_matrices(("the coefficients", A, f"{size} r"), exact=True)
    return A


class SumMap(Potentials):
    """Sum ``h = h_a + h_b + …`` of several maps with r potentials each.

    A map is r potentials with fixed coefficients. The method ``weighted`` of a joined basis creates
    such a sum.
    """

    def __init__(self, maps: Sequence[Potentials]) -> None:
        self.maps, self.n = tuple(maps), _common_joints(maps)

    def value(self, q: Array) -> Array:
        """Evaluate the r potentials h(q) at one q (n,): (r,)."""
        return np.sum([part.value(q) for part in self.maps], axis=0)

    def gradients(self, Q: Array) -> Array:
        """Evaluate V = ∂hᵀ/∂q, the gradients of the r potentials h, at Q (K, n): (K, n, r)."""
        return np.sum([part.gradients(Q) for part in self.maps], axis=0)


class _CurvedSumMap(SumMap):
    """Sum of several maps with r potentials each, all of which have second derivatives.

    It is a class of its own, because the method ``hessian`` marks potentials with second
    derivatives.
    """

    def __init__(self, maps: Sequence[CurvedPotentials]) -> None:
        super().__init__(maps)
        self._curved = tuple(maps)

    def hessian(self, q: Array) -> Array:
        """Evaluate the second derivatives of the r potentials h at q (n,): (n, n, r).

        Entry ``[i, k, j]`` is ∂²h_j/∂q_i∂q_k.
        """
        return np.sum([part.hessian(q) for part in self._curved], axis=0)


class PotentialBasis(ABC):
    """Base class of bases h_1 … h_N of potentials, functions of the configuration q (35).

    A design combines them to r potentials, which its controller keeps constant. A subclass has a
    ``size`` and defines ``values(Q)`` (K, N) and ``gradients(Q)`` (K, n, N) at the rows of Q (K,
    n).

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
        """Evaluate the N potentials of the basis at every row of Q (K, n): (K, N)."""

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
    """r weighted sums ``h = Aᵀ (h_1 … h_N)`` of the potentials of any basis.

    Polynomials and Fourier series have faster maps of their own.
    """

    def __init__(self, basis: PotentialBasis, A: Array) -> None:
        self.basis, self.A, self.n = basis, A, basis.n

    def __repr__(self) -> str:
        return f"<{len(self.A[0])} weighted sums of {self.basis!r}>"

    def value(self, q: Array) -> Array:
        """Evaluate the r potentials h(q) at one q (n,): (r,)."""
        return self.basis.values(np.asarray(q, float)[None])[0] @ self.A

    def gradients(self, Q: Array) -> Array:
        """Evaluate V = ∂hᵀ/∂q, the gradients of the r potentials h, at Q (K, n): (K, n, r)."""
        return self.basis.gradients(Q) @ self.A


class Joined(PotentialBasis):
    """Concatenation of several bases of potentials, written ``a + b``; N is the sum of their sizes.

    For example, a planar arm has two prismatic joints d_1 and d_2, and a revolute joint θ_3. This
    basis has the potentials d_1 and d_2, up to scale, and polynomials of θ_3::

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
        self.n = _common_joints(flat)
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
        """Evaluate the N potentials of the basis at every row of Q (K, n): (K, N)."""
        Q = as_configurations(Q, None, "a joined basis")
        return np.concatenate([part.values(Q) for part in self.parts], axis=-1)

    def gradients(self, Q: ArrayLike) -> Array:
        """Evaluate the gradients ∇h_j of the N potentials at Q (K, n): (K, n, N), per rad or m.

        Entry ``[k, i, j]`` is ∂h_j/∂q_i at row k.
        """
        Q = as_configurations(Q, None, "a joined basis")
        return np.concatenate([part.gradients(Q) for part in self.parts], axis=-1)

    def split(self, A: ArrayLike) -> list[Array]:
        """Split coefficients A (N, r) into one array (N_i, r) for each of the joined bases."""
        return np.split(coefficients(A, self.size), self._ends[:-1])

    def weighted(self, A: ArrayLike) -> SumMap:
        """Create the r potentials ``h = Aᵀ (h_1 … h_N)`` with coefficients A (N, r) (35)."""
        maps = [part.weighted(a) for part, a in zip(self.parts, self.split(A), strict=True)]
        curved = [part for part in maps if isinstance(part, CurvedPotentials)]
        return _CurvedSumMap(curved) if len(curved) == len(maps) else SumMap(maps)

    def __str__(self) -> str:
        return " + ".join(map(str, self.parts))


def as_joint_indices(variables: Sequence[int] | None, n: int) -> tuple[int, ...]:
    """Check the indices, from 0, of the joints on which potentials depend.

    Return the indices sorted and without duplicates; for None, those of all n joints.

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
            f"variables must be indices of joints, from 0 to {n - 1}, not {shown(variables)}"
        )
    return numbers
