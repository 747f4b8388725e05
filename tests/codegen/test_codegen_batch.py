"""F in lanes: many poses at once in C give Python's numbers, on every arm, leaf and number of
threads."""

from __future__ import annotations

import numpy as np
import pytest
from cell_functions import f_in_numpy, function_of
from controls import NEEDS_C, own_cache  # noqa: F401

import repctl_pin as rp

pytestmark = pytest.mark.as_shipped
EXACT = 2e-12  # axis tasks: 1.3e-12 on one arm of twelve
ARMS = (
    ("panda", "panda_hand_tcp", "pose"),
    ("xarm7", "link_eef", "pose"),
    ("baxter", "left_gripper", "pose"),
    ("centauro", "arm1_8", "pose"),
    ("tiago", "wrist_ft_tool_link", "pose"),
    ("pr2", "r_gripper_tool_frame", "pose"),
    ("talos", "wrist_left_ft_tool_link", "pose"),
    ("kinova", "j2s6s200_end_effector", "axis"),
    ("ur5", "tool0", "axis"),
    ("so101", "gripper_frame_link", "position"),
    ("z1", "gripperStator", "xz"),
    ("planar4r", "tool", "xy"),
)


def function_on(name: str, frame: str, kind: str) -> rp.InverseFunction:
    """A function over a small cell about a regular configuration of an arm."""
    task, rng = rp.Robot.load(name).task(frame, kind), np.random.default_rng(0)
    low, high = np.maximum(task.lower, -2), np.minimum(task.upper, 2)
    Q = low + (high - low) * rng.uniform(0.1, 0.9, (256, task.n))
    q = Q[np.argmin(np.linalg.cond(task.jacobians(Q)))]
    cell = rp.Cell(task, task.placement(q), 0.03, 0.1 if kind in ("pose", "axis") else 0.0)
    found = rp.nearest_inverse_function(
        rp.Pseudoinverse(task),
        cell,
        posture=q,
        degree=3 if cell.k > 3 else 5,
        options=rp.FitOptions(samples=256, held_out=64),
    )
    return found.function


@NEEDS_C
@pytest.mark.slow
@pytest.mark.parametrize(("name", "frame", "kind"), ARMS, ids=[arm[0] for arm in ARMS])
def test_batches_are_pythons_on_twelve_arms(name: str, frame: str, kind: str) -> None:
    function = function_on(name, frame, kind)
    slow, U = f_in_numpy(function), function.cell.sample(2000)
    for leaf in (None, np.full(function.task.r, 0.05)):
        expected = slow.batch(U, leaf=leaf)
        away = np.abs(function.batch(U, leaf=leaf) - expected).max()
        one = [function(function.cell.at(u), leaf=leaf) for u in U[:200]]
        alone = np.abs(np.array(one) - expected[:200]).max()
        print(f"{name}, leaf {leaf}: batch {away:.1e}, one by one {alone:.1e}")
        assert max(away, alone) < EXACT


@NEEDS_C
def test_threads_and_odd_counts_give_the_same_numbers() -> None:
    """Lanes hold eight poses: any count, order and number of threads gives the same q."""
    function = function_of("poses of one orientation")
    slow, U = f_in_numpy(function), 0.8 * function.cell.sample(1027)
    whole, expected = function.batch(U), slow.batch(U[:64])
    assert np.abs(whole[:64] - expected).max() < EXACT
    assert np.array_equal(function.batch(U, threads=3), whole)
    for count in (1, 7, 8, 9):
        assert np.array_equal(function.batch(U[:count]), whole[:count])
    assert np.array_equal(function.batch(U[::-1]), whole[::-1])


@NEEDS_C
def test_one_bad_target_in_a_batch_is_named() -> None:
    function = function_of("poses of one orientation")
    slow, U = f_in_numpy(function), 0.5 * function.cell.sample(20)
    targets = [function.cell.at(u) for u in U]
    targets[13] = function.cell.at([3.0] * function.cell.k)
    for one in (function, slow):
        with pytest.raises(rp.InputError, match="13"):
            one.batch(targets, threads=2)
    with pytest.raises(rp.InputError, match="threads"):
        function.batch(U, threads=0)
