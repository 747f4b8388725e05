"""Batches in other processes: any ``concurrent.futures`` executor, or a Dask cluster.

The nodes are cut into pieces. A worker that has evaluated a piece keeps its batches; at the next pass every
worker is asked for the pieces that it holds, and what is missing then (a worker died, or was not reached) is
built anew by whoever is free. Which worker does what affects only the time.
"""

from __future__ import annotations

import os
import pickle
import sys
import threading
import uuid
from collections.abc import Callable
from concurrent.futures import Executor, Future, as_completed
from typing import TYPE_CHECKING, Any

from ..arguments import Array
from ..errors import InputError
from .batches import Batches, Tick, add, cut, over
from .criterion import Batch, Builder

if TYPE_CHECKING:
    from distributed import Client


_PIECES = 32
_held = threading.local()
"""What this worker keeps: the run it belongs to, and batches by the number of their piece."""


def hand_out(
    builder: Builder,
    Q: Array,
    weights: Array,
    batch: int,
    executor: Executor | Client,
    *,
    stream: bool = False,
    tick: Tick | None = None,
) -> Batches:
    """Hand nodes out to an executor's or a cluster's workers.

    Raises
    ------
    InputError
        If the executor is neither, or the design cannot be sent to another process.
    """
    try:
        payload = pickle.dumps(builder)
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        raise InputError(
            f"the design cannot be sent to another process ({error}); "
            "write its functions at the top level of a module, not as lambdas or inside other functions"
        ) from None
    pieces = cut(Q, weights, _PIECES, batch)
    if isinstance(executor, Executor):
        return InExecutor(payload, pieces, batch, executor, stream, tick)
    if "distributed" in sys.modules and isinstance(executor, sys.modules["distributed"].Client):
        return OnCluster(payload, pieces, batch, executor, stream, tick)
    raise InputError(f"executor= takes a concurrent.futures Executor or a Dask Client, not {type(executor).__name__}")


class InExecutor:
    """Pieces evaluated by the workers of an executor, and kept there."""

    def __init__(
        self,
        payload: bytes,
        pieces: list[tuple[Array, Array]],
        batch: int,
        executor: Executor,
        stream: bool,
        tick: Tick | None,
    ) -> None:
        self._payload, self._pieces, self._batch = payload, pieces, batch
        self._executor, self._stream, self._tick = executor, stream, tick
        self._run = uuid.uuid4().hex
        self._owners: dict[str, list[int]] = {}
        self._passes = 0

    def total(self, function: Callable[..., tuple[Any, ...]], *arguments: Any) -> tuple[Any, ...]:
        """Add ``function(batch, *arguments)`` up over all batches, item by item."""
        self._passes += 1
        found: dict[int, tuple[Any, ...]] = {}
        if self._owners:
            key = (self._run, self._passes)
            self._collect(
                [self._executor.submit(_evaluate_held, key, self._owners, function, arguments) for _ in self._owners],
                found,
            )
        self._collect(
            [
                self._executor.submit(
                    _evaluate_piece,
                    self._run,
                    i,
                    self._payload,
                    *self._pieces[i],
                    self._batch,
                    self._stream,
                    function,
                    arguments,
                )
                for i in range(len(self._pieces))
                if i not in found
            ],
            found,
        )
        return add(found[i] for i in range(len(self._pieces)))

    def close(self) -> None:
        """Ask the workers to let the batches go."""
        for _ in self._owners:
            self._executor.submit(_forget, self._run)

    def _collect(self, futures: list[Future[Any]], found: dict[int, tuple[Any, ...]]) -> None:
        try:
            for future in as_completed(futures):
                owner, parts = future.result()
                found.update(parts)
                if not self._stream:
                    known = self._owners.setdefault(owner, [])
                    held = {i for pieces in self._owners.values() for i in pieces}
                    known.extend(i for i in parts if i not in held)
                if self._tick is not None:
                    self._tick(len(found) / len(self._pieces))
        finally:
            for future in futures:
                future.cancel()


