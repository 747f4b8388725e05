"""Motions as a page, from Python: what is on it, kept, shown, and refused."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from commands import computed_once, main
from page_file import BLUE, GREEN, ORANGE, VERMILLION, panes, read
from two_armed import Q0, two_armed

import repctl_pin as rp


@pytest.fixture(scope="module")
def motions() -> dict[str, rp.Motion]:
    """A circle and a square of a planar arm, under J⁺."""
    task = rp.Robot.load("planar3r").task(kind="xy")
    q0 = np.array([0.3, 0.8, 0.8])
    plain = rp.Pseudoinverse(task)
    paths = (
        rp.circle(task, q0, 0.2),
        rp.polygon(task, q0, [[0.2, 0, 0], [0.2, 0.2, 0], [0, 0.2, 0]]),
    )
    return {
        name: rp.follow(plain, path, q0, cycles=2, steps=40)
        for name, path in zip("ab", paths, strict=True)
    }


def test_every_motion_and_every_path_is_on_the_page(motions: dict[str, rp.Motion]) -> None:
    scene, _, numbers = read(rp.animation(motions, seconds=2.0).page)
    assert [(arm["label"], arm["drift"]) for arm in scene["arms"]] == [
        (k, m.drift.tolist()) for k, m in motions.items()
    ]
    assert (
        len({arm["color"] for arm in scene["arms"]}) == 2
        and scene["seconds"] == 2.0
        and scene["planar"]
    )
    lines = [motion.path.points() for motion in motions.values()]
    assert scene["paths"] == [len(line) for line in lines]
    np.testing.assert_allclose(np.vstack(panes(scene, numbers)[1]), np.vstack(lines), atol=1e-6)
    assert scene["title"] == "planar3r: circle of radius 0.2 m in xy and polygon"
    # the same path twice is drawn once, a frame that two motions move leaves one trace in each arm
    again, _, _ = read(rp.animation({"a": motions["a"], "again": motions["a"]}).page)
    assert again["paths"] == [len(lines[0])] and [arm["chains"] for arm in again["arms"]] == [1, 1]


def test_who_creeps_is_warm_and_who_comes_back_is_cool(motions: dict[str, rp.Motion]) -> None:
    still = replace(motions["a"], drift=1e-9 * motions["a"].drift)
    shown = {"a": motions["a"], "b": still, "c": motions["b"], "d": still}
    scene, _, _ = read(rp.animation(shown).page)
    assert [arm["color"] for arm in scene["arms"]] == [VERMILLION, BLUE, ORANGE, GREEN]
    alone, _, _ = read(rp.animation({"b": still}).page)
    assert alone["arms"][0]["color"] == BLUE
    # J⁺ has one colour everywhere
    known, _, _ = read(rp.animation({"mine": motions["a"], "J⁺": motions["b"]}).page)
    assert [arm["color"] for arm in known["arms"]] == [ORANGE, VERMILLION]


def test_the_page_of_two_hands_says_that_the_path_of_one_winds(tmp_path: Path) -> None:
    """Each motion is of one hand; that of the other is read from the joints, and has no path."""
    both, done = two_armed(tmp_path).task, {}
    for side in ("left", "right"):
        task = both.robot.task(side, "xy")
        q0 = task.from_robot(both.to_robot(Q0))
        p = task.placement(q0).translation
        turns = np.exp(2j * np.pi / 24 * np.arange(1, 24)) * (p[0] + 1j * p[1])
        ring = rp.polygon(task, q0, np.c_[turns.real, turns.imag, 0 * turns.real + p[2]] - p)
        path = ring if side == "right" else rp.circle(task, q0, 0.02)
        done[side] = rp.follow(rp.Pseudoinverse(task), path, q0, cycles=1, steps=72)
    assert "The path winds once around the axis of waist" in rp.animation(done).page


def baxter(folder: Path) -> rp.Robot:
    """The robot without its meshes, which a page holds for long."""
    bones = folder / "bones.urdf"
    text = rp.Robot.load("baxter").description.xml
    bones.write_text(re.sub(r"(?s)<(visual|collision)\b.*?</\1>", "", text), encoding="utf-8")
    return rp.Robot.load(bones)


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_path_of_two_hands_winds_around_a_joint_of_its_own_arm(side: str, tmp_path: Path) -> None:
    """A motion around a smaller path, which does not close, is said to be around this one."""
    task = baxter(tmp_path).task(["left_gripper", "right_gripper"], "position")
    q0, turns = task.reference, np.exp(2j * np.pi / 24 * np.arange(1, 24))[:, None] - 1

    def ring(task: rp.Task, q: np.ndarray) -> rp.TaskPath:
        x, y, _ = task.placement(q).translation - task.joint_origins(q)[0]
        moved = turns * (x + 1j * y)
        return rp.polygon(task, q, np.hstack([moved.real, moved.imag, 0 * moved.real]))

    def circle(task: rp.Task, q: np.ndarray) -> rp.TaskPath:
        return rp.circle(task, q, 0.1)

    small, large = (
        rp.several_paths(task, q0, [way if name == side else None for name in ("left", "right")])
        for way in (circle, ring)
    )
    motion = rp.follow(rp.Pseudoinverse(task), small, q0, cycles=1, steps=40)
    page = rp.animation({"mine": replace(motion, path=large)}).page
    assert f"The path winds once around the axis of {side}_s0, so it need not close" in page


def test_two_hands_are_two_limbs(tmp_path: Path) -> None:
    robot = baxter(tmp_path)
    done = {}
    for side in ("left", "right"):
        task = robot.task(f"{side}_gripper")
        q0 = task.reference
        done[side] = rp.follow(
            rp.Pseudoinverse(task), rp.circle(task, q0, 0.02), q0, cycles=1, steps=10
        )
    scene, _, _ = read(rp.animation(done).page)
    assert [arm["chains"] for arm in scene["arms"]] == [2, 2] and len(scene["paths"]) == 2


@pytest.mark.slow
@pytest.mark.usefixtures("blank_pictures")
def test_a_study_is_shown_as_the_page_that_the_command_writes(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(rp, "study", computed_once(rp.study))
    assert main(["study", "ppr", "--cycles", "1", "--steps", "40", "--degree", "1"]) == 0
    written = (tmp_path / "repctl-out" / "ppr" / "animation.html").read_text(encoding="utf-8")
    study = rp.study()  # the command's
    shown, commands, numbers = read(rp.animation(study).page)
    scene, same, motion = read(written)
    assert (shown["arms"], shown["paths"]) == (scene["arms"], scene["paths"])
    assert commands == same and np.array_equal(numbers, motion)
    assert scene["seconds"] == study.row("repeatable").motion.t[-1]  # one cycle
    assert read(rp.animation(study, seconds=2.0).page)[0]["seconds"] == 2.0


def test_it_is_kept_and_shown(motions: dict[str, rp.Motion], tmp_path: Path, monkeypatch) -> None:
    made = rp.animation(motions)
    file = made.save(tmp_path / "new" / "motion.html")
    assert file.read_text(encoding="utf-8") == made.page and list(file.parent.iterdir()) == [file]
    with pytest.raises(rp.InputError, match="new"):
        made.save(tmp_path / "new")  # a folder
    assert "srcdoc" in made._repr_html_() and len(repr(made)) < 60
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    monkeypatch.setattr("tempfile.mkdtemp", lambda prefix: str(tmp_path / prefix))
    shown = made.show()
    assert opened == [shown.as_uri()] and shown.read_text(encoding="utf-8") == made.page


def test_results_are_short_at_the_prompt(motions: dict[str, rp.Motion]) -> None:
    motion = motions["a"]
    first, last = (f"{value:.3g}" for value in motion.drift)
    assert (
        repr(motion)
        == f"<Motion of planar3r tool: {motion.path.name}, 2 cycles, drift {first} … {last}>"
    )
    task, q0 = motion.task, motion.q[0]
    design = rp.nearest_repeatable(
        rp.Pseudoinverse(task), rp.Polynomial(q0, 1, 0.3), rp.Box(q0, 0.3)
    )
    assert f"cost {design.cost:.4g}" in repr(design) and len(repr(design)) < 120


def test_what_cannot_be_shown_is_named(motions: dict[str, rp.Motion]) -> None:
    task = rp.Robot.load("ppr").task(kind="xy")
    q0 = np.array([0.0, 0.0, 0.5])
    other = rp.follow(rp.Pseudoinverse(task), rp.circle(task, q0, 0.1), q0, cycles=2, steps=40)
    short = rp.follow(
        rp.Pseudoinverse(motions["a"].task),
        motions["a"].path,
        motions["a"].q[0],
        cycles=1,
        steps=40,
    )
    for given, words in (
        ({}, "motions is empty"),
        ({"q": motions["a"].q}, r"motions\['q'\] must be a motion"),
        ({"a": motions["a"], "b": other}, "motions are of planar3r and ppr"),
        ({"a": motions["a"], "b": short}, "differ in the number of cycles or steps"),
        (motions["a"], "motions by name, as in"),
        ("panda", "got 'panda'"),
    ):
        with pytest.raises(rp.InputError, match=words):
            rp.animation(given)
