"""The repeatability benchmark: its tables are its own, and its loops do what they are said to
do."""

from __future__ import annotations

import importlib
import itertools
from pathlib import Path
from types import ModuleType

import numpy as np
import pinocchio as pin
import pytest

import repctl_pin as rp

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "tests" / "benchmarks" / "repeatability"


def module(name: str, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(FOLDER))
    return importlib.import_module(name)


@pytest.mark.parametrize("page", ["docs/benchmark.md", "docs/which.md"])
def test_the_tables_are_those_of_the_numbers(page: str, monkeypatch: pytest.MonkeyPatch) -> None:
    pages = module("pages", monkeypatch)
    rows, said = pages.read()
    text = (ROOT / page).read_text(encoding="utf-8")
    assert "<!-- benchmark: " in text and len(rows) > 100
    assert pages.filled(text, rows, said) == text


@pytest.fixture
def scenes(panda_pose: rp.Task, monkeypatch: pytest.MonkeyPatch) -> list:
    return module("scenes", monkeypatch).scenes_of("panda", panda_pose, 100)


@pytest.mark.slow
def test_both_starts_are_on_the_path(scenes: list) -> None:
    """And half a radian apart; the last target is the start."""
    for on, off in zip(scenes[::2], scenes[1::2], strict=True):
        for scene in (on, off):
            assert np.abs(scene.task.error(scene.q0, scene.targets[-1])).max() < 1e-9
        assert 0.4 < np.linalg.norm(on.q0 - off.q0) < 0.6
        assert np.array_equal(off.posture, on.q0)


@pytest.mark.slow
def test_what_the_loops_do_on_the_circle(
    scenes: list, panda_design: rp.Design, monkeypatch: pytest.MonkeyPatch
) -> None:
    """J⁺ drifts as rp.follow says; the repeatable inverse adds nothing in its second cycle."""
    ours, cycles, scene = (module("ours", monkeypatch), module("cycles", monkeypatch), scenes[0])
    loops = {
        "pinv": ours.pinv_loop(scene),
        "program": ours.quadratic_program(scene),
        "ours": ours.repeatable(scene, panda_design.inverse),
    }
    found = {name: cycles.joints_of(step, scene, 2)[0] for name, step in loops.items()}
    rows = {
        name: cycles.measure(scene, name, Q, found["pinv"], 0.0, "") for name, Q in found.items()
    }
    path = rp.circle(scene.task, scene.q0, 0.1, start_angle=np.pi)
    exact = rp.follow(rp.Pseudoinverse(scene.task), path, scene.q0, cycles=1, steps=200)
    assert rows["pinv"].drift_1 == pytest.approx(exact.drift[0], rel=0.02)
    assert rows["ours"].drift_1 < 1e-3 and rows["ours"].last_cycle < 1e-9
    assert rows["program"].last_cycle < 1e-3 < rows["pinv"].last_cycle
    assert all(row.tracking < 1e-3 and row.limit_margin > 0 for row in rows.values())


@pytest.mark.slow
def test_a_program_that_stops_is_said_to_have_stopped(
    scenes: list, monkeypatch: pytest.MonkeyPatch
) -> None:
    cycles = module("cycles", monkeypatch)

    def step(q: np.ndarray, target: object) -> np.ndarray:
        raise RuntimeError("out of reach")

    Q, said = cycles.joints_of(step, scenes[0], 1)
    assert len(Q) == 1 and said == "cycle 1: RuntimeError: out of reach"


def test_paths_of_torm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Issue 37, item 24: closed, with the lengths of CppFlow's files, inside the limits."""
    torm, robots = module("torm", monkeypatch), module("robots", monkeypatch)
    task = robots.chain_task("fetch", *torm.fetch_joints(), tmp_path)
    assert task.placement(np.zeros(7)).translation == pytest.approx([1.1281, 0, 0.78601])
    expected = {"circle": (1.57, 0), "square": (1.52, 0), "rotation": (0, 2 * np.pi)}
    for scene, (length, turn) in zip(torm.scenes_of(task, 1000), expected.values(), strict=True):
        assert scene.dt == 0.02
        assert np.abs(task.error(scene.q0, scene.targets[-1])).max() < 1e-9
        assert task.limit_margin(scene.q0).min() > 0
        poses = [scene.targets[-1], *scene.targets]
        moves = [pin.log6(a.actInv(b)) for a, b in itertools.pairwise(poses)]
        sums = [
            sum(np.linalg.norm(part) for part in parts)
            for parts in zip(*((m.linear, m.angular) for m in moves), strict=True)
        ]
        assert sums == pytest.approx([length, turn], abs=5e-3)
    assert scene.targets[124].rotation == pytest.approx(
        pin.exp3(np.array([0, np.pi / 4, 0])), abs=1e-9
    )


def test_other_tables_leave_the_six_arms_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Issue 37, item 24: five more arms and the paths of TORM do not enter the medians."""
    pages = module("pages", monkeypatch)
    rows, _ = pages.read()
    six = [row for row in rows if row.arm in pages.ARMS]
    ours, alone = pages.tables(rows), pages.tables(six)
    names = ("short", "on", "off", "lag", "arms", "times")
    assert len(six) < len(rows)
    assert all(ours[name] == alone[name] for name in names)
