"""What a study says in its first line and notes, and which start it takes."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from arms import planar_urdf
from commands import main
from matplotlib.figure import Figure
from store import study_of

import repctl_pin as rp
from repctl_pin.studies.study import edge_warning

NO_BETTER = "no default start keeps the joints within limits"
QUICK = {"cycles": 2, "steps": 60, "degree": 1}


@pytest.fixture(scope="module")
def planar() -> rp.Study:
    return study_of("planar4r")


@pytest.mark.slow
def test_why_a_kind_was_taken_is_said_where_nobody_chose_it(planar: rp.Study) -> None:
    """Where it was given, test_study.py finds no such note."""
    assert "using task xy, because 4 joints are not redundant for a pose task" in planar.notes


def test_a_lost_motion_does_not_stretch_the_period(tmp_path: Path) -> None:
    """With so few steps that the arm leaves the path, at several times the speed limits;
    with more steps the period is increased, see test_deployed.py."""
    text = rp.Robot.load("planar4r").description.xml
    slow = re.sub(r'velocity="[^"]*"', 'velocity="0.05"', text)
    (tmp_path / "slow.urdf").write_text(slow, encoding="utf-8")
    problem = rp.Problem(tmp_path / "slow.urdf", path="circle:0.5", region=0.1)
    study = rp.study(problem, cycles=1, steps=4, degree=1)
    motion = study.row("repeatable").motion
    assert motion.path_loss[0] <= 1 and motion.speed_ratio > 2
    assert "with 4 and 8 steps per cycle" in study.row("pseudoinverse").stopped
    assert study.period == 5.0
    assert not [note for note in study.notes if "period" in note]


def test_a_start_beside_which_the_motion_goes_elsewhere_is_named(planar: rp.Study) -> None:
    row, task = planar.rows[0], planar.task
    options = {"cycles": 3, "steps": 60, "period": planar.period}
    plain = rp.Pseudoinverse(task)
    assert edge_warning(row, plain, planar.path, planar.q0, options) == []
    elsewhere = replace(
        row, motion=replace(row.motion, q=row.motion.q + 0.01 * (row.motion.t > 0)[:, None])
    )
    (note,) = edge_warning(elsewhere, plain, planar.path, planar.q0, options)
    assert "the start is on an edge" in note and "ends cycle 1 0.02 rad away" in note
    (note,) = edge_warning(
        replace(row, motion=None, stopped="why"), plain, planar.path, planar.q0, options
    )
    assert "the motion goes on" in note


@pytest.mark.slow
def test_a_default_start_keeps_limits_where_another_does(
    planar: rp.Study, only_starts: Callable[..., None]
) -> None:
    """The first start offered is at a limit, the second is not."""
    task = planar.task
    at_limit = planar.q0.copy()
    at_limit[0] = task.upper[0] - 1e-3
    both = [(at_limit, "first"), (planar.q0, "second")]
    only_starts(*both)
    path = lambda task, q0: rp.circle(task, q0, 0.1)  # noqa: E731
    study = rp.study(rp.Problem("planar4r", path=path), **QUICK)
    assert "the start is second" in study.notes and not study.row("repeatable").violations
    assert (
        rp.study(rp.Problem("planar4r", path=path, start=at_limit), **QUICK)
        .row("repeatable")
        .violations
    )
    only_starts((at_limit, "first"))
    notes = rp.study(rp.Problem("planar4r", path=path), **QUICK).notes
    assert [note for note in notes if note.startswith(NO_BETTER)]


def test_follow_says_that_default_starts_were_tried(
    planar: rp.Study, only_starts: Callable[..., None], capsys: pytest.CaptureFixture[str]
) -> None:
    at_limit = planar.q0.copy()
    at_limit[0] = planar.task.upper[0] - 1e-3
    only_starts((at_limit, "first"))
    assert (
        main(
            [
                "follow",
                "planar4r",
                "--path",
                "square:0.1",
                "--strategy",
                "pseudoinverse",
                "--steps",
                "60",
            ]
        )
        == 0
    )
    assert f"your own --start ({NO_BETTER}" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.usefixtures("all_starts")
def test_a_dear_start_gives_way_to_a_cheap_one_or_is_explained(tmp_path: Path) -> None:
    """An arm like the iiwa: from mid-range J⁺ drifts by 0.56 rad in a cycle, to where the same
    circle takes less."""
    from controls import iiwa

    robot = iiwa(tmp_path)
    few = {"cycles": 1, "steps": 100, "degree": 1}
    chosen = rp.study(rp.Problem(robot, frame="flange"), **few)
    first = rp.Problem(chosen.task, path=False).start
    dear = rp.study(rp.Problem(robot, frame="flange", start=first), **few)
    cheap, price = (
        study.row("repeatable").motion.first_rms_speed / study.rows[0].motion.first_rms_speed - 1
        for study in (chosen, dear)
    )
    assert cheap < 0.05 < price
    (note,) = [note for note in dear.notes if "at the same configurations" in note]
    same = (
        float(
            re.match(
                r"joint speed: ([+-][\d.]+) % relative to J⁺ at the same configurations", note
            )[1]
        )
        / 100
    )
    motion, plain = dear.row("repeatable").motion, rp.Pseudoinverse(dear.task)
    Q, V = motion.q[:100], motion.qdot[:100]
    least = [plain.velocity(q, dear.task.jacobian(q) @ v) for q, v in zip(Q, V, strict=True)]
    assert same == pytest.approx(np.sqrt((V**2).sum() / np.sum(np.square(least))) - 1, abs=6e-4)
    assert 0 < same < price


@pytest.mark.slow
def test_many_joints_are_studied_at_once_or_it_is_said_what_takes_long(tmp_path: Path) -> None:
    (tmp_path / "long.urdf").write_text(planar_urdf([0.1] * 11))
    study = rp.study(rp.Problem(str(tmp_path / "long.urdf"), region=0.1), cycles=1, steps=40)
    assert study.row("repeatable").motion.closes
    why = "11 joints never move tool in all coordinates of a pose task"
    assert f"using task xy, because {why}" in study.notes
    (note,) = [note for note in study.notes if note.startswith("degree 1 is used")]
    assert "for 11 joints" in note and "--" not in note
    said: list[str] = []

    def say(text: str) -> None:
        said.append(text)
        if "%" in text and "degree" in text:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        rp.study(rp.Problem(str(tmp_path / "long.urdf"), region=0.1), degree=2, progress=say)
    assert said[-1].startswith("designing the nearest repeatable inverse, degree 2: ")
    (note,) = [text for text in said if text.startswith("note: ")]
    assert re.fullmatch(
        r"note: a design of degree 2 for 11 joints takes about \d+ s; a lower degree .*", note
    )
    (tmp_path / "longer.urdf").write_text(planar_urdf([0.02] * 60))
    with pytest.raises(
        rp.InputError, match="a study of 60 joints takes about .* even at degree 1; choose a frame"
    ):
        rp.study(str(tmp_path / "longer.urdf"))


def test_a_design_that_fails_on_its_own_cycle_is_blamed_not_the_path(
    planar: rp.Study, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = rp.follow

    def failing(strategy, *args, **options):
        if isinstance(strategy, rp.RepeatableInverse):
            raise rp.SingularityError("the path is out of reach")
        return real(strategy, *args, **options)

    monkeypatch.setattr("repctl_pin.studies.around_motion.followed", failing)
    why = (
        "^the design fails on the cycle it was made for, which J⁺ can follow; "
        "choose another start, a smaller path or another degree$"
    )
    with pytest.raises(rp.SingularityError, match=why):
        rp.study(rp.Problem("planar4r", start=planar.q0, path=planar.path), **QUICK)


@pytest.mark.slow
@pytest.mark.pictures
def test_files_name_their_run_and_it_is_the_control_files_checksum(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The figures are empty, but files as they are written for a user."""
    monkeypatch.chdir(tmp_path)
    save = Figure.savefig
    monkeypatch.setattr(Figure, "savefig", lambda _, file, **how: save(Figure((1, 1)), file, **how))
    command = ["study", "planar4r", "--cycles", "1", "--steps", "40", "--degree", "1"]
    command += ["--region", "0.2", "--json"]
    assert main([*command, "--report"]) == 0
    run = json.loads(capsys.readouterr().out)["run"]
    folder = tmp_path / "repctl-out" / "planar4r"
    checksum = json.loads((folder / "control.json").read_text())["checksum"]
    assert checksum.removeprefix("sha256:").startswith(run.partition("-")[0])
    for name in ("animation.html", "drift.png", "joints.png", "motion.csv", "report.html"):
        assert run.encode() in (folder / name).read_bytes(), name
    with open(folder / "motion.csv", encoding="utf-8", newline="") as file:
        labels = [row[0] for row in csv.reader(file)]
    assert len(set(labels[1:])) == 4
    (folder / "joints.png").unlink()
    (folder / "joints.png").mkdir()  # where no file can be written
    before = {file: file.read_bytes() for file in folder.iterdir() if file.is_file()}
    assert main([*command, "--cycles", "2"]) == 2
    assert {file: file.read_bytes() for file in folder.iterdir() if file.is_file()} == before


