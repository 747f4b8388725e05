"""Nodes in blocks: kept or built anew at every pass, here, in other processes, or on a cluster.

One seam, :class:`Blocks`: add a function of the criterion up over all blocks. Where the blocks lie and who
evaluates them is nobody else's business, and sums are taken in the order of the nodes whoever did the work.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from .criterion import Block, Builder, Sides, gather

Array = NDArray[np.float64]
Tick = Callable[[float], None]


class Blocks(Protocol):
    """All nodes of a fit."""

    def total(self, function: Callable[..., tuple], *arguments: Any) -> tuple:
        """Add ``function(block, *arguments)`` up over all blocks, item by item."""
        ...

    def close(self) -> None:
        """Let the blocks go."""
        ...


class Local:
    """Blocks in this process.

    Parameters
    ----------
    builder
        Evaluates the arm.
    Q, weights : (K, n), (K,) arrays
        The nodes.
    block
        How many are evaluated at a time.
    stream
        Build the blocks anew at every pass instead of keeping them: slower, but the memory is that of one
        block.
    tick
        Called with the share of a pass that is done.
    """

    def __init__(
        self, builder: Builder, Q: Array, weights: Array, block: int, *, stream: bool = False, tick: Tick | None = None
    ) -> None:
        self._builder, self._Q, self._weights, self._block = builder, Q, weights, block
        self._tick = tick
        self._kept: list[Block] | None = None if stream else list(self._build())

    def total(self, function: Callable[..., tuple], *arguments: Any) -> tuple:
        """Add ``function(block, *arguments)`` up over all blocks, item by item."""
        return add(function(b, *arguments) for b in (self._build() if self._kept is None else self._kept))

    def close(self) -> None:
        """Let the blocks go."""
        self._kept = []

    def _build(self) -> Iterator[Block]:
        for i in range(0, len(self._Q), self._block):
            yield self._builder(self._Q[i : i + self._block], self._weights[i : i + self._block])
            if self._tick is not None:
                self._tick(min(1.0, (i + self._block) / len(self._Q)))


def add(parts: Iterable[tuple]) -> tuple:
    """Add tuples of sums up, item by item; sides of singularities are gathered."""
    total: list[Any] = []
    sides: list[Sides] = []
    starts = [0]
    for part in parts:
        *sums, last = part
        if isinstance(last, Sides):
            sides.append(last)
            starts.append(starts[-1] + last.positive + last.negative)
        else:
            sums.append(last)
        if not total:
            total = [s.copy() if isinstance(s, np.ndarray) else s for s in sums]
        else:
            for i, s in enumerate(sums):
                total[i] += s
    return (*total, gather(sides, starts[:-1])) if sides else tuple(total)


def cut(Q: Array, weights: Array, most: int, block: int) -> list[tuple[Array, Array]]:
    """Cut nodes into at most ``most`` pieces of whole blocks, to be handed out."""
    blocks = -(-len(Q) // block)
    per_piece = -(-blocks // min(most, blocks)) * block
    return [(Q[i : i + per_piece], weights[i : i + per_piece]) for i in range(0, len(Q), per_piece)]


def over(blocks: Sequence[Block], function: Callable[..., tuple], arguments: tuple) -> tuple:
    """Add a function up over some blocks."""
    return add(function(b, *arguments) for b in blocks)
