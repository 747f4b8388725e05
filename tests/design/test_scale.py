"""The same design from one process, several, threads and a cluster; streaming; progress;
interruption."""

from __future__ import annotations

import gc
import multiprocessing
import weakref
from collections.abc import Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest

import repctl_pin as rp

Q0 = np.array([0, -np.pi / 4, 0, -3 * np.pi / 4, 0, np.pi / 2, np.pi / 4])
OPTIONS = {"samples": 1024, "held_out": 256, "batch": 128}


@pytest.fixture(scope="module")
def processes() -> Iterator[Executor]:
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn")) as pool:
        yield pool


def design(
    panda: rp.Robot, *, degree=2, progress=False, potentials=None, box=None, **options
) -> rp.Design:
    task = panda.task("panda_hand_tcp", "axis")
    return rp.nearest_repeatable(
        rp.Pseudoinverse(task),
        potentials,
        box or rp.Box(Q0, 0.4),
        degree=degree,
        options=rp.FitOptions(**(OPTIONS | options)),
        progress=progress,
    )


@pytest.fixture(scope="module")
def alone(panda: rp.Robot) -> rp.Design:
    return design(panda)


def same(a: rp.Design, b: rp.Design) -> bool:
    return bool(
        np.abs(a.coefficients - b.coefficients).max() <= 1e-10 * np.abs(b.coefficients).max()
        and abs(a.cost - b.cost) <= 1e-10 * b.cost
        and a.steps == b.steps
    )


@pytest.mark.parametrize("stream", [True])
def test_processes_give_the_same_design(
    panda: rp.Robot, alone: rp.Design, processes: Executor, stream: bool
) -> None:
    assert same(design(panda, executor=processes, stream=stream), alone)


def test_threads_give_the_same_design(panda: rp.Robot, alone: rp.Design) -> None:
    shares: list[float] = []

    def tell(step: str, share: float) -> None:
        if step == "1024 nodes":
            shares.append(share)

    with ThreadPoolExecutor(2) as pool:
        assert same(design(panda, executor=pool, progress=tell), alone)
    assert set(shares) <= set(np.arange(9) / 8)  # of eight chunks
    assert shares[:8] == list(np.arange(1, 9) / 8) and shares.count(1.0) > alone.steps


