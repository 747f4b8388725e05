"""``--path`` and ``--plane``: the same words are the same path, whatever command they are given
to."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import numpy as np
import pytest
from arms import Q_PANDA, named_path, planar_task
from commands import main, refused, told, without_pictures
from controls import some

import repctl_pin as rp

WORDS = ["--path", "circle:0.1", "--plane", "xy"]
SHORT = ["--cycles", "1", "--steps", "80"]
MY_ARM = str(Path(__file__).parents[2] / "examples" / "my_arm.urdf")


def joints(file: str, strategy: str | None = None) -> np.ndarray:
    """The joint path in a CSV that study or follow wrote."""
    with open(file, newline="", encoding="utf-8") as lines:
        rows = [row for row in csv.DictReader(lines) if strategy in (None, row.get("strategy"))]
    names = [name for name in rows[0] if re.fullmatch(r"(panda_joint|theta)\d", name)]
    return np.array([[float(row[name]) for name in names] for row in rows])


@pytest.mark.slow
def test_the_same_words_are_the_same_joint_path(tmp_path, monkeypatch, capsys) -> None:
    """A study's J⁺, follow's, and that of the words the study gives back; and the drift of its
    first cycle."""
    monkeypatch.chdir(tmp_path)
    without_pictures(monkeypatch)
    studied = told(capsys, "study", "planar4r", *WORDS, *SHORT, "--degree", "1", "--out", "s")
    again = ["--path", studied["path_spec"], "--plane", studied["plane"]]
    follow = ["follow", "planar4r", "--strategy", "pseudoinverse", *SHORT]
    by_words = told(capsys, *follow, *WORDS, "--csv", "words.csv")
    by_answer = told(capsys, *follow, *again, "--csv", "answer.csv")
    assert studied["path"] == by_words["path"] == "circle of radius 0.1 m in xy"
    assert (
        again
        == ["--path", "circle:0.1:180", "--plane", "xy"]
        == ["--path", by_words["path_spec"], *again[2:]]
    )
    np.testing.assert_allclose(
        joints("words.csv"), joints("s/motion.csv", "pseudoinverse"), atol=2e-9
    )
    assert Path("words.csv").read_bytes() == Path("answer.csv").read_bytes()
    assert (
        by_words["drift"] == by_answer["drift"] == studied["strategies"]["pseudoinverse"]["drift"]
    )
    animated = told(capsys, "animate", "planar4r", *WORDS, *SHORT, "--degree", "1", "--out", "a")
    assert animated["drift"]["pseudoinverse"] == studied["strategies"]["pseudoinverse"]["drift"]


@pytest.mark.slow
def test_without_a_path_all_take_the_same(tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    without_pictures(monkeypatch)
    studied = told(capsys, "study", "prr", *SHORT, "--degree", "1")
    followed = told(capsys, "follow", "prr", "--strategy", "pseudoinverse", *SHORT)
    assert studied["path_spec"] == followed["path_spec"] and studied["start"] == followed["start"]
    assert studied["strategies"]["pseudoinverse"]["drift"] == followed["drift"]


@pytest.mark.slow
def test_a_design_round_a_path_is_round_the_studied_one(tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    small = ["--degree", "1", "--samples", "512", "--held-out", "512", "--region", "0.1"]
    designed = told(capsys, "design", "panda", *WORDS, *small)
    assert (designed["path_spec"], designed["plane"]) == ("circle:0.1:180", "xy")
    assert "tube" in designed["region"]["is"] and designed["converged"]
    assert designed["notes"] == [
        "default cycle saved with the design: circle of radius 0.1 m in xy, 5 s; "
        "repctl follow uses it unless --path is given"
    ]
    followed = told(capsys, "follow", designed["files"][1], *SHORT, "--csv", "m.csv")
    assert (
        followed["outside"] == 0
        and followed["drift"][0] < 1e-6
        and followed["start"] == designed["start"]
    )
    middle, half = (np.array(designed["region"][key]) for key in ("center", "half_width"))
    Q = joints("m.csv")
    np.testing.assert_allclose(2 * half, np.ptp(Q, axis=0) + 0.2, atol=2e-3)
    assert np.abs(middle - Q).max(axis=1).min() < 0.05  # one of its configurations


def test_an_angle_that_is_given_is_taken(panda_pose, q_panda) -> None:
    here = panda_pose.placement(q_panda).translation
    for degrees in (0.0, 35.0, -90.0, 180.0):
        path = named_path(panda_pose, q_panda, f"circle:0.1:{degrees:g}", "yz")
        middle = path.points(401)[:-1].mean(axis=0)
        expected = 0.1 * np.array([0, np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))])
        np.testing.assert_allclose(here - middle, expected, atol=1e-12)
        assert (path.spec, path.plane) == (f"circle:0.1:{degrees:g}", "yz")
    turned = named_path(panda_pose, q_panda, "circle:0.1", "xy")
    lying = named_path(panda_pose, q_panda, "circle:0.1:0", "xy")
    drifts = [
        rp.follow(rp.Pseudoinverse(panda_pose), p, q_panda, cycles=1).drift[0]
        for p in (turned, lying)
    ]
    np.testing.assert_allclose(drifts, [0.146, 0.431], atol=2e-3)
    with pytest.raises(rp.InputError, match="'up' is not an angle in degrees"):
        named_path(panda_pose, q_panda, "circle:0.1:up")


@pytest.mark.parametrize(
    "words",
    ["circle:0.05", "circle:0.1:33.3", "square:0.1", "eight:0.05", "rose:0.05", "polygon:5:0.05"],
)
def test_the_words_of_a_path_make_it_again(words: str, panda_pose, q_panda) -> None:
    path = named_path(panda_pose, q_panda, words)
    same = named_path(panda_pose, q_panda, path.spec, path.plane)
    np.testing.assert_array_equal(path.points(33), same.points(33))
    assert path.options == f"--path {path.spec} --plane xy" and path.spec.startswith(words)


def test_a_flat_task_takes_its_own_plane() -> None:
    task = rp.Robot.load("panda").task("panda_hand_tcp", "xz")
    for words in ("circle:0.05", "square:0.05"):
        path = named_path(task, Q_PANDA, words)
        assert path.plane == "xz" and np.ptp(path.points(64)[:, 1]) == 0


@pytest.mark.slow
def test_a_path_made_in_python_has_no_words() -> None:
    few, start = {"cycles": 1, "steps": 60, "degree": 1}, [0.3, 0.8, 0.8]
    path = lambda task, q0: rp.circle(task, q0, 0.05)  # noqa: E731
    study = rp.study(rp.Problem("planar3r", start=start, path=path), **few)
    assert (
        study.as_dict()["path_spec"] is study.as_dict()["plane"] is None
        and "path options" not in study.setting
    )
    study = rp.study(rp.Problem("planar3r", start=start, path="circle:0.05"), **few)
    assert study.setting["path options"] == "--path circle:0.05:180 --plane xy"


# ---- waypoints from a file -----------------------------------------------------------------------

GOOD = ["0.45,0,0.25", "0.5,0,0.25", "0.5,0.05,0.25", "0.45,0,0.25"]
"""Within reach of the arm to copy."""


def loop(lines: list[str], file: str = "loop.csv") -> list[str]:
    Path(file).write_text("\n".join(lines) + "\n", encoding="utf-8")
    return ["follow", MY_ARM, "--strategy", "pseudoinverse", "--steps", "60", "--path", file]


def test_a_file_is_followed_and_named(tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    data = told(capsys, *loop(["x, y, z", *GOOD], "my loop.csv"))
    assert (data["path"], data["path_spec"], data["plane"]) == ("my loop.csv", "my loop.csv", None)
    assert (
        data["tracking_error"] < 1e-6
        and "the start was moved to the first point of the path" in data["notes"]
    )
    assert main(loop(["x, y, z", *GOOD], "my loop.csv")) == 0
    assert "path options    --path 'my loop.csv'\n" in capsys.readouterr().out


UNREACHABLE = {
    "a point of the file": (
        ["x,y,z", *GOOD[:2], "0.5,3,0.25", GOOD[0]],
        "loop.csv, line 4: ",
        "reach [0.5 , 3.",
    ),
    "the first point": (
        ["3,0,0.25", "3.1,0,0.25", "3.1,0.1,0.25", "3,0,0.25"],
        "loop.csv, line 1: ",
        "long; move",
    ),
    "millimetres": (
        ["450,0,250", "500,0,250", "500,50,250", "450,0,250"],
        "line 1: ",
        "are the numbers mm?",
    ),
    "millimetres of an arm too short": (
        ["4500,0,250", "5000,0,250", "5000,50,250", "4500,0,250"],
        "line 1",
        "and the arm is at most 1.02 m long",
    ),
    "counted from the start": (
        ["0,0,0", "0.05,0,0", "0.05,0.05,0", "0,0,0"],
        "line 1: ",
        "counted from the start?",
    ),
}


@pytest.mark.parametrize("case", some(UNREACHABLE, "millimetres", "the first point"))
def test_what_is_out_of_reach_is_named_by_its_line(
    case: str, tmp_path, monkeypatch, capsys
) -> None:
    monkeypatch.chdir(tmp_path)
    lines, where, why = UNREACHABLE[case]
    error = refused(capsys, *loop(lines))
    assert where in error and why in error
    assert ("mm?" in error) == (case == "millimetres") and ("from the start?" in error) == (
        case[:7] == "counted"
    )


def test_a_way_out_of_reach_between_two_points_is_named_by_both(
    tmp_path, monkeypatch, capsys
) -> None:
    """Links of 1, 0.3 and 0.3 m leave a hole of 0.4 m round the base: both points can be reached,
    not the way."""
    monkeypatch.chdir(tmp_path)
    planar_task([1, 0.3, 0.3], tmp_path)
    loop(["1.2,0,0", "1,1,0", "-0.8,-1,0", "1.2,0,0"])
    error = refused(
        capsys, "follow", "planar3.urdf", "--strategy", "pseudoinverse", "--path", "loop.csv"
    )
    assert "loop.csv, between line 2 and line 3: 'tool' does not reach [" in error


MISWRITTEN = {
    "semicolons": (
        [line.replace(",", ";") for line in GOOD],
        "line 1: the columns are separated by semicolons or blanks",
    ),
    "semicolons below names": (
        ["x;y;z", *(line.replace(",", ";") for line in GOOD)],
        "loop.csv, line 1: the columns are separated by semicolons or blanks",
    ),
    "decimal commas": (
        [line.replace(",", ";").replace(".", ",") for line in GOOD],
        "use decimal points",
    ),
    "spaces": (
        [line.replace(",", " ") for line in GOOD],
        "line 1: the columns are separated by semicolons or blanks",
    ),
    "a letter in the first line": (["O.45,0,0.25", *GOOD[1:]], "line 1: x = 'O.45' is not a"),
    "powers of ten": (["4.5e-1;0;2.5e-1", *GOOD[1:]], "line 1: "),
}


@pytest.mark.parametrize("case", MISWRITTEN)
def test_a_first_line_is_passed_over_only_if_it_names_columns(
    case: str, tmp_path, monkeypatch, capsys
) -> None:
    monkeypatch.chdir(tmp_path)
    lines, words = MISWRITTEN[case]
    assert words in refused(capsys, *loop(lines))


def test_a_file_has_no_plane(tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    for command in (
        [*loop(GOOD), "--plane", "xy"],
        ["study", MY_ARM, "--path", "loop.csv", "--plane", "xz"],
    ):
        assert "loop.csv already lie in space; omit the plane" in refused(capsys, *command)
    assert "--plane requires --path" in refused(capsys, "design", "panda", "--plane", "xz")
    assert [p.name for p in tmp_path.iterdir()] == ["loop.csv"]


def test_the_help_of_a_study_says_what_a_path_is(capsys) -> None:
    with pytest.raises(SystemExit):
        main(["study", "--help"])
    shown = capsys.readouterr().out
    text = " ".join(shown.split())
    for words in (
        "circle:RADIUS:DEGREES",
        "turned until the arm can follow it",
        "x,y,z per line in the frame of the base, closed",
    ):
        assert words in text
    assert "default: the first that leaves redundancy" in text
    assert len(shown.splitlines()) <= 50
