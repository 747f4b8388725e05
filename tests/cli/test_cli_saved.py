"""Saved designs on the command line: follow, check and animate take robot, frame, kind and joints
from the file."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from arms import planar_urdf, spatial_urdf
from commands import main, refused, told, without_pictures

import repctl_pin as rp

SMALL = ["--degree", "1", "--samples", "512", "--held-out", "512", "--region", "0.2", "--quiet"]
SHORT = ["--cycles", "1", "--steps", "60"]


@pytest.fixture(scope="module")
def designed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with an arm that no catalogue has, and a design at a frame and of a kind that are
    not the first, a slide held."""
    folder = tmp_path_factory.mktemp("rail")
    (folder / "rail.urdf").write_text(spatial_urdf(7, 0), encoding="utf-8")
    where = ["--frame", "link7", "--task", "position", "--lock", "q3", "--base", "link1"]
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        without_pictures(patch)
        assert main(["design", "rail.urdf", *where, *SMALL, "--out", "."]) == 0
    return folder


@pytest.fixture
def rail(designed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the arm's file and its design, in the test's own folder."""
    monkeypatch.chdir(tmp_path)
    for name in ("rail.urdf", "design.json"):
        shutil.copy(designed / name, tmp_path)
    return tmp_path / "design.json"


@pytest.mark.slow
def test_the_file_says_what_it_was_made_for(rail: Path, capsys) -> None:
    joints = ["q2", "q4", "q5", "q6", "q7"]  # beyond link1, without the slide that is held
    for more in (
        [],
        ["--lock", "q3"],
        ["--base", "link1", "--frame", "link7", "--task", "position"],
    ):
        given = ["design.json", "--robot", "rail.urdf", *more]
        followed = told(capsys, "follow", *given, "--steps", "60")
        assert (followed["frame"], followed["task"], followed["joints"]) == (
            "link7",
            "position",
            joints,
        )
        assert max(followed["drift"]) < 1e-6
        checked = told(capsys, "check", *given, "--samples", "16")
        assert checked["joints"] == joints and checked["repeatable"] is True
        assert checked["region"]["half_width"] == [0.2] * 5
    animated = told(capsys, "animate", "design.json", "--robot", "rail.urdf", *SHORT)
    assert animated["frame"] == "link7" and list(animated["drift"]) == [
        "pseudoinverse",
        "repeatable",
    ]
    # the robot in the file is called spatial
    assert animated["files"] == ["repctl-out/rail/animation.html"]


@pytest.mark.slow
def test_another_elbow_keeps_the_designs_path(tmp_path, monkeypatch, capsys) -> None:
    """Started elsewhere on the self-motion, the hand where it was, the arm follows the path of the
    design."""
    monkeypatch.chdir(tmp_path)
    told(capsys, "design", "planar3r", "--path", "square:0.2", *SMALL[:-1], "--out", ".")
    own = told(capsys, "follow", "design.json", "--steps", "60")
    task, q0 = rp.Robot.load("planar3r").task("tool", "xy"), np.array(own["start"])
    N = np.linalg.svd(task.jacobian(q0))[2][-1]
    q = rp.solve_ik(task, q0 + 0.05 * N, task.placement(q0))
    assert np.linalg.norm(q - q0) > 0.03
    other = told(
        capsys,
        "follow",
        "design.json",
        "--steps",
        "60",
        "--start=" + ",".join(map(repr, map(float, q))),
    )
    assert (
        other["path"] == own["path"]
        and other["start"] == pytest.approx(q)
        and max(other["drift"]) < 1e-6
    )


def test_what_contradicts_the_file_is_named_by_its_option(rail: Path, capsys) -> None:
    (rail.parent / "planar.urdf").write_text(
        planar_urdf([1, 0.8, 0.6]).replace('"planar"', '"other"')
    )
    for command in ("follow", "check", "animate"):
        here = [command, "design.json", "--robot", "rail.urdf"]
        for arguments, words in (
            (
                [command, "design.json"],
                "not in the catalogue; give the path of its file: --robot rail.urdf",
            ),
            (
                [command, "design.json", "--robot", "planar.urdf"],
                "for the robot 'spatial', not 'other'",
            ),
            ([*here, "--frame", "tool"], "has its own frame, link7; omit --frame"),
            ([*here, "--task", "pose"], "has its own task, position; omit --task"),
            ([*here, "--base", "link2"], "has its own base, link1; omit --base"),
            ([*here, "--lock", "q4"], "was made with 'q4' free to move; omit --lock q4"),
            ([*here, "--start", "0,0"], "--start has 2 numbers"),
            (
                [command, "panda", "--robot", "ur5", "--strategy", "inertia"][
                    : 6 if command == "follow" else 4
                ],
                "--robot requires a saved design; omit --robot to use panda",
            ),
        ):
            error = refused(capsys, *arguments)
            assert words in error and "rp." not in error and "load(" not in error, arguments
    text = rail.read_text()
    for damaged in (
        text[: len(text) // 2],
        text.replace('"link7"', "7"),
        '{"task": 3}',
        "[" * 9999,
    ):
        rail.write_text(damaged)
        assert "design.json" in refused(capsys, "follow", "design.json", "--robot", "rail.urdf")


@pytest.mark.parametrize("command", ["study", "design", "inspect"])
def test_where_a_robot_is_wanted_a_design_is_pointed_elsewhere(
    command: str, tmp_path, monkeypatch, capsys
) -> None:
    monkeypatch.chdir(tmp_path)
    assert "requires a robot, but d/design.json is a saved design; use it with follow" in refused(
        capsys, command, "d/design.json"
    )
    assert list(tmp_path.iterdir()) == []


def test_a_motion_outside_what_was_designed_for_is_said(rail: Path, capsys) -> None:
    outside = [
        told(capsys, "follow", "design.json", "--robot", "rail.urdf", "--path", path)["outside"]
        for path in ("circle:0.001", "circle:0.3")
    ]
    assert outside[0] == 0 < outside[1]


@pytest.mark.slow
def test_links_under_the_packages_own_names_are_replaced(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    no_tours: None,
) -> None:
    """Issue 37, item 13: only a file that the user names is written through a symbolic link."""
    monkeypatch.chdir(tmp_path)
    Path("private").write_text("mine")
    cell = ["--half-width", "0.05", "--degree", "1", "--held-out", "64"]
    export = [*("h", "c", "hpp"), "_kdl.hpp"]
    code = [f"arm{end}" if "_" in end else f"arm.{end}" for end in export]
    for words, names in (
        (["design", "planar3r", *SMALL[:-1]], ["design.json", "design.png"]),
        (["animate", "first/design.json", *SHORT], ["animation.html"]),
        (["cell", "planar3r", *cell], ["cell.json", "cell.html", "cell.png"]),
        (["export", "first/design.json", "--name", "arm"], [*code, "check.c"]),
    ):
        folder = Path("first" if words[0] == "design" else words[0])
        folder.mkdir()
        for name in names:
            (folder / name).symlink_to(tmp_path / "private")
        if words[0] == "export":  # a foreign file is never replaced
            assert "is not overwritten" in refused(capsys, *words, "--out", str(folder))
            for name in names:
                (folder / name).unlink()
                (folder / name).symlink_to(tmp_path / "missing")
        files = told(capsys, *words, "--out", str(folder))["files"]
        assert set(names) <= {Path(file).name for file in files}
        assert not any(Path(file).is_symlink() for file in files)
        assert Path("private").read_text() == "mine" and not Path("missing").exists()
    Path("named.csv").symlink_to("target.csv")
    told(capsys, "follow", "first/design.json", *SHORT, "--csv", "named.csv")
    assert Path("named.csv").is_symlink() and Path("target.csv").is_file()
