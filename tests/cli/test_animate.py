"""``repctl animate`` and what it stands on: motions read back from files, and pages made of
them."""

from __future__ import annotations

import json
import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from commands import main, parsers, refused
from page_file import Visuals, read

import repctl_pin as rp
from repctl_pin.motion import csv_text, read_motions
from repctl_pin.show import page as pages
from repctl_pin.show import study_files

KEYS = {
    "J⁺": "pseudoinverse",
    "J⁺ + posture": "posture",
    "J⁺ + other posture": "posture_off",
    "nearest repeatable": "repeatable",
}


@pytest.fixture(scope="module")
def study() -> rp.Study:
    return rp.study("ppr", cycles=3, steps=60, degree=1)


@pytest.fixture(scope="module")
def folder(study: rp.Study, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The files of the study, without what the figures show."""
    folder = tmp_path_factory.mktemp("study")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("repctl_pin.show.study_files.png", lambda *_, **__: b"")
        study_files.write_study(study, folder)
    return folder


def test_a_studys_csv_is_read_back(study: rp.Study, folder: Path) -> None:
    tracks = pages.read_playbacks(folder / "motion.csv", study.robot)
    assert [t.label for t in tracks] == [row.label for row in study.rows]
    for track, row in zip(tracks, study.rows, strict=True):
        assert track.cycles == 3 and track.unit == "rad and m"
        np.testing.assert_allclose(
            study.task.from_robot(track.Q), row.motion.q, atol=1e-9
        )
        np.testing.assert_allclose(track.drift, row.motion.drift, atol=1e-8)


def test_a_followed_csv_is_read_back(study: rp.Study, tmp_path: Path) -> None:
    motion = study.row("repeatable").motion
    (tmp_path / "mine.csv").write_text(csv_text(motion), encoding="utf-8")
    (track,) = pages.read_playbacks(tmp_path / "mine.csv", study.robot, cycles=3)
    np.testing.assert_array_equal(study.task.from_robot(track.Q), motion.q)
    assert track.label == "mine" and track.cycles == 3
    (same,) = pages.read_playbacks(
        tmp_path / "mine.csv", study.robot
    )  # the file says how often round
    assert same.cycles == 3 and np.array_equal(same.drift, track.drift)


@pytest.mark.parametrize(
    "names", [("a,b", 'say "x"', "two\nlines"), ("a b", "ü", "tab\t\u0085")]
)
def test_any_name_of_a_joint_comes_back_from_csv_and_yaml(
    names, study: rp.Study, tmp_path: Path
) -> None:
    yaml = pytest.importorskip("yaml")
    motion = study.row("repeatable").motion
    task = SimpleNamespace(robot_joints=names, joints=motion.task.joints, n=len(names))
    named = object.__new__(rp.Motion)
    vars(named).update(vars(motion) | {"task": task})
    file = tmp_path / "m.csv"
    file.write_text(csv_text([("mine", named)], most=10))
    (found,) = read_motions(file, names)
    assert found.joints == names and found.cycles == 3 and found.q.shape == (31, 3)
    np.testing.assert_allclose(found.q, motion.q[::6], atol=1e-9)
    file = rp.write_motion(named, tmp_path / "m.yaml", allow_violations=True)
    assert yaml.safe_load(file.read_text(encoding="utf-8"))["joint_names"] == list(
        names
    )


def test_two_columns_of_one_name_are_refused(study: rp.Study) -> None:
    motion = study.row("repeatable").motion
    for names in (("time", "b", "c"), ("a", "a_velocity", "c")):
        task = SimpleNamespace(robot_joints=names)
        with pytest.raises(rp.InputError, match="two columns are named"):
            csv_text(
                SimpleNamespace(
                    **(vars(motion) | {"task": task, "joints": motion.joints})
                )
            )


def test_joints_without_a_column_stay_at_the_reference(tmp_path: Path) -> None:
    robot = rp.Robot.load("panda")
    rows = "\n".join(f"{k / 10},{0.1 * k}" for k in range(5))
    (tmp_path / "one.csv").write_text(f"time, panda_joint2\n{rows}\n", encoding="utf-8")
    (track,) = pages.read_playbacks(tmp_path / "one.csv", robot)
    expected = np.tile(robot.reference, (5, 1))
    expected[:, robot.joint_names.index("panda_joint2")] = 0.1 * np.arange(5)
    np.testing.assert_allclose(track.Q, expected)


def test_a_files_times_say_how_fast_its_joints_are(
    study: rp.Study, tmp_path: Path
) -> None:
    """In the second of two cycles the lift moves at three times its speed limit; without times
    nobody knows."""
    limit = study.task.joint_limits[2][0]
    speeds = (
        np.where(np.arange(40) == 30, 3.0, 0.5)
        * np.where(np.arange(40) % 2, -1, 1)
        * limit
    )
    rows = np.c_[
        np.arange(41) / 20, 0.1 * np.arange(41), 0.3 + np.r_[0, np.cumsum(0.1 * speeds)]
    ]
    for header, told in (("cycle,time,d1", True), ("cycle,d1", False)):
        cells = rows if told else rows[:, [0, 2]]
        lines = "\n".join(",".join(map(repr, map(float, row))) for row in cells)
        (tmp_path / "fast.csv").write_text(f"{header}\n{lines}\n", encoding="utf-8")
        (track,) = pages.read_playbacks(tmp_path / "fast.csv", study.robot)
        page = pages.playback_page([pages.TracedChain(study.task, 0)], [track])
        (arm,) = read(page)[0]["arms"]
        assert (" times the speed limit." in page) == told
        assert (arm["broken"] is not None) == told
        if told:
            assert (
                arm["broken"]["words"] == "d1 past its speed limit"
                and arm["broken"]["cycle"] == 2
            )
            assert arm["broken"]["at"] == pytest.approx(1.5, abs=0.06)


BAD = {
    "no such file": (None, "cannot read .*No such file"),
    "not text": (b"\xff\xfe\x00\x01", "not UTF-8 text"),
    "empty": (b"", "there is no joint column"),
    "header only": (b"d1,d2,theta3\n", "contains no rows"),
    "strange column": (b"d1,elbow\n0,0\n", "no joint 'elbow'"),
    "no number": (b"d1,d2\n0,0\n0,x\n", r"line 3: d2 = 'x' is not a finite number"),
    "not finite": (b"d1\n0\ninf\n", r"line 3: d1 = 'inf'"),
    "short line": (b"d1,d2\n0,0\n0\n", r"line 3: 1 fields, but the header has 2"),
    "twice": (b"d1,d2,d1\n0,0,0\n", "two columns are named 'd1'"),
    "half a cycle": (b"cycle,d1\n0,0\n0.5,1\n", "ends within a cycle, at 0.5"),
    "uneven": (b"cycle,d1\n0,0\n1,0\n1.5,1\n2,0\n", "not a start and 2 cycles"),
    "one row": (b"d1\n0\n", "not a start and 1 cycles"),
    "back in time": (b"time,d1\n0,0\n0.1,0\n0.1,1\n", "line 4: time must increase"),
    "no time": (b"t,d1\n0,0\nsoon,1\n", "line 3: t = 'soon'"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_bad_motion_is_refused_with_its_line(
    case: str, study: rp.Study, tmp_path: Path
) -> None:
    content, words = BAD[case]
    file = tmp_path / "bad.csv"
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(rp.InputError, match=words):
        pages.read_playbacks(file, study.robot)


def test_the_page_holds_what_the_motions_did(study: rp.Study) -> None:
    motions = [study.row(key).motion for key in ("pseudoinverse", "repeatable")]
    tracks = [
        pages.playback_of("a", motions[0], "#D55E00"),
        pages.playback_of("b", motions[1], "#0072B2"),
    ]
    scene, _, numbers = read(
        pages.playback_page([pages.TracedChain(study.task, 2)], tracks, seconds=3.0)
    )
    frames = pages.choose_frames(181, 3)
    visuals = Visuals.of(study.robot)
    expected = []
    for motion in motions:
        Q = motion.q[frames.index]
        placements = visuals.placements(study.task.to_robot(Q))
        moving = (
            np.ptp(placements, axis=0).reshape(len(visuals.shapes), -1).max(axis=1)
            > 1e-12
        )
        tip = study.task.positions(Q)
        elbow = np.array([study.task.joint_origins(q)[2] for q in Q])
        drift = pages.body_points.body_drift(
            pages.body_points.corners(visuals.shapes), placements, frames.per_cycle
        )
        points = np.vstack(
            [p for p, moves in zip(drift.points, moving, strict=True) if moves]
        )
        expected += [
            np.round(pages.poses_of(placements), 7)[:, moving],
            tip,
            elbow,
            points,
        ]
    path = expected[1][
        : frames.per_cycle
    ]  # by default, what the first did in its first cycle
    np.testing.assert_allclose(
        numbers, np.concatenate([e.ravel() for e in [*expected, path]]), atol=1e-6
    )
    assert (
        [a["label"] for a in scene["arms"]] == ["a", "b"]
        and scene["planar"]
        and scene["seconds"] == 3.0
    )
    assert scene["arms"][0]["drift"] == motions[0].drift.tolist()


def test_every_limb_leaves_its_traces() -> None:
    """Two hands of one robot: each its own traces and path, and both drifts in the caption's
    words."""
    robot = rp.Robot.load("baxter")
    left, right = (robot.task(f"{side}_gripper") for side in ("left", "right"))
    Q = robot.reference + np.linspace(0, 0.3, 21)[:, None] * np.cos(
        np.arange(len(robot.reference))
    )
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 0, 0]])
    track = pages.Playback("moved", "#0072B2", Q, 2, np.array([0.1, 0.2]))
    page = pages.playback_page(
        [pages.TracedChain(left, 3), pages.TracedChain(right, 5)],
        [track],
        paths=[square, 2 * square[:3]],
    )
    scene, _, numbers = read(page)
    assert scene["paths"] == [4, 3] and scene["arms"][0]["chains"] == 2
    np.testing.assert_allclose(
        numbers[-21:].reshape(7, 3), [*square, *(2 * square[:3])]
    )
    rows = Q[pages.choose_frames(21, 2).index]
    (arm,) = scene["arms"]
    broken, joints = arm["broken"], 3 * len(rows)
    # before the paths, the points of the moving bodies
    end = -21 - 3 * sum(
        shape["points"] for shape in arm["shapes"] if shape["pose"] is None
    )
    joint = broken["words"].removesuffix(" past its limit")
    chains = [
        robot.joint_names.index(name)
        for name in (*left.joint_names, *right.joint_names)
    ]
    outside = ((Q < robot.lower) | (Q > robot.upper))[:, chains]
    row = int(np.argmax(outside.any(axis=1)))
    assert outside[row, [*left.joint_names, *right.joint_names].index(joint)]
    assert broken["at"] == pytest.approx(row / 10)
    task = left if joint in left.joint_names else right
    origins = [
        task.joint_origins(task.from_robot(q))[task.joint_names.index(joint)]
        for q in rows
    ]
    np.testing.assert_allclose(
        numbers[end - joints : end].reshape(-1, 3), origins, atol=1e-6
    )
    ways = numbers[: end - joints][-2 * len(rows) * 2 * 3 :].reshape(2, len(rows), 2, 3)
    for k, (task, elbow) in enumerate(((left, 3), (right, 5))):
        np.testing.assert_allclose(
            ways[0, :, k],
            [task.placement(task.from_robot(q)).translation for q in rows],
            atol=1e-6,
        )
        np.testing.assert_allclose(
            ways[1, :, k],
            [task.joint_origins(task.from_robot(q))[elbow] for q in rows],
            atol=1e-6,
        )
    assert "left_gripper" in scene["caption"] and "right_gripper" in scene["caption"]


def test_motions_of_different_length_are_refused(study: rp.Study) -> None:
    from dataclasses import replace

    track = pages.playback_of("a", study.row("repeatable").motion, "#000000")
    with pytest.raises(rp.InputError, match="as many cycles and steps"):
        pages.playback_page(
            [pages.TracedChain(study.task, 0)],
            [track, replace(track, Q=track.Q[:61], cycles=1)],
        )


def test_the_command_from_a_csv_a_design_and_options(
    study: rp.Study,
    folder: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    rp.save(study.design, "design.json")
    csv = ["--motion", str(folder / "motion.csv"), "--only", "repeatable,posture"]
    few = ["--cycles", "2", "--steps", "40"]
    for arguments, labels in (
        (["ppr", *csv], ["nearest repeatable", "J⁺ + posture"]),
        (["design.json", *few, "--path", "eight:0.1"], ["J⁺", "nearest repeatable"]),
        (
            ["ppr", *few, "--degree", "1", "--seconds", "2"],
            ["J⁺", "nearest repeatable"],
        ),
    ):
        assert main(["animate", *arguments, "--json"]) == 0
        told = json.loads(capsys.readouterr().out)
        assert list(told["drift"]) == [KEYS[label] for label in labels]
        assert told["files"] == ["repctl-out/ppr/animation.html"]
        scene, _, _ = read(Path(told["files"][0]).read_text(encoding="utf-8"))
        assert [arm["label"] for arm in scene["arms"]] == labels
        assert told["cycles"] == len(scene["arms"][0]["drift"])
        assert [arm["drift"] for arm in scene["arms"]] == list(told["drift"].values())
        assert max(told["drift"]["repeatable"]) < 1e-6


def test_the_command_refuses(folder: Path, tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    motion = str(folder / "motion.csv")
    there = "no strategy 'mine'; it has pseudoinverse, posture, posture_off, repeatable"
    assert there in refused(
        capsys, "animate", "ppr", "--motion", motion, "--only", "mine"
    )
    unknown = refused(capsys, "animate", "panda", "--motion", motion)
    assert "no joint 'd1'" in unknown and "panda_joint1" in unknown
    for arguments in (
        ["ppr", "--only", "repeatable"],
        ["none.json"],
        ["design.json", "--motion", motion],
    ):
        refused(capsys, "animate", *arguments)
    assert list(tmp_path.iterdir()) == []


def test_every_command_has_an_example_and_json() -> None:
    for name, part in parsers().items():
        if not name:
            continue
        text = part.format_help()
        assert re.search(rf"examples?:\s+repctl {name}", text), text
        assert "--json" in text or name in ("completion", "ros2")
