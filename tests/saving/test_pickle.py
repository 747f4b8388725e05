"""What a process makes another one can take: everything at the door pickles, and copies are as
good."""

from __future__ import annotations

import copy
import multiprocessing
import pickle
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from wrong_arguments import ARM_URDF

import repctl_pin as rp

Q0 = np.array([0.3, 0.8, 0.8])
FEW = {"cycles": 2, "steps": 60, "degree": 1}
ARM = Path(__file__).parents[2] / "examples" / "my_arm.urdf"


@pytest.fixture(scope="module")
def task() -> rp.Task:
    return rp.Robot.load("planar3r").task(kind="xy")


@pytest.mark.parametrize("rotation", ["fixed", "tangent"])
def test_a_path_pickles_to_the_same_curve(rotation: str) -> None:
    arm = rp.Robot.load(ARM).task()
    path = rp.circle(arm, arm.reference, 0.05, rotation=rotation)
    again = pickle.loads(pickle.dumps(path))
    assert (again.name, again.breaks, again.spec) == (path.name, path.breaks, path.spec)
    for s in (0.0, 0.123, 0.5, 0.9):
        np.testing.assert_allclose(
            again.placement(s).homogeneous, path.placement(s).homogeneous, atol=1e-11
        )
        np.testing.assert_allclose(again.twist(s), path.twist(s), atol=1e-7)
    assert copy.deepcopy(path) is path


def test_controllers_pickle_and_command_the_same(task: rp.Task) -> None:
    for one in (rp.Pseudoinverse(task), rp.PostureControl(task, Q0 + 0.1, 2.0)):
        qdot = one.velocity(Q0, [0.1, 0.05])
        for other in (pickle.loads(pickle.dumps(one)), copy.copy(one)):
            assert np.array_equal(other.velocity(Q0, [0.1, 0.05]), qdot)
    panda = rp.Robot.load("panda").task("panda_hand_tcp")
    q, h = np.array(panda.reference), rp.Polynomial(panda.reference, 1)
    inverse = rp.RepeatableInverse(panda, h.weighted(np.eye(7)[:, :1]))
    spring = rp.LeafImpedance(inverse)
    again = pickle.loads(pickle.dumps(spring))
    moved = q, np.full(7, 0.1), panda.placement(q + 0.05)
    torque = spring.torque(*moved, leaf=inverse.leaf(q))
    assert np.abs(torque).max() > 1.0
    assert np.array_equal(again.torque(*moved, leaf=inverse.leaf(q)), torque)


def test_motions_pickle_with_their_figures(task: rp.Task) -> None:
    corners = rp.polygon(task, Q0, [[0.1, 0, 0], [0.1, 0.1, 0]])
    motion = rp.follow(rp.Pseudoinverse(task), corners, Q0, cycles=2, steps=24)
    again = pickle.loads(pickle.dumps(motion))
    assert np.array_equal(again.q, motion.q) and np.array_equal(again.drift, motion.drift)
    assert again.tracking_error == pytest.approx(motion.tracking_error, abs=1e-9)
    timed = rp.timed(motion, rp.Limits(acceleration=10.0), rate=100.0)
    once_more = pickle.loads(pickle.dumps(timed))
    assert np.array_equal(once_more.q, timed.q) and once_more.duration == timed.duration


def test_paths_of_several_frames_pickle() -> None:
    robot = rp.Robot.load("talos")
    hands = robot.task(["gripper_left_base_link", "gripper_right_base_link"])
    square = [[0.1, 0, 0], [0.1, 0.1, 0]]
    path = rp.several_paths(
        hands, hands.reference, [lambda task, q0: rp.polygon(task, q0, square), None]
    )
    again = pickle.loads(pickle.dumps(path))
    assert (again.name, again.breaks, again.period) == (path.name, path.breaks, path.period)
    for s in (0.0, 0.4, 0.9):
        np.testing.assert_allclose(again.twist(s), path.twist(s), atol=1e-9)


def fresh(work: Callable[..., Any], *given: Any, **options: Any) -> Any:
    """The result of a fresh process, which has none of the quick choices of this room's tests."""
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        return pool.submit(work, *given, **options).result(timeout=300)


@pytest.mark.slow
def test_surveys_send_whole_results_from_another_process(task: rp.Task) -> None:
    """Issue 56, item 8: fresh processes make a study, the same in each, and an audit."""
    arm = rp.Robot.load("planar3r").task("tool", "xy")
    t = np.arange(0.0, 40.0, 0.01)
    q = Q0 + 0.2 * np.sin(2 * np.pi * t / 5.0)[:, None] + 0.002 * t[:, None] * [1, -2, 1]
    study, again = (fresh(rp.study, "planar3r", **FEW) for _ in range(2))
    assert study.summary() == again.summary()
    assert np.array_equal(study.rows[-1].motion.q, again.rows[-1].motion.q)
    assert fresh(rp.audit, (t, q), arm).summary() == rp.audit((t, q), arm).summary()


@pytest.mark.slow
def test_a_survey_sends_best_cells_from_another_process() -> None:
    """As above; the quick twin pickles a cell that was not searched for."""
    arm = rp.Robot.load("planar3r").task("tool", "xy")
    best = fresh(rp.best_cell, arm, 0.1)
    assert repr(best) == repr(rp.best_cell(arm, 0.1))


def test_a_best_cell_pickles(task: rp.Task) -> None:
    cell = rp.Cell(task, task.placement(Q0), 0.1)
    best = rp.BestCell(cell, Q0, 0.5, 0.1, "a corner")
    again = pickle.loads(pickle.dumps(best))
    assert repr(again) == repr(best) and again.reason == best.reason
    assert np.array_equal(again.posture, Q0)
    assert np.array_equal(again.cell.at([1, 1]).homogeneous, cell.at([1, 1]).homogeneous)


def test_bodies_pickle_and_measure_the_same(tmp_path: Path) -> None:
    file = tmp_path / "arm.urdf"
    file.write_text(ARM_URDF, encoding="utf-8")
    bodies = rp.Bodies(rp.Robot.load(file).task())
    assert bodies.pairs
    again = pickle.loads(pickle.dumps(bodies))
    q = np.array(bodies.task.reference)
    assert again.pairs == bodies.pairs and again.nearest(q) == bodies.nearest(q)
    assert copy.deepcopy(bodies).pairs == bodies.pairs


def test_a_timed_motion_that_would_fill_the_memory_is_refused_before_it_is_sampled(
    task: rp.Task,
) -> None:
    motion = rp.follow(rp.Pseudoinverse(task), rp.circle(task, Q0, 0.1), Q0, cycles=2, steps=24)
    duration = rp.timed(motion, rp.Limits(acceleration=1e-8), rate=1.0).duration
    with pytest.raises(rp.InputError, match="more than 2,000,000 samples; lower the rate"):
        rp.timed(motion, rp.Limits(acceleration=1e-8), rate=2_100_000 / duration)
