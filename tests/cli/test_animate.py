"""``repctl animate`` and what it stands on: motions read back from files, and pages made of
them."""

from __future__ import annotations

import html
import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from arms import planar_urdf
from commands import main, parsers, printed, refused, told
from page_file import Drawn, Pane, panes, read
from store import study_of

import repctl_pin as rp

KEYS = {
    "J⁺": "pseudoinverse",
    "J⁺ + posture": "posture",
    "J⁺ + other posture": "posture_off",
    "nearest repeatable": "repeatable",
}


@pytest.fixture(scope="module")
def study() -> rp.Study:
    return study_of("ppr")


@pytest.fixture(scope="module")
def folder(study: rp.Study, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The files of the study, without what the figures show."""
    folder = tmp_path_factory.mktemp("study")
    printed(study, folder)
    return folder


@pytest.fixture
def animated(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> Callable[..., tuple[dict, dict, list[Pane]]]:
    """What the command tells of a motion in a file, the scene of its page, and its arms."""

    def animate(robot: object, file: Path, *options: str) -> tuple:
        given = ("animate", str(robot), "--motion", str(file))
        answer = told(capsys, *given, "--out", str(tmp_path / "out"), *options)
        (page,) = answer["files"]
        scene, _, numbers = read(Path(page).read_text(encoding="utf-8"))
        return answer, scene, panes(scene, numbers)[0]

    return animate


@pytest.mark.slow
def test_a_studys_csv_is_read_back(study: rp.Study, folder: Path, animated) -> None:
    answer, scene, arms = animated("ppr", folder / "motion.csv")
    assert [arm["label"] for arm in scene["arms"]] == [row.label for row in study.rows]
    assert answer["cycles"] == 3 and answer["frame"] == "tool"
    drawn, per = Drawn(study.robot), scene["perCycle"]
    rows = np.r_[:61, 60:121, 120:181]
    assert per == 61
    for row, arm, pane in zip(study.rows, scene["arms"], arms, strict=True):
        assert arm["unit"] == "rad and m"
        np.testing.assert_allclose(answer["drift"][row.key], row.motion.drift, atol=1e-8)
        expected = drawn.placements(study.task.to_robot(row.motion.q[rows]))
        np.testing.assert_allclose(pane.of(drawn), expected, atol=1e-6)


@pytest.mark.slow
def test_a_followed_csv_is_read_back(study: rp.Study, tmp_path: Path, animated) -> None:
    """The file says how many cycles it holds; so can the command."""
    motion = study.row("repeatable").motion
    file = rp.write_motion(motion, tmp_path / "mine.csv")
    for more in ([], ["--cycles", "3"]):
        answer, scene, _ = animated("ppr", file, *more)
        assert answer["cycles"] == 3 and scene["arms"][0]["label"] == "mine"
        assert answer["drift"] == {"mine": motion.drift.tolist()}


def named(folder: Path, names: tuple[str, ...]) -> rp.Robot:
    """A planar arm whose joints have these names."""
    text = planar_urdf([1, 0.8, 0.6])
    for k, name in enumerate(names, 1):
        text = text.replace(f'"theta{k}"', f'"{html.escape(name)}"')
    (folder / "named.urdf").write_text(text, encoding="utf-8")
    return rp.Robot.load(folder / "named.urdf")


def test_any_name_of_a_joint_comes_back_from_csv_and_yaml(tmp_path: Path, animated) -> None:
    yaml = pytest.importorskip("yaml")
    names = ("a b: c", "ü#", "it's")
    task = named(tmp_path, names).task(kind="xy")
    path = rp.circle(task, [0.3, 0.8, 0.8], 0.1)
    control = rp.Pseudoinverse(task)
    motion = rp.follow(control, path, [0.3, 0.8, 0.8], cycles=3, steps=10)
    file = rp.write_motion(motion, tmp_path / "m.csv")
    answer, _, arms = animated(tmp_path / "named.urdf", file)
    assert answer["drift"] == {"m": motion.drift.tolist()}
    expected = task.positions(motion.q[np.r_[:11, 10:21, 20:31]])
    np.testing.assert_allclose(arms[0].tip[:, 0], expected, atol=1e-6)
    file = rp.write_motion(motion, tmp_path / "m.yaml", allow_violations=True)
    assert yaml.safe_load(file.read_text(encoding="utf-8"))["joint_names"] == list(names)
    for bad in ("a,b", 'say "x"', "c;d"):
        with pytest.raises(rp.InputError, match="which breaks CSV files; rename it"):
            named(tmp_path, (bad,))


def test_two_columns_of_one_name_are_refused(tmp_path: Path) -> None:
    for names in (("time", "b", "c"), ("a", "a_velocity", "c")):
        task = named(tmp_path, names).task(kind="xy")
        path = rp.circle(task, [0.3, 0.8, 0.8], 0.1)
        motion = rp.follow(rp.Pseudoinverse(task), path, [0.3, 0.8, 0.8], cycles=1)
        with pytest.raises(rp.InputError, match="two columns are named"):
            rp.write_motion(motion, tmp_path / "m.csv")


def test_joints_without_a_column_stay_at_the_reference(tmp_path: Path, animated) -> None:
    robot = rp.Robot.load("planar4r")
    rows = "\n".join(f"{k / 10},{0.1 * k}" for k in range(5))
    (tmp_path / "one.csv").write_text(f"time, theta2\n{rows}\n", encoding="utf-8")
    _, _, (arm,) = animated("planar4r", tmp_path / "one.csv")
    expected = np.tile(robot.reference, (5, 1))
    expected[:, robot.joint_names.index("theta2")] = 0.1 * np.arange(5)
    drawn = Drawn(robot)
    np.testing.assert_allclose(arm.of(drawn), drawn.placements(expected), atol=1e-6)


def test_a_files_times_say_how_fast_its_joints_are(
    study: rp.Study, tmp_path: Path, animated
) -> None:
    """In the second of two cycles the lift moves at three times its speed limit; without times
    nobody knows."""
    limit = study.task.velocity_limit[0]
    speeds = np.where(np.arange(40) == 30, 3.0, 0.5) * np.where(np.arange(40) % 2, -1, 1) * limit
    rows = np.c_[np.arange(41) / 20, 0.1 * np.arange(41), 0.3 + np.r_[0, np.cumsum(0.1 * speeds)]]
    for header, timed in (("cycle,time,d1", True), ("cycle,d1", False)):
        cells = rows if timed else rows[:, [0, 2]]
        lines = "\n".join(",".join(map(repr, map(float, row))) for row in cells)
        (tmp_path / "fast.csv").write_text(f"{header}\n{lines}\n", encoding="utf-8")
        answer, scene, _ = animated("ppr", tmp_path / "fast.csv")
        page = Path(answer["files"][0]).read_text(encoding="utf-8")
        (arm,) = scene["arms"]
        said = re.search(r"d1 reaches \d\.\d times its speed limit in cycle 2\. ", page)
        assert bool(said) == timed
        assert (arm["broken"] is not None) == timed
        if timed:
            assert (
                arm["broken"]["words"] == "d1 past its speed limit" and arm["broken"]["cycle"] == 2
            )
            assert arm["broken"]["at"] == pytest.approx(1.5, abs=0.06)


BAD = {
    "no such file": (None, "cannot read .*No such file"),
    "not text": (b"\xff\xfe\x00\x01", "not UTF-8 text"),
    "empty": (b"", "the first line must name the columns"),
    "header only": (b"d1,d2,theta3\n", "contains no rows"),
    "strange column": (b"d1,elbow\n0,0\n", "no joint 'elbow'"),
    "no number": (b"d1,d2\n0,0\n0,x\n", r"line 3: d2 = 'x' is not a finite number"),
    "not finite": (b"d1\n0\ninf\n", r"line 3: d1 = 'inf'"),
    "short line": (b"d1,d2\n0,0\n0\n", r"line 3: 1 fields, but the header has 2"),
    "twice": (b"d1,d2,d1\n0,0,0\n", "two columns are named 'd1'"),
    "half a cycle": (b"cycle,d1\n0,0\n0.5,1\n", "ends within a cycle, at 0.5"),
    "uneven": (b"cycle,d1\n0,0\n1,0\n1.5,1\n2,0\n", "one start row and 2 cycles"),
    "one row": (b"d1\n0\n", "one start row and 1 cycles"),
    "back in time": (b"time,d1\n0,0\n0.1,0\n0.1,1\n", "line 4: time must increase"),
    "no time": (b"t,d1\n0,0\nsoon,1\n", "line 3: t = 'soon'"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_bad_motion_is_refused_with_its_line(
    case: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    content, words = BAD[case]
    file = tmp_path / "bad.csv"
    if content is not None:
        file.write_bytes(content)
    given = ("animate", "ppr", "--motion", str(file), "--out", str(tmp_path / "out"))
    assert re.search(words, refused(capsys, *given))
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
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
        (["ppr", *few, "--degree", "1", "--seconds", "2"], ["J⁺", "nearest repeatable"]),
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
    keys = "pseudoinverse, posture, posture_off, repeatable"
    there = f"no motion of the strategy 'mine'; choose from {keys}"
    assert there in refused(capsys, "animate", "ppr", "--motion", motion, "--only", "mine")
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
        assert "--json" in text or name == "ros2"