@pytest.mark.slow
def test_speed_limits_of_0_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = planar_urdf([0.4, 0.3, 0.2])
    slow = re.sub(r'velocity="[^"]*"', 'velocity="0"', text, count=1)
    assert slow != text
    (tmp_path / "arm.urdf").write_text(slow)
    assert main(["inspect", str(tmp_path / "arm.urdf")]) == 0
    assert "note: speed limit 0 of joint 'theta1' read as no limit" in capsys.readouterr().out
    study = rp.study(str(tmp_path / "arm.urdf"), cycles=1, steps=40, degree=1)
    assert "no speed limit in the model, so speeds are not checked: theta1" in study.notes


def test_results_are_short_at_the_prompt(planar: rp.Study) -> None:
    for thing in (planar.path, planar.region, planar):
        assert len(repr(thing)) < 200 and "0x" not in repr(thing) and "array" not in repr(thing)
    lines = planar.summary().splitlines()
    assert len(lines) == 1 + len(planar.rows) and "3 cycles" in lines[0]
    for row, line in zip(planar.rows, lines[1:], strict=True):
        assert row.label in line and f"{row.motion.drift[-1]:.2g} after 3" in line


def test_animate_knows_the_surroundings(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    asked = [
        "animate",
        "planar4r",
        "--surroundings",
        str(tmp_path / "missing.urdf"),
        "--out",
        str(tmp_path / "out"),
    ]
    assert main(asked) == 2
    assert "missing.urdf: no such file" in capsys.readouterr().err


def test_an_unknown_robot_leads_to_its_urdf() -> None:
    with pytest.raises(rp.InputError, match="for any other robot, give its URDF file"):
        rp.Robot.load("gen3")


def test_what_regions_and_messages_say_is_so() -> None:
    """A region must grow to reach a point outside: the factor is above 1 there."""
    box = rp.Box([0.0, 0.0], 0.5)
    assert box.ratio([[1.0, 0.0]]) == [2.0]
    for region in (rp.Box, rp.Tube, rp.WorkspaceBox):
        words = " ".join(region.ratio.__doc__.split())
        assert re.match("Compute the scale at which the (region|box|tube)'s boundary", words)
        assert re.search("above 1( for a row)? (is )?outside", words.lower()), words
