"""One object for many threads, one inverse a thread on one shared task, and results between
processes."""

from __future__ import annotations

import copy
import pickle
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from multiprocessing import get_context

import numpy as np
import pytest
from arms import Q_PANDA
from cell_functions import function_of
from controls import in_numpy, some

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


@pytest.mark.parametrize("kind", some(["axis", "pose"], "pose"))
@pytest.mark.parametrize("name", CONTROLS)
def test_one_inverse_a_thread_on_one_shared_task(
    panda: rp.Robot, q_panda, many_switches, name: str, kind: str
) -> None:
    task = panda.task("panda_hand_tcp", kind)
    potentials, r = rp.Polynomial(q_panda, 2, 0.5), task.r
    A = np.zeros((potentials.size, r))
    A[:7] = rp.redundancy.nullspace(task.jacobian(q_panda))
    h = potentials.weighted(A + 0.01 * np.random.default_rng(0).normal(size=A.shape))

    target = task.placement(q_panda)

    def work(seed: int) -> np.ndarray:
        control, rng = CONTROLS[name](task, h), np.random.default_rng(seed)
        found = [
            control.velocity(q_panda + 0.2 * rng.normal(size=7), np.ones(task.m)) for _ in range(30)
        ]
        if isinstance(control, rp.RepeatableInverse):
            starts = q_panda + 0.1 * rng.normal(size=(10, 7))
            found += [
                control.step(q, target, 0.01, leaf=control.leaf(q_panda), gain=10.0) for q in starts
            ]
        return np.array(found)

    alone = [work(seed) for seed in range(4)]
    with ThreadPoolExecutor(4) as threads:
        together = list(threads.map(work, range(4)))
    assert np.array_equal(together, alone)


@pytest.mark.slow
def test_a_copy_of_an_inverse_is_one_for_another_thread(
    panda_pose: rp.Task, q_panda, many_switches
) -> None:
    inverse = rp.ExtendedJacobian(panda_pose, q_panda)
    xdot = np.ones(6)

    def work(task: tuple[rp.RepeatableInverse, int]) -> list[np.ndarray]:
        own, seed = task
        rng = np.random.default_rng(seed)
        return [own.velocity(q_panda + 0.1 * rng.normal(size=7), xdot) for _ in range(100)]

    alone = [work((inverse, seed)) for seed in range(4)]
    with ThreadPoolExecutor(4) as threads:
        together = list(threads.map(work, [(copy.copy(inverse), seed) for seed in range(4)]))
    assert np.array_equal(together, alone)


SHARED = (
    "F",
    "a step",
    "a step in NumPy",
    "a bounded step",
    "a cell's step",
    "J⁺",
    "torques",
    "a task",
)


def shared(what: str, design: rp.Design) -> Callable[[np.ndarray], object]:
    """One object that several threads ask, as a function of seven numbers from −1 to 1."""
    inverse, task, q0 = design.inverse, design.task, Q_PANDA
    target, leaf, xdot = task.placement(q0), inverse.leaf(q0), np.ones(6)
    if what in ("F", "a cell's step"):
        F = function_of("poses")
        if what == "a cell's step":
            middle, c = F(F.cell.placement), np.zeros(1)
            return lambda x: F.inverse.step(middle + 0.01 * x, F.cell.placement, 0.01, leaf=c)
        return lambda x: F(F.cell.at(0.5 * x[:6]))
    if what == "J⁺":
        one = rp.Pseudoinverse(task)
        return lambda x: one.velocity(q0 + 0.1 * x, xdot)
    if what == "torques":
        spring = rp.LeafImpedance(inverse)
        return lambda x: spring.torque(q0 + 0.1 * x, x, target, leaf=leaf)
    if what == "a task":
        return lambda x: np.append(
            task.jacobian(q0 + 0.1 * x), task.placement(q0 + 0.1 * x).translation
        )
    law = in_numpy(inverse) if what == "a step in NumPy" else inverse

    def step(x: np.ndarray) -> np.ndarray:
        if what != "a bounded step":
            return law.step(q0 + 0.05 * x, target, 0.01, xdot, leaf=leaf, gain=20.0)
        step = law.damped_step(
            q0 + 0.05 * x, target, 0.01, leaf=leaf, velocity_limit=0.3 + abs(x[0]), damping=0.3
        )
        return np.append(step.q, [step.damping, step.slowed])

    return step


@pytest.mark.parametrize("what", SHARED)
def test_one_object_serves_many_threads(what: str, panda_design: rp.Design, many_switches) -> None:
    ask = shared(what, panda_design)
    X = np.random.default_rng(2).uniform(-1, 1, (4, 100, 7))
    alone = [[ask(x) for x in rows] for rows in X]
    with ThreadPoolExecutor(4) as threads:
        together = list(threads.map(lambda rows: [ask(x) for x in rows], X))
    assert np.array_equal(together, alone)


def refuse(center: list[float]) -> None:
    """Design over a region with a singularity of the planar arm in it: stretched."""
    task = rp.Robot.load("planar3r").task("tool", "xy")
    rp.nearest_repeatable(
        rp.Pseudoinverse(task),
        rp.Polynomial(center, 1, 0.3),
        rp.Box(center, 0.3),
        options=rp.FitOptions(samples=256),
    )


@pytest.mark.slow
def test_a_singular_region_is_told_across_processes() -> None:
    """Such an error used to make multiprocessing's pool wait for ever."""
    center = [0.3, 0.0, 0.0]
    with pytest.raises(rp.SingularRegionError) as here:
        refuse(center)
    back = pickle.loads(pickle.dumps(here.value))
    assert type(back) is rp.SingularRegionError and back.remedy == here.value.remedy
    assert str(back) == str(here.value) and np.array_equal(back.at, here.value.at)
    with get_context("spawn").Pool(1) as workers, pytest.raises(rp.SingularRegionError):
        workers.apply_async(refuse, (center,)).get(timeout=60)
