"""The same design from one process, several, threads and a cluster; streaming; progress;
interruption."""

from __future__ import annotations

import multiprocessing
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import repctl_pin as rp
from repctl_pin.design import criterion, workers

Q0 = np.array([0, -np.pi / 4, 0, -3 * np.pi / 4, 0, np.pi / 2, np.pi / 4])
OPTIONS = {"samples": 1024, "held_out": 256, "batch": 128}


@pytest.fixture(scope="module")
def processes() -> Iterator[Executor]:
    with ProcessPoolExecutor(
        2, mp_context=multiprocessing.get_context("spawn")
    ) as pool:
        yield pool


def design(panda: rp.Robot, *, degree=2, progress=False, **options) -> rp.Design:
    task = panda.task("panda_hand_tcp", "axis")
    return rp.nearest_repeatable(
        rp.Pseudoinverse(task),
        None,
        rp.Box(Q0, 0.4),
        degree=degree,
        options=rp.FitOptions(**(OPTIONS | options)),
        progress=progress,
    )


@pytest.fixture(scope="module")
def alone(panda: rp.Robot) -> rp.Design:
    return design(panda)


def same(a: rp.Design, b: rp.Design) -> bool:
    return bool(
        np.abs(a.coefficients - b.coefficients).max()
        <= 1e-10 * np.abs(b.coefficients).max()
        and abs(a.cost - b.cost) <= 1e-10 * b.cost
        and a.steps == b.steps
    )


@pytest.mark.parametrize("stream", [True])
def test_processes_give_the_same_design(
    panda: rp.Robot, alone: rp.Design, processes: Executor, stream: bool
) -> None:
    assert same(design(panda, executor=processes, stream=stream), alone)


def test_threads_give_the_same_design(panda: rp.Robot, alone: rp.Design) -> None:
    with ThreadPoolExecutor(2) as pool:
        assert same(design(panda, executor=pool), alone)


def test_few_nodes_first_then_all(panda: rp.Robot, few_nodes: None) -> None:
    """2048 nodes start from the optimum on 1024; nothing is left on the worker."""
    many = {"samples": 2048, "degree": 1, "batch": 256}
    one = design(panda, **many)
    with ThreadPoolExecutor(1) as pool:
        assert same(design(panda, executor=pool, **many), one)
        assert pool.submit(lambda: dict(workers._held.batches)).result() == {}
    assert one.converged and one.samples == 2048


