"""Sums over nodes in batches: in this process, in others, or on a cluster.

One seam, :class:`Batches`: sum a function of the criterion over all batches. An implementation
decides where the batches are kept. Sums are always taken in the order of the nodes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, Protocol

import numpy as np

from ..arguments import Array
from .criterion import Batch, Builder

Sums = tuple[Any, ...]
Sum = Callable[..., Sums]
"""A function of the criterion: a batch and further arguments → its part of the sums."""
Tick = Callable[[float], None]


def silent(share: float) -> None:
    """Progress callback that does nothing."""


class Batches(Protocol):
    """All nodes of a fit."""

    def total(self, function: Sum, *arguments: Any) -> Sums:
        """Sum ``function(batch, *arguments)`` over all batches, item by item."""

    def close(self) -> None:
        """Release the batches."""


class Local:
    """Batches in this process.

    Parameters
    ----------
    builder
        Evaluates the arm.
    Q, weights : (K, n), (K,) arrays
        The nodes.
    batch
        Number of nodes that are evaluated at a time.
    stream
        Build the batches anew in each pass instead of keeping them: slower, with the memory of one
        batch.
    tick
        Progress callback, called with the share of a pass that is done.
    """

    def __init__(
        self,
        builder: Builder,
        Q: Array,
        weights: Array,
        batch: int,
        *,
        stream: bool = False,
        tick: Tick = silent,
    ) -> None:
        self._builder, self._Q, self._weights, self._batch, self._tick = (
            builder,
            Q,
            weights,
            batch,
            tick,
        )
        self._kept: list[Batch] | None = None if stream else list(self._build())

    def total(self, function: Sum, *arguments: Any) -> Sums:
        """Sum ``function(batch, *arguments)`` over all batches, item by item."""
        return over(self._build() if self._kept is None else self._kept, function, arguments)

    def close(self) -> None:
        """Release the batches."""
        self._kept = []

    def _build(self) -> Iterator[Batch]:
        for i, batch in enumerate(self._builder.batches(self._Q, self._weights, self._batch), 1):
            yield batch
            self._tick(min(1.0, i * self._batch / len(self._Q)))


class BarrierCost:
    """Batches, and points of Ω at which det(Nᵀ V) was found to vanish between the nodes.

    Each point counts as one more node of the mean: its cost, which has no bound where det(Nᵀ V)
    goes to 0, keeps a descent away from there.

    Parameters
    ----------
    batches
        The nodes.
    builder
        Evaluates the arm.
    weight
        Weight of each point.
    guards
        Initial points.
    """

    def __init__(
        self, batches: Batches, builder: Builder, weight: float, guards: Sequence[Array] = ()
    ) -> None:
        self.batches, self._builder, self._weight = batches, builder, weight
        self.guards: list[Array] = []
        self._built: list[Batch] = []
        for Q in guards:
            self.guard(Q)

    def guard(self, Q: Array) -> None:
        """Add points Q (K, n)."""
        self.guards.append(Q)
        self._built.append(self._builder(Q, np.full(len(Q), self._weight)))

    def total(self, function: Sum, *arguments: Any) -> Sums:
        """Sum ``function(batch, *arguments)`` over all batches and guarded points, item by item."""
        nodes = self.batches.total(function, *arguments)
        return add([nodes, *(function(b, *arguments) for b in self._built)])

    def close(self) -> None:
        """Release the batches."""
        self.batches.close()


def add(parts: Iterable[Sums]) -> Sums:
    """Sum tuples item by item, in their order."""
    total: list[Any] = []
    for part in parts:
        if not total:
            total = [s.copy() if isinstance(s, np.ndarray) else s for s in part]
        else:
            for i, s in enumerate(part):
                total[i] += s
    return tuple(total)


def over(batches: Iterable[Batch], function: Sum, arguments: tuple[Any, ...]) -> Sums:
    """Sum a function over batches."""
    return add(function(b, *arguments) for b in batches)