class OnCluster:
    """Pieces evaluated by Dask workers; the batches are futures that stay where they were built."""

    def __init__(
        self,
        payload: bytes,
        pieces: list[tuple[Array, Array]],
        batch: int,
        client: Client,
        stream: bool,
        tick: Tick | None,
    ) -> None:
        self._client, self._tick, self._batch, self._stream = client, tick, batch, stream
        self._builder = client.scatter(payload, broadcast=True, hash=False)
        self._pieces = pieces
        self._batches: list[Any] = []
        if not stream:
            self._batches = [client.submit(_build, self._builder, Q, w, batch, pure=False) for Q, w in pieces]

    def total(self, function: Callable[..., tuple[Any, ...]], *arguments: Any) -> tuple[Any, ...]:
        """Add ``function(batch, *arguments)`` up over all batches, item by item."""
        client = self._client
        if self._stream:
            futures = [
                client.submit(_build_and_evaluate, self._builder, Q, w, self._batch, function, arguments, pure=False)
                for Q, w in self._pieces
            ]
        else:
            futures = [client.submit(over, batches, function, arguments, pure=False) for batches in self._batches]
        parts = []
        try:
            for future in futures:
                parts.append(future.result())
                if self._tick is not None:
                    self._tick(len(parts) / len(futures))
        finally:
            if len(parts) < len(futures):
                client.cancel(futures)
        return add(parts)

    def close(self) -> None:
        """Let the batches go."""
        self._batches = []


# ---- what runs on a worker ------------------------------------------------------------------------


def _build(payload: bytes, Q: Array, weights: Array, batch: int) -> list[Batch]:
    builder = pickle.loads(payload)
    return [builder(Q[i : i + batch], weights[i : i + batch]) for i in range(0, len(Q), batch)]


def _build_and_evaluate(
    payload: bytes,
    Q: Array,
    weights: Array,
    batch: int,
    function: Callable[..., tuple[Any, ...]],
    arguments: tuple[Any, ...],
) -> tuple[Any, ...]:
    builder = pickle.loads(payload)
    return add(function(builder(Q[i : i + batch], weights[i : i + batch]), *arguments) for i in range(0, len(Q), batch))


def _evaluate_piece(
    run: str,
    number: int,
    payload: bytes,
    Q: Array,
    weights: Array,
    batch: int,
    stream: bool,
    function: Callable[..., tuple[Any, ...]],
    arguments: tuple[Any, ...],
) -> tuple[str, dict[int, tuple[Any, ...]]]:
    """Build a piece, evaluate it, and keep it unless told otherwise."""
    if stream:
        return _me(), {number: _build_and_evaluate(payload, Q, weights, batch, function, arguments)}
    if getattr(_held, "run", None) != run:
        _held.run, _held.batches, _held.answered = run, {}, 0
    if number not in _held.batches:
        _held.batches[number] = _build(payload, Q, weights, batch)
    return _me(), {number: over(_held.batches[number], function, arguments)}


def _evaluate_held(
    key: tuple[str, int],
    owners: dict[str, list[int]],
    function: Callable[..., tuple[Any, ...]],
    arguments: tuple[Any, ...],
) -> tuple[str, dict[int, tuple[Any, ...]]]:
    """Evaluate the pieces that this worker holds and is asked for, once a pass."""
    run, number = key
    if getattr(_held, "run", None) != run or _held.answered == number:
        return _me(), {}
    _held.answered = number
    mine = [i for i in owners.get(_me(), ()) if i in _held.batches]
    return _me(), {i: over(_held.batches[i], function, arguments) for i in mine}


def _forget(run: str) -> None:
    if getattr(_held, "run", None) == run:
        _held.run, _held.batches = None, {}


def _me() -> str:
    return f"{os.getpid()}.{threading.get_ident()}"