@pytest.mark.parametrize(
    "processes", [False, pytest.param(True, marks=pytest.mark.slow)]
)
def test_a_cluster_gives_the_same_design(
    panda: rp.Robot, alone: rp.Design, processes: bool
) -> None:
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(
            n_workers=1,
            threads_per_worker=1,
            processes=processes,
            dashboard_address=None,
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        assert same(design(panda, executor=client, stream=True), alone)


class Counting(ThreadPoolExecutor):
    """One thread, and the number of tasks that it was given."""

    def __init__(self) -> None:
        super().__init__(1)
        self.tasks = 0

    def submit(self, *task, **options):
        self.tasks += 1
        return super().submit(*task, **options)


def test_batches_stay_with_the_workers_and_are_rebuilt_when_lost(
    panda: rp.Robot,
) -> None:
    task = panda.task("panda_hand_tcp", "pose")
    box, potentials = rp.Box(Q0, 0.4), rp.Polynomial(Q0, 1, 0.4)
    N = criterion.oriented_nullspace(task.jacobian(Q0)[None], task, Q0[None])[0]
    builder = criterion.Builder(rp.Pseudoinverse(task), potentials, np.arange(7), N)
    Q, w = box.nodes(512, 0)
    with Counting() as pool:
        streamed = workers.hand_out(builder, Q, w, 64, pool, stream=True)
        assert streamed.total(criterion.cost, N) == streamed.total(criterion.cost, N)
        assert pool.tasks == 16
        batches = workers.hand_out(builder, Q, w, 64, pool)
        first = batches.total(criterion.cost, N)
        assert pool.tasks == 24
        assert batches.total(criterion.cost, N) == first
        assert pool.tasks == 25  # the worker is asked once for all that it holds
        held = pool.submit(lambda: dict(workers._held.batches)).result()
        assert sorted(held) == list(range(8)) and all(
            len(pieces) == 1 for pieces in held.values()
        )
        pool.submit(_drop_one).result()
        again = batches.total(criterion.cost, N)
        assert again == first
        kept = pool.submit(lambda: dict(workers._held.batches)).result()
        assert sum(kept[i][0] is held[i][0] for i in held) == 7 and sorted(
            kept
        ) == sorted(held)
        batches.close()
        assert pool.submit(lambda: dict(workers._held.batches)).result() == {}


class Answers:
    """A Dask client in this process: it computes at once, and says what it was asked."""

    def __init__(self) -> None:
        self.submitted: list[Any] = []
        self.cancelled: list[Any] = []

    def submit(self, function: Any, batches: Any, *, pure: bool) -> Any:
        assert not pure  # the same batches may have other coefficients
        whole = getattr(batches, "result", lambda: batches)
        future = SimpleNamespace(result=lambda: function(whole()))
        self.submitted.append(future)
        return future

    def cancel(self, futures: list[Any]) -> None:
        self.cancelled += futures


def test_a_cluster_is_asked_no_more_after_a_failure() -> None:
    """Batches are built once unless they are streamed; what a sum still waits for is cancelled."""
    pieces, told = [[1.0, 2.0], [3.0], [4.0, 5.0, 6.0]], []

    def squared(batch: float, power: int) -> tuple[float, int]:
        if power > 2 and batch == 3.0:
            raise ZeroDivisionError
        return batch**power, 1

    for stream, built in ((False, 3), (True, 0)):
        client = Answers()
        batches = workers.OnCluster(pieces, client, stream, told.append)
        assert len(client.submitted) == built
        for _ in range(2):
            assert batches.total(squared, 2) == (91.0, 6)
        assert len(client.submitted) == built + 6 and not client.cancelled
        with pytest.raises(ZeroDivisionError):
            batches.total(squared, 3)
        assert client.cancelled == client.submitted[-3:]
    assert told == 2 * [*2 * [1 / 3, 2 / 3, 1.0], 1 / 3]


def _drop_one() -> None:
    workers._held.batches.pop(3)


def test_what_cannot_be_sent_is_refused_before_any_work(
    panda_pose: rp.Task, processes: Executor
) -> None:
    desired = rp.WeightedInverse(panda_pose, lambda q: np.ones(7))
    with pytest.raises(rp.InputError, match="top level of a module"):
        rp.nearest_repeatable(
            desired,
            None,
            rp.Box(Q0, 0.3),
            degree=1,
            options=rp.FitOptions(samples=512, executor=processes),
        )
    with pytest.raises(rp.InputError, match=r"concurrent\.futures"):
        rp.nearest_repeatable(
            rp.Pseudoinverse(panda_pose),
            None,
            rp.Box(Q0, 0.3),
            degree=1,
            options=rp.FitOptions(samples=512, executor="two"),
        )


def test_an_error_on_a_worker_arrives(panda: rp.Robot, processes: Executor) -> None:
    class_free = rp.Polynomial(Q0, 1) + rp.CustomPotentials([_nan_in_a_corner])
    task = panda.task("panda_hand_tcp", "pose")
    with pytest.raises(rp.InputError, match="_nan_in_a_corner is nan"):
        rp.nearest_repeatable(
            rp.Pseudoinverse(task),
            class_free,
            rp.Box(Q0, 0.4),
            options=rp.FitOptions(
                samples=4096, held_out=64, batch=128, executor=processes
            ),
        )


def _nan_in_a_corner(q: np.ndarray) -> float:
    return float("nan") if (q - Q0)[:3].min() > 0.3 else float(q[0] ** 2)


def test_progress_is_reported(panda: rp.Robot) -> None:
    said: list[tuple[str, float]] = []
    design(panda, progress=lambda what, share: said.append((what, share)))
    assert all(0 <= share <= 1 for _, share in said)
    text = " ".join(what for what, _ in said)
    assert "1024 nodes" in text and "step 1, cost " in text and "evaluating" in text


def test_a_bar_is_drawn_on_stderr(
    panda: rp.Robot, capsys: pytest.CaptureFixture
) -> None:
    design(panda, progress=True)
    captured = capsys.readouterr()
    assert captured.out == "" and "%|" in captured.err


def test_interruption_passes_through(panda: rp.Robot, processes: Executor) -> None:
    def stop(what: str, share: float) -> None:
        if what.startswith("step 1"):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        design(panda, executor=processes, progress=stop)
    assert (
        processes.submit(abs, -1).result(timeout=30) == 1
    )  # the pool is not left clogged
