"""Formulas that a quick look would let pass if they were a little wrong, each against its closed
form."""

from __future__ import annotations

import sys
from collections.abc import Callable

import numpy as np
import pytest
import threadpoolctl
from threadpoolctl import threadpool_info, threadpool_limits

import repctl_pin as rp


def test_a_limit_weight_is_its_formula(panda_pose: rp.Task) -> None:
    quarter = panda_pose.lower + 0.25 * (panda_pose.upper - panda_pose.lower)
    near, far = (1 + (share / 0.4) ** 2 for share in (0.5, 1.5))  # shares of half the range
    assert rp.LimitWeight(panda_pose, 0.6, 0.4)(quarter) == pytest.approx(
        1 + 0.6 * (near**-2 + far**-2)
    )
    assert np.array_equal(
        rp.LimitWeight(panda_pose)(quarter), rp.LimitWeight(panda_pose, 1.0, 0.1)(quarter)
    )


def test_the_standard_error_is_widened_as_students() -> None:
    """Of 32 sets of held-out nodes, as the region was asked for them; 31 degrees of freedom."""
    drawn: list[np.ndarray] = []

    class Noted(rp.Box):
        def random(self, count: int, seed: int) -> np.ndarray:
            drawn.append(super().random(count, seed))
            return drawn[-1]

    q = np.array([0.3, 1.0, 0.8])
    task = rp.Robot.load("planar3r").task("tool", "xy")
    made = rp.nearest_repeatable(
        rp.Pseudoinverse(task),
        rp.Polynomial(q, 1, 0.4),
        Noted(q, 0.4),
        options=rp.FitOptions(samples=64, held_out=1024),
    )
    sets = [Q for Q in drawn if len(Q) == 1024 // 32][-32:]
    costs = [
        ((made.inverse.batch(Q) - made.desired.batch(Q)) ** 2).sum(axis=(1, 2)).mean() for Q in sets
    ]
    assert made.cost == pytest.approx(np.mean(costs), rel=1e-12)
    plain = np.std(costs, ddof=1) / np.sqrt(32)
    assert made.cost_error == pytest.approx(plain * np.sqrt(31 / 29), rel=1e-9)


def test_a_workspace_box_weighs_by_the_coarea_formula() -> None:
    task = rp.Robot.load("planar3r").task("tool", "xy")
    q = np.array([0.3, 1.0, 0.8])
    region = rp.WorkspaceBox(task, task.placement(q).translation[:2], 0.4, within=rp.Box(q, 0.5))
    Q = region.random(64, 0)
    volume = [np.sqrt(np.linalg.det(J @ J.T)) for J in task.jacobians(Q)]
    assert region.weights(Q) == pytest.approx(np.array(volume) / np.sum(volume))


def test_blas_libraries_are_searched_again_after_an_import(monkeypatch: pytest.MonkeyPatch) -> None:
    searched: list[int] = []

    class Counted(threadpoolctl.ThreadpoolController):
        def __init__(self) -> None:
            searched.append(len(sys.modules))
            super().__init__()

    def limited() -> None:
        with pytest.raises(rp.InputError):
            rp.nearest_repeatable(None, None, None)  # type: ignore[arg-type]

    limited()  # imports all that it needs
    monkeypatch.setattr(threadpoolctl, "ThreadpoolController", Counted)
    for name in ("one more", "one more", "two more"):
        monkeypatch.setitem(sys.modules, name, threadpoolctl)
        limited()
    assert len(searched) == 2


def test_blas_keeps_to_one_thread_and_is_given_back() -> None:
    def threads() -> list[int]:
        return [pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"]

    def design(progress: Callable[..., None]) -> None:
        rp.nearest_repeatable(
            rp.Pseudoinverse(task),
            None,
            rp.Box([0.3, 1.0, 0.8], 0.2),
            degree=1,
            options=rp.FitOptions(samples=64, held_out=64),
            progress=progress,
        )

    task = rp.Robot.load("planar3r").task("tool", "xy")
    before, inner = threads(), []
    outer: list[int] = []

    def another(*_: object) -> None:
        """Make a design inside a design: the first to end gives nothing back."""
        if not inner:
            design(lambda *_: inner.extend(threads()))
        outer.extend(threads())

    with threadpool_limits(2, user_api="blas"):
        two = threads()
        design(another)
        assert threads() == two
    assert set(inner) == set(outer) == {1} and threads() == before
