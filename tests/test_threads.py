"""One inverse a thread on one shared task, and results that cross from process to process."""

from __future__ import annotations

import copy
import pickle
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context

import numpy as np
import pytest

import repctl_pin as rp


@pytest.fixture
def many_switches() -> Iterator[None]:
    """Let threads take turns as often as they can, so that what they share shows."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(before)


CONTROLS = {
    "J⁺": lambda task, h: rp.Pseudoinverse(task),
    "J⁺, weighted": lambda task, h: rp.WeightedInverse(task, "inertia"),
    "posture": lambda task, h: rp.PostureControl(task, task.reference),
    "extended": lambda task, h: rp.ExtendedJacobian(task, task.reference),
    "repeatable": rp.RepeatableInverse,
    "custom": lambda task, h: rp.CustomInverse(task, rp.Pseudoinverse(task)),
}


@pytest.mark.parametrize("kind", ["axis", "pose"])
@pytest.mark.parametrize("name", CONTROLS)
def test_one_inverse_a_thread_on_one_shared_task(panda: rp.Robot, q_panda, many_switches, name: str, kind: str) -> None:
    task = panda.task("panda_hand_tcp", kind)
    fields, r = rp.Polynomial(q_panda, 2, 0.5), task.r
    A = np.zeros((fields.size, r))
    A[:7] = rp.redundancy.nullspace(task.jacobian(q_panda))
    h = fields.weighted(A + 0.01 * np.random.default_rng(0).normal(size=A.shape))

    target = task.placement(q_panda)

    def work(seed: int) -> np.ndarray:
        control, rng = CONTROLS[name](task, h), np.random.default_rng(seed)
        found = [control.velocity(q_panda + 0.2 * rng.normal(size=7), np.ones(task.m)) for _ in range(150)]
        if isinstance(control, rp.RepeatableInverse):
            starts = q_panda + 0.1 * rng.normal(size=(50, 7))
            found += [control.step(q, target, 0.01, leaf=control.leaf(q_panda), gain=10.0) for q in starts]
        return np.array(found)

    alone = [work(seed) for seed in range(4)]
    with ThreadPoolExecutor(4) as threads:
        together = list(threads.map(work, range(4)))
    assert np.array_equal(together, alone)


def test_a_copy_of_an_inverse_is_one_for_another_thread(panda_pose: rp.Task, q_panda, many_switches) -> None:
    inverse = rp.ExtendedJacobian(panda_pose, q_panda)
    xdot = np.ones(6)

    def work(task: tuple[rp.RepeatableInverse, int]) -> list[np.ndarray]:
        own, seed = task
        rng = np.random.default_rng(seed)
        return [own.velocity(q_panda + 0.1 * rng.normal(size=7), xdot) for _ in range(300)]

    alone = [work((inverse, seed)) for seed in range(4)]
    with ThreadPoolExecutor(4) as threads:
        together = list(threads.map(work, [(copy.copy(inverse), seed) for seed in range(4)]))
    assert np.array_equal(together, alone)


def refuse(center: list[float]) -> None:
    """Design over a region with a singularity of the planar arm in it: stretched."""
    task = rp.Robot.load("planar3r").task("tool", "xy")
    rp.nearest_repeatable(rp.Pseudoinverse(task), rp.Polynomial(center, 1, 0.3), rp.Box(center, 0.3), samples=256)


def test_a_singular_region_is_told_across_processes() -> None:
    """Such an error used to break a process pool, and to make multiprocessing's wait for ever."""
    center = [0.3, 0.0, 0.0]
    with pytest.raises(rp.SingularRegionError) as here:
        refuse(center)
    back = pickle.loads(pickle.dumps(here.value))
    assert type(back) is rp.SingularRegionError and str(back) == str(here.value)
    assert back.finding == here.value.finding and np.array_equal(back.at, here.value.at)
    assert str(back.with_remedy("try")) == str(here.value.with_remedy("try"))
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        error = pool.submit(refuse, center).exception(timeout=60)
    assert isinstance(error, rp.SingularRegionError) and str(error) == str(here.value)
    with get_context("spawn").Pool(1) as workers, pytest.raises(rp.SingularRegionError):
        workers.apply_async(refuse, (center,)).get(timeout=60)