class Watched(rp.Box):
    """A box that knows which arrays of weights of its nodes are still in memory."""

    def nodes(self, count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
        Q, weights = super().nodes(count, seed)
        weights = np.array(weights)
        self.__dict__.setdefault("alive", []).append(weakref.ref(weights))
        return Q, weights

    def held(self) -> int:
        gc.collect()
        return sum(one() is not None for one in self.__dict__["alive"])


@pytest.mark.slow
def test_few_nodes_first_then_all(panda: rp.Robot, few_nodes: None) -> None:
    """2048 nodes start from the optimum on 1024; nothing is left on the worker."""
    many = {"samples": 2048, "degree": 1, "batch": 256}
    one = design(panda, **many)
    box, held, built = Watched(Q0, 0.4), [], set()

    def tell(step: str, share: float) -> None:
        held.append(box.held() if step.startswith("step") else 0)
        built.update([step] if step[0].isdigit() else [])

    with ThreadPoolExecutor(1) as pool:
        assert same(design(panda, box=box, executor=pool, progress=tell, **many), one)
        pool.submit(abs, -1).result()  # after what the design still asked of it
        assert max(held) > 0 == box.held()
    assert one.converged and one.samples == 2048
    assert built == {"1024 nodes", "2048 nodes"}
    Q, weights = rp.Box(Q0, 0.4).nodes(2048, 0)
    away = one.inverse.batch(Q) - one.desired.batch(Q)
    cost = weights @ (away**2).sum(axis=(1, 2))  # on all of them
    assert one.fit_cost == pytest.approx(cost, rel=1e-8)


@pytest.mark.parametrize("processes", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_a_cluster_gives_the_same_design(
    panda: rp.Robot, alone: rp.Design, processes: bool
) -> None:
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=1, processes=processes, dashboard_address=None
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        for stream in (False, True):
            assert same(design(panda, executor=client, stream=stream), alone)


class Counting(Executor):
    """One thread, and the number of tasks that it was given; as often as asked, it is another
    thread, and what the last one held is lost."""

    def __init__(self, life: float = np.inf) -> None:
        self.tasks, self.life, self.thread = 0, life, ThreadPoolExecutor(1)

    def submit(self, *task, **options):
        self.tasks += 1
        if self.tasks % self.life == 0:
            self.thread.shutdown()
            self.thread = ThreadPoolExecutor(1)
        return self.thread.submit(*task, **options)


class Gradients(rp.Joined):
    """A basis that counts the calls of its gradients with so many nodes."""

    calls: ClassVar[list[int]] = []

    def gradients(self, Q: np.ndarray) -> np.ndarray:
        self.calls.append(len(Q))
        return super().gradients(Q)


def test_batches_stay_with_the_workers_and_are_rebuilt_when_lost(panda: rp.Robot) -> None:
    """A worker is asked once for all that it holds. What one that ended held is built again."""
    found, tasks, built = [], [], []
    for life, stream in ((np.inf, False), (np.inf, True), (11, False)):
        pool = Counting(life)
        Gradients.calls.clear()
        basis = Gradients(rp.Polynomial(Q0, 1, 0.4))
        found.append(
            design(
                panda,
                degree=None,
                potentials=basis,
                samples=512,
                batch=64,
                executor=pool,
                stream=stream,
            )
        )
        tasks.append(pool.tasks)
        built.append(Gradients.calls.count(64))
    assert same(found[1], found[0]) and same(found[2], found[0])
    sums = built[1] // 8  # a stream builds its eight batches for each sum
    assert built[1] == 8 * sums and sums > 4 and tasks[1] == 8 * sums
    assert built[0] == 8 and 0 < tasks[0] - (8 + sums - 1) < 3  # and to forget them
    assert 8 < built[2] < built[1] and tasks[2] > tasks[0]


def test_many_batches_are_sent_in_at_most_32_chunks() -> None:
    """64 batches in pairs, for each sum; the workers build them again for each."""
    task = rp.Robot.load("planar3r").task(None, "xy")
    center = np.array([0.3, 1.0, 0.8])
    pool, found = Counting(), []
    Gradients.calls.clear()
    for executor in (None, pool):
        found.append(
            rp.nearest_repeatable(
                rp.Pseudoinverse(task),
                Gradients(rp.Polynomial(center, 1)),
                rp.Box(center, 0.3),
                options=rp.FitOptions(
                    samples=512, held_out=64, batch=8, executor=executor, stream=True
                ),
            )
        )
    assert same(found[1], found[0])
    sums, left = divmod(Gradients.calls.count(8), 2 * 64)  # of both fits
    assert left == 0 and pool.tasks == 32 * sums and sums > 4


def test_what_a_failed_sum_still_waits_for_is_cancelled(panda: rp.Robot) -> None:
    """Of eight chunks the first is evaluated, and then the user stops the fit."""
    futures: list[Future] = []

    class Slow(Executor):
        def submit(self, function: Any, /, *arguments: Any, **_: Any) -> Future:
            futures.append(Future())
            if len(futures) == 1:
                futures[0].set_result(function(*arguments))
            return futures[-1]

    def stop(step: str, share: float) -> None:
        if step == "1024 nodes":
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        design(panda, executor=Slow(), progress=stop)
    assert [one.cancelled() for one in futures[:8]] == [False, *[True] * 7]


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


def test_an_executor_of_another_kind_is_refused(panda: rp.Robot) -> None:
    """It has a submit of its own, which nothing says how to wait for."""
    other = SimpleNamespace(submit=lambda *_: None)
    with pytest.raises(rp.InputError, match="Executor or a Dask Client, not Simple"):
        design(panda, executor=other)


def test_an_error_on_a_worker_arrives(panda: rp.Robot, processes: Executor) -> None:
    class_free = rp.Polynomial(Q0, 1) + rp.CustomPotentials([_nan_in_a_corner])
    task = panda.task("panda_hand_tcp", "pose")
    with pytest.raises(rp.InputError, match="_nan_in_a_corner must be one finite number"):
        rp.nearest_repeatable(
            rp.Pseudoinverse(task),
            class_free,
            rp.Box(Q0, 0.4),
            options=rp.FitOptions(samples=4096, held_out=64, batch=128, executor=processes),
        )


def _nan_in_a_corner(q: np.ndarray) -> float:
    """Not at the 512 nodes that choose the potentials, but at three of the 4096 of the fit."""
    return float("nan") if (q - Q0)[:3].min() > 0.33 else float(q[0] ** 2)


def test_progress_is_reported(panda: rp.Robot, capsys: pytest.CaptureFixture) -> None:
    said: list[tuple[str, float]] = []
    design(panda, progress=lambda what, share: said.append((what, share)))
    assert all(0 <= share <= 1 for _, share in said)
    written = capsys.readouterr()
    assert (written.out, written.err) == ("", "")
    text = " ".join(what for what, _ in said)
    assert "1024 nodes" in text and "step 1" in text and "evaluating" in text
    begins = [share for what, share in said if what.startswith(("search", "evalu"))]
    assert begins == [0.0, 0.0]


def test_all_steps_of_a_fit_are_counted() -> None:
    """Those of the coarse descent and of the fine one; a step that is not kept is not told."""
    task = rp.Robot.load("planar3r").task(None, "xy")
    told: list[str] = []
    found = rp.nearest_repeatable(
        rp.Pseudoinverse(task),
        None,
        rp.Box([0.3, 1.0, 0.8], 0.3),
        degree=2,
        options=rp.FitOptions(samples=125, held_out=64, tolerance=1e-10),
        progress=lambda what, _: told.append(what),
    )
    steps = [what for what in told if what.startswith("step ")]
    starts = [what for what in steps if what == "step 0"]
    assert len(starts) == 2  # one descent each, to the coarse tolerance and to the fine
    assert len(steps) - len(starts) <= found.steps <= len(steps) + 2


def test_a_bar_is_drawn_on_stderr(panda: rp.Robot, capsys: pytest.CaptureFixture) -> None:
    task, few = panda.task("panda_hand_tcp", "pose"), rp.FitOptions(samples=64)
    desired, box = rp.Pseudoinverse(task), rp.Box(Q0, 0.2)
    rp.nearest_repeatable(desired, None, box, degree=1, options=few)
    assert capsys.readouterr().err == ""  # only if asked for
    design(panda, progress=True)
    captured = capsys.readouterr()
    assert captured.out == "" and "%|" in captured.err


def test_interruption_passes_through(panda: rp.Robot, processes: Executor) -> None:
    def stop(what: str, share: float) -> None:
        if what.startswith("step 1"):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        design(panda, executor=processes, progress=stop)
    assert processes.submit(abs, -1).result(timeout=30) == 1  # the pool is not left clogged
