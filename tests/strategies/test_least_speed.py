"""Minimum joint speed in C: it computes wherever J has full rank, and as NumPy does."""

from __future__ import annotations

import numpy as np
import pytest
from native_library import REQUIRED

import repctl_pin as rp

pytestmark = REQUIRED

TASKS = {
    "panda": ("panda_hand_tcp",),
    "ur5": ("tool0",),
    "talos_left_arm": ("wrist_left_ft_tool_link",),
    "baxter": ("left_gripper", "right_gripper"),
    "talos": ("wrist_left_ft_tool_link", "wrist_right_ft_tool_link"),
    "centauro": ("arm1_8", "arm2_8"),
}


def configurations(task: rp.Task, count: int) -> np.ndarray:
    low, high = np.maximum(task.lower, -np.pi), np.minimum(task.upper, np.pi)
    return np.random.default_rng(1).uniform(low, high, (count, task.n))


@pytest.mark.parametrize("robot", TASKS)
def test_no_configuration_of_full_rank_is_left_to_numpy(
    robot: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Issue 56, item 32.1: with two hands, 82 to 99 % were; at random, and near singularities."""
    frames = TASKS[robot]
    task = rp.Robot.load(robot).task(frames[0] if len(frames) == 1 else list(frames))
    G, posture = rp.Pseudoinverse(task), rp.PostureControl(task, task.reference, gain=2.0)
    Q = configurations(task, 300)
    Xdot = np.random.default_rng(2).normal(size=(len(Q), task.m))

    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("NumPy was asked")

    with monkeypatch.context() as without:
        without.setattr(np.linalg, "qr", refuse)
        found = [
            (G.velocity(q, x), posture.velocity(q, x), G(q)) for q, x in zip(Q, Xdot, strict=True)
        ]
    for q, xdot, (qdot, held, matrix) in zip(Q, Xdot, found, strict=True):
        J = task.jacobian(q)
        exact = np.linalg.pinv(J, rcond=1e-14)
        z = 2.0 * (task.reference - q)
        rounding = 1e-15 * np.linalg.cond(J) * task.n
        for got, wanted in (
            (qdot, exact @ xdot),
            (held, z + exact @ (xdot - J @ z)),
            (matrix, exact),
        ):
            assert np.abs(got - wanted).max() < rounding * np.linalg.norm(exact) * 1e2
        assert np.abs(J @ qdot - xdot).max() < 1e-12 * np.linalg.norm(J) * np.linalg.norm(qdot)


def test_the_matrix_has_the_columns_of_the_velocity(panda_design: rp.Design) -> None:
    """Issue 56, item 32.3: the whole G in C, of both inverses."""
    task = panda_design.task
    for inverse in (panda_design.inverse, rp.Pseudoinverse(task)):
        for q in configurations(task, 50):
            columns = [inverse.velocity(q, x) for x in np.eye(task.m)]
            np.testing.assert_allclose(inverse(q), np.transpose(columns), rtol=1e-13, atol=1e-13)


def test_where_rank_is_lost_both_say_so() -> None:
    task = rp.Robot.load("planar3r").task("tool", "xy")
    for ask in (lambda G: G.velocity(np.zeros(3), np.ones(2)), lambda G: G(np.zeros(3))):
        with pytest.raises(rp.SingularityError, match="the Jacobian loses rank"):
            ask(rp.Pseudoinverse(task))
    with pytest.raises(rp.InputError, match="must be 3 finite numbers"):
        rp.Pseudoinverse(task)(np.full(3, np.nan))
