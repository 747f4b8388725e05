"""What a family of potentials must offer, and what a choice among them is."""

from __future__ import annotations

from collections.abc import Sequence
from operator import index
from typing import Protocol, runtime_checkable

from numpy.typing import ArrayLike

from ..arguments import Array, as_matrices, shown
from ..errors import InputError


@runtime_checkable
class Potentials(Protocol):
    """r potentials h(q) = c chosen from a family: the leaves of a repeatable control."""

    def value(self, q: Array) -> Array:
        """Evaluate h(q): (r,)."""

    def gradient(self, q: Array) -> Array:
        """Evaluate V = ∂hᵀ/∂q: (n, r)."""

    def gradients(self, Q: Array) -> Array:
        """Evaluate V at every row of Q: (K, n, r)."""


@runtime_checkable
class CurvedPotentials(Potentials, Protocol):
    """Potentials that know their second derivatives too: what an exact Lie bracket needs."""

    def hessian(self, q: Array) -> Array:
        """Evaluate ∂V/∂q: (n, n, r), ``[i, k, j] = ∂²h_j/∂q_i∂q_k``."""


@runtime_checkable
class PotentialBasis(Protocol):
    """A family of N potentials h_1 … h_N of q (35)."""

    @property
    def size(self) -> int:
        """N, the number of potentials."""

    def values(self, Q: Array) -> Array:
        """Evaluate the potentials at every row of Q (K, n): (K, N)."""

    def gradients(self, Q: Array) -> Array:
        """Evaluate the gradients: (K, n, N), ``[k, i, j] = ∂h_j/∂q_i``."""

    def weighted(self, A: Array) -> Potentials:
        """Choose ``h = Aᵀ (h_1 … h_N)`` with coefficients A (N, r) (35)."""


def joints_of(potentials: PotentialBasis | Potentials) -> int | None:
    """How many joints potentials are of, as their own ``n`` says; None where they take any
    number."""
    return getattr(potentials, "n", None)


def check_joints(potentials: PotentialBasis | Potentials, n: int) -> None:
    """Refuse potentials of another number of joints than a task's n.

    Raises
    ------
    InputError
        If they are; it names both numbers.
    """
    of = joints_of(potentials)
    if of not in (None, n):
        raise InputError(f"the potentials are of {of} joints, but the task has {n}")


def coefficients(A: ArrayLike, size: int) -> Array:
    """Take the coefficients of ``h = Aᵀ (h_1 … h_N)``: (N, r) finite numbers, one row per
    potential.

    Raises
    ------
    InputError
        If they are anything else.
    """
    (A,) = as_matrices(("the coefficients", A, f"{size} r"), exact=True)
    return A


def as_joint_indices(variables: Sequence[int] | None, n: int) -> tuple[int, ...]:
    """Take the joints that potentials depend on, counted from 0; None is all n of them.

    Raises
    ------
    InputError
        If a number is no joint's.
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


def name_of(potentials: PotentialBasis, index: int) -> str:
    """Name one potential of a family for a person: as the family's own ``names`` say, else by its
    number."""
    names = getattr(potentials, "names", None)
    return f"{names[index]}" if names is not None else f"h_{index + 1}"
