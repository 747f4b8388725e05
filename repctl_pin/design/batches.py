"""Sums over the nodes of a fit, in batches: in this process, in other processes, or on a cluster.

A node is a configuration of the region at which the cost of a design is evaluated. The interface is
:class:`Batches`, which sums a function of :mod:`criterion` over all batches. An implementation
decides where the batches are stored. Terms are always added in the order of the nodes, so that the
result does not depend on the implementation.
"""

from __future__ import annotations

import os
import pickle
import sys
import threading
import uuid
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor, Future, as_completed
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from ..base.arguments import Array, read_only
from ..base.errors import InputError
from .criterion import Batch, Builder

if TYPE_CHECKING:
    from distributed import Client

Sums = tuple[Any, ...]
Sum = Callable[..., Sums]
"""Function of :mod:`criterion`: (batch, *arguments) → tuple of terms, each to be summed over all
batches."""
Tick = Callable[[float], None]


def _silent(share: float) -> None:
    """Do nothing: the progress callback of a fit that reports no progress.

    ``share`` is the completed share of a pass over the nodes, 0 to 1.
    """


class Batches(Protocol):
    """Interface of a set of nodes, stored in batches, over which functions are summed.

    A node is a configuration of the region Ω at which a fit evaluates its cost. A fit needs only
    this interface, so that it runs in one process or on a cluster without change.
    """

    def total(self, function: Sum, *arguments: Any) -> Sums:
        """Sum the tuples ``function(batch, *arguments)`` of all batches, item by item.

        ``function`` is one of :mod:`criterion`, such as the cost, and ``arguments`` are the
        coefficients A. The result is one tuple of sums.
        """

    def close(self) -> None:
        """Free the memory of the batches."""


