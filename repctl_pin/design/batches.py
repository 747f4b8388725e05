"""Sums over the nodes of a fit, in batches: in this process, in other processes, or on a cluster.

The interface is :class:`Batches`, which sums a function of :mod:`criterion` over all batches. An
implementation decides where the batches are stored. Terms are always added in the order of the
nodes, so that the result does not depend on the implementation."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, Protocol

import numpy as np

from ..arguments import Array
from .criterion import Batch, Builder

Sums = tuple[Any, ...]
Sum = Callable[..., Sums]
"""Function of :mod:`criterion`: (batch, *arguments) → tuple of terms, each to be summed over all
batches."""
Tick = Callable[[float], None]


def _silent(share: float) -> None:
    """Progress callback that does nothing."""


class Batches(Protocol):
    """Interface of a set of nodes, stored in batches, over which functions are summed."""

    def total(self, function: Sum, *arguments: Any) -> Sums:
        """Sum the tuples ``function(batch, *arguments)`` of all batches, item by item."""

    def close(self) -> None:
        """Free the memory of the batches."""


class Local:
    """Batches in the memory of this process.

    Parameters
    ----------
    builder
        Factory of the batches.
    Q, weights : (K, n), (K,) arrays
        Nodes (configurations) and their quadrature weights.
    batch
        Number of nodes per batch.
    stream
        Build the batches anew for each sum instead of storing them: slower, but with the memory of
        one batch only.
    tick
        Progress callback, called with the fraction of the batches that are built.
    """

    def __init__(
        self,
        builder: Builder,
        Q: Array,
        weights: Array,
        batch: int,
        *,
        stream: bool = False,
        tick: Tick = _silent,
    ) -> None:
        self._builder = builder
        self._Q = Q
        self._weights = weights
        self._batch = batch
        self._tick = tick
        self._kept: list[Batch] | None = None if stream else list(self._build())

    def total(self, function: Sum, *arguments: Any) -> Sums:
        """Sum the tuples ``function(batch, *arguments)`` of all batches, item by item."""
        return over(
            self._build() if self._kept is None else self._kept, function, arguments
        )

    def close(self) -> None:
        """Free the memory of the batches."""
        self._kept = []

    def _build(self) -> Iterator[Batch]:
        for i, batch in enumerate(
            self._builder.batches(self._Q, self._weights, self._batch), 1
        ):
            yield batch
            self._tick(min(1.0, i * self._batch / len(self._Q)))


class BarrierCost:
    """Nodes of a fit, and additional points of Ω that act as a barrier against singularities.

    The points are configurations between the nodes at which an earlier fit had det(Nᵀ V) = 0. Each
    is an additional node. Its cost tends to infinity as det(Nᵀ V) tends to 0, so that a descent
    stays away from a singularity there.

    Parameters
    ----------
    batches
        The nodes.
    builder
        Factory of batches, for the additional points.
    weight
        Quadrature weight of each additional point.
    guards
        Arrays (K, n) of initial additional points.
    """

    def __init__(
        self,
        batches: Batches,
        builder: Builder,
        weight: float,
        guards: Sequence[Array] = (),
    ) -> None:
        self.batches = batches
        self._builder = builder
        self._weight = weight
        self.guards: list[Array] = []
        self._built: list[Batch] = []
        for Q in guards:
            self.guard(Q)

    def guard(self, Q: Array) -> None:
        """Add the configurations Q (K, n) to the barrier points."""
        self.guards.append(Q)
        self._built.append(self._builder(Q, np.full(len(Q), self._weight)))

    def total(self, function: Sum, *arguments: Any) -> Sums:
        """Sum the tuples ``function(batch, *arguments)`` of all batches and the barrier points."""
        nodes = self.batches.total(function, *arguments)
        return add([nodes, *(function(b, *arguments) for b in self._built)])


def add(parts: Iterable[Sums]) -> Sums:
    """Sum tuples of numbers or arrays item by item, in the given order; the tuples stay unchanged.

    Return a tuple of the sums; it is empty if there are no tuples.
    """
    total: list[Any] = []
    for part in parts:
        if not total:
            total = [s.copy() if isinstance(s, np.ndarray) else s for s in part]
        else:
            for i, s in enumerate(part):
                total[i] += s
    return tuple(total)


def over(batches: Iterable[Batch], function: Sum, arguments: tuple[Any, ...]) -> Sums:
    """Sum the tuples ``function(batch, *arguments)`` of the given batches, item by item."""
    return add(function(b, *arguments) for b in batches)
