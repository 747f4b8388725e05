"""Designs of many nodes: few first, then all; progress; interruption."""

from __future__ import annotations

import gc
import weakref

import numpy as np
import pytest

import repctl_pin as rp

Q0 = np.array([0, -np.pi / 4, 0, -3 * np.pi / 4, 0, np.pi / 2, np.pi / 4])
OPTIONS = {"samples": 1024, "held_out": 256}


def design(panda: rp.Robot, *, degree=2, progress=False, box=None, **options) -> rp.Design:
    task = panda.task("panda_hand_tcp", "axis")
    return rp.nearest_repeatable(
        rp.Pseudoinverse(task),
        None,
        box or rp.Box(Q0, 0.4),
        degree=degree,
        options=rp.FitOptions(**(OPTIONS | options)),
        progress=progress,
    )


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
    """2048 nodes start from the optimum on 1024; nothing of them is left in memory."""
    box, held, built = Watched(Q0, 0.4), [], set()

    def tell(step: str, share: float) -> None:
        held.append(box.held() if step.startswith("step") else 0)
        built.update([step] if step[0].isdigit() else [])

    one = design(panda, box=box, progress=tell, samples=2048, degree=1)
    assert max(held) > 0 == box.held()
    assert one.converged and one.samples == 2048
    assert built == {"1024 nodes", "2048 nodes"}
    Q, weights = rp.Box(Q0, 0.4).nodes(2048, 0)
    away = one.inverse.batch(Q) - one.desired.batch(Q)
    cost = weights @ (away**2).sum(axis=(1, 2))  # on all of them
    assert one.fit_cost == pytest.approx(cost, rel=1e-8)


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


def test_interruption_passes_through(panda: rp.Robot) -> None:
    def stop(what: str, share: float) -> None:
        if what.startswith("step 1"):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        design(panda, progress=stop)