class Local:
    """Batches in the memory of this process: the default, if no executor is given.

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
        """Sum the tuples ``function(batch, *arguments)`` of all batches, item by item.

        Batches that are not stored (``stream``) are built again, one after the other.
        """
        return over(self._build() if self._kept is None else self._kept, function, arguments)

    def close(self) -> None:
        """Free the memory of the batches."""
        self._kept = []

    def _build(self) -> Iterator[Batch]:
        for i, batch in enumerate(self._builder.batches(self._Q, self._weights, self._batch), 1):
            yield batch
            self._tick(min(1.0, i * self._batch / len(self._Q)))


class BarrierCost:
    """Nodes of a fit, and additional points of Ω that act as a barrier against singularities.

    The points are configurations between the nodes at which an earlier fit had det(Nᵀ V) = 0, an
    algorithmic singularity. Each is an additional node. Its cost tends to infinity as det(Nᵀ V)
    tends to 0, so that a descent stays away from a singularity there. V are the gradients of the
    potentials, and N spans the null space of J.

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
        """Add the configurations Q (K, n), near which V is singular, to the barrier points.

        V are the gradients of the potentials. The next descent keeps away from these points.
        """
        self.guards.append(Q)
        self._built.append(self._builder(Q, np.full(len(Q), self._weight)))

    def total(self, function: Sum, *arguments: Any) -> Sums:
        """Sum the tuples ``function(batch, *arguments)`` of all batches and the barrier points.

        ``function`` is one of :mod:`criterion`, such as the cost of coefficients A. The result is
        one tuple of sums, which a descent uses in place of those over the nodes alone.
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


def over(batches: Iterable[Batch], function: Sum, arguments: tuple[Any, ...]) -> Sums:
    """Sum the tuples ``function(batch, *arguments)`` of the given batches, item by item.

    This is what a worker evaluates for its own batches. It returns a tuple of the sums.
    """
    return add(function(b, *arguments) for b in batches)


# ---- in other processes, or on a cluster ----

_PIECES = 32
"""Maximum number of chunks."""

_held = threading.local()
"""State of this worker: identifier of the fit, batches by chunk number, and identifier of the last
sum that it answered."""

_Work = Callable[[Iterable[Batch]], Sums]
_Answer = tuple[str, dict[int, Sums]]
"""Name of the worker, and its sums by chunk number."""


@dataclass(frozen=True, eq=False)
@read_only
class _Piece:
    """Chunk of nodes that one worker evaluates, with the pickled builder of its batches.

    Q (K, n) are the nodes, ``weights`` (K,) their quadrature weights, and ``batch`` the nodes per
    batch. Iteration builds the batches: sending the nodes is far cheaper than sending the batches.
    """

    builder: bytes
    Q: Array
    weights: Array
    batch: int

    def __iter__(self) -> Iterator[Batch]:
        yield from pickle.loads(self.builder).batches(self.Q, self.weights, self.batch)


def hand_out(
    builder: Builder,
    Q: Array,
    weights: Array,
    batch: int,
    executor: Executor | Client,
    *,
    stream: bool,
    tick: Tick,
) -> Batches:
    """Distribute nodes to the workers of an executor or a Dask cluster, in chunks of whole batches.

    The parameters are those of :class:`Local`. A fit to many nodes, the configurations at which its
    cost is evaluated, then uses all cores.

    Raises
    ------
    InputError
        If ``executor`` is neither an Executor nor a Dask Client, or the design cannot be pickled
        for another process.
    """
    try:
        payload = pickle.dumps(builder)
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        raise InputError(
            f"the design cannot be sent to another process ({error}); "
            "write its functions at the top level of a module, "
            "not as lambdas or inside other functions"
        ) from None
    count = -(-len(Q) // batch)
    size = -(-count // min(_PIECES, count)) * batch
    pieces = [
        _Piece(payload, Q[i : i + size], weights[i : i + size], batch)
        for i in range(0, len(Q), size)
    ]
    dask = sys.modules.get("distributed")
    if dask is not None and isinstance(executor, dask.Client):
        executor = executor.get_executor(pure=False)  # never an earlier sum's result
    if not isinstance(executor, Executor):
        raise InputError(
            "executor= takes a concurrent.futures Executor or a Dask Client, "
            f"not {type(executor).__name__}"
        )
    return _InExecutor(pieces, executor, stream, tick)


class _InExecutor:
    """Batches that the workers of an executor build, evaluate and store.

    The nodes, configurations of the region, are divided into chunks (:class:`_Piece`). A worker
    that has evaluated a chunk stores its batches. For the next sum, each worker is asked for the
    chunks that it stores. Chunks that no worker returns, such as those of a worker that ended, are
    built again by any free worker. Only the computing time depends on the distribution.
    """

    def __init__(self, pieces: list[_Piece], executor: Executor, stream: bool, tick: Tick) -> None:
        self._pieces = pieces
        self._executor = executor
        self._stream = stream
        self._tick = tick
        self._run = uuid.uuid4().hex
        self._workers: set[str] = set()  # those that store chunks

    def total(self, function: Sum, *arguments: Any) -> Sums:
        """Sum the tuples ``function(batch, *arguments)`` of all batches, item by item.

        First each worker is asked for the chunks that it stores; then the missing chunks are built.
        The chunks are added in their order, so that the result does not depend on the workers.
        """
        work = partial(over, function=function, arguments=arguments)
        submit = self._executor.submit
        found: dict[int, Sums] = {}
        key = self._run, uuid.uuid4().hex
        held = [submit(_evaluate_held, key, work) for _ in self._workers]
        self._collect(held, found)
        built = [
            submit(_evaluate_piece, self._run, i, piece, self._stream, work)
            for i, piece in enumerate(self._pieces)
            if i not in found
        ]
        self._collect(built, found)
        return add(found[i] for i in range(len(self._pieces)))

    def close(self) -> None:
        """Ask the workers to free the memory of their batches."""
        for _ in self._workers:
            self._executor.submit(_forget, self._run)

    def _collect(self, futures: list[Future[_Answer]], found: dict[int, Sums]) -> None:
        try:
            for future in as_completed(futures):
                worker, parts = future.result()
                found.update(parts)
                if not self._stream:
                    self._workers.add(worker)
                self._tick(len(found) / len(self._pieces))
        finally:
            for future in futures:
                future.cancel()


# ---- what runs on a worker ----


def _evaluate_piece(run: str, number: int, piece: _Piece, stream: bool, work: _Work) -> _Answer:
    """Build the batches of a chunk, evaluate them, and store them unless ``stream`` is set.

    It runs in a worker. ``run`` identifies the fit: batches of an earlier fit are freed. ``number``
    is the chunk's, and ``work`` sums a function over batches. The result is the worker's name, and
    the sums by chunk number.
    """
    if stream:
        return _me(), {number: work(piece)}
    if getattr(_held, "run", None) != run:
        _held.run = run
        _held.batches = {}
        _held.answered = None
    if number not in _held.batches:
        _held.batches[number] = list(piece)
    return _me(), {number: work(_held.batches[number])}


def _evaluate_held(key: tuple[str, str], work: _Work) -> _Answer:
    """Evaluate the chunks that this worker stores, once per sum, so that none is built again.

    ``key`` holds the identifiers of the fit and of the sum. A second call for the same sum, which
    reached the same worker by chance, returns no sums. The result is as of :func:`_evaluate_piece`.
    """
    run, sum_id = key
    if getattr(_held, "run", None) != run or _held.answered == sum_id:
        return _me(), {}
    _held.answered = sum_id
    return _me(), {i: work(batches) for i, batches in _held.batches.items()}


def _forget(run: str) -> None:
    if getattr(_held, "run", None) == run:
        _held.run, _held.batches = None, {}


def _me() -> str:
    return f"{os.getpid()}.{threading.get_ident()}"
