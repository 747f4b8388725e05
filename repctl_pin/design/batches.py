"""Sums over the nodes of a fit, in batches, within a bound of memory.

A node is a configuration of the region at which the cost of a design is evaluated. A batch holds
the matrices of some nodes, from which the terms of a sum at these nodes are computed; see
:class:`.criterion.Batch`. Terms are always added in the order of the nodes, so that a sum is the
same whether or not its batches are stored.

``Builder`` is a function that makes a batch (the terms of the cost at some nodes) from
configurations and their weights. ``Batches`` are the nodes (configurations with weights) of a fit,
over which functions are summed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import chain
from typing import Any

import numpy as np

from ..base.arguments import Array
from .criterion import Batch, Builder

_SIZE = 1024
"""Number of nodes per batch."""

_MOST_BYTES = 2**30
"""Maximum memory of stored batches: 150,000 nodes of a cubic design of seven joints."""

Sums = tuple[Any, ...]
Sum = Callable[..., Sums]
"""Function of :mod:`criterion`: (batch, *arguments) → tuple of terms, each to be summed over all
batches."""
Tick = Callable[[float], None]


def _silent(share: float) -> None:
    """Do nothing: the progress callback of a fit that reports no progress.

    ``share`` is the finished fraction of the nodes, 0 to 1.
    """


class Batches:
    """Nodes of a fit, stored in batches, over which functions are summed.

    The first batches are stored, up to a bound of memory. The others are built anew for each sum,
    because a million nodes of a cubic design would take 7 GB.

    Parameters
    ----------
    builder
        Function (Q, weights) → batch, which evaluates the arm at some of the nodes.
    Q, weights : (K, n), (K,) arrays
        Nodes (configurations) and their quadrature weights.
    tick
        Progress callback, called with the fraction of the batches that are built, 0 to 1.
    size
        Number of nodes per batch.
    most_bytes
        Maximum memory of the stored batches, bytes.
    """

    def __init__(
        self,
        builder: Builder,
        Q: Array,
        weights: Array,
        *,
        tick: Tick = _silent,
        size: int = _SIZE,
        most_bytes: float = _MOST_BYTES,
    ) -> None:
        self._builder = builder
        self._Q = Q
        self._weights = weights
        self._tick = tick
        self._size = size
        self._kept: list[Batch] = []
        self._most_bytes = most_bytes
        used = 0
        for batch in self._build(0):
            used += batch.EF.nbytes + batch.null_alignment.nbytes
            if used > most_bytes:
                break
            self._kept.append(batch)
        self._used = used

    @property
    def stored(self) -> bool:
        """True if all batches are in memory."""
        return len(self._kept) * self._size >= len(self._Q)

    @property
    def copies_fit(self) -> bool:
        """True if two more copies of all batches would fit into the memory allowed for them."""
        return 3 * self._used <= self._most_bytes

    def total(self, function: Sum, *arguments: Any) -> Sums:
        """Sum the tuples ``function(batch, *arguments)`` of all batches, item by item.

        ``function`` is a function of :mod:`criterion`, such as the cost, and ``arguments`` are the
        coefficients A. The result is one tuple of sums.
        """
        batches = chain(self._kept, self._build(len(self._kept)))
        return add(function(batch, *arguments) for batch in batches)

    def _build(self, first: int) -> Iterator[Batch]:
        """Build and yield the batches from index ``first`` (counted from 0) to the last.

        The progress callback is called after each batch.
        """
        for begin in range(first * self._size, len(self._Q), self._size):
            nodes = slice(begin, begin + self._size)
            yield self._builder(self._Q[nodes], self._weights[nodes])
            self._tick(min(1.0, nodes.stop / len(self._Q)))


class BarrierCost:
    """Nodes of a fit, and barrier points: configurations between them that repel singularities.

    At a barrier point, an earlier fit had an algorithmic singularity, det(Nᵀ V) = 0: V are the
    gradients of the potentials, and N spans the null space of J. Each barrier point adds a term to
    the cost, like a node. This term tends to infinity as det(Nᵀ V) at the point tends to 0, so that
    a descent stays away from potentials that are singular at the point.

    Parameters
    ----------
    batches
        The nodes of the fit with their weights, in batches.
    builder
        Function (Q, weights) → batch, for the barrier points.
    weight
        Quadrature weight of each barrier point.
    guards
        Arrays (K, n) of initial barrier points.
    """

    def __init__(
        self, batches: Batches, builder: Builder, weight: float, guards: Sequence[Array] = ()
    ) -> None:
        self.batches = batches
        self._builder = builder
        self._weight = weight
        self.guards: list[Array] = []
        self._built: list[Batch] = []
        for Q in guards:
            self.guard(Q)

    def guard(self, Q: Array) -> None:
        """Add the configurations Q (K, n), at or near which det(Nᵀ V) = 0, as barrier points."""
        self.guards.append(Q)
        self._built.append(self._builder(Q, np.full(len(Q), self._weight)))

    @property
    def stored(self) -> bool:
        """True if all nodes are in memory."""
        return self.batches.stored

    @property
    def copies_fit(self) -> bool:
        """True if two more copies of all batches would fit into the memory allowed for them."""
        return self.batches.copies_fit

    def total(self, function: Sum, *arguments: Any) -> Sums:
        """Sum the tuples ``function(batch, *arguments)`` of all batches and the barrier points.

        ``function`` is a function of :mod:`criterion`, such as the cost of coefficients A. The
        result is one tuple of sums.
        """
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
