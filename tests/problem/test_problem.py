"""Problems: checked, complete, and where every command begins."""

from __future__ import annotations

import copy
import json
import pickle
from pathlib import Path

import numpy as np
import pytest
from commands import main

import repctl_pin as rp

QUICK = {"cycles": 1, "steps": 40, "degree": 1}


@pytest.fixture(scope="module")
def problem() -> rp.Problem:
    return rp.Problem("planar4r", path="square:0.1", region=0.3)


def test_what_is_not_given_is_chosen() -> None:
    problem = rp.Problem("planar4r")
    task = problem.task
    assert (task.kind, task.r) == ("xy", 2) and problem.given == frozenset()
    begin = problem.path.placement(0.0)
    assert np.abs(task.error(problem.start, begin)).max() < 1e-6
    plain = rp.Pseudoinverse(task)
    motion = rp.follow(plain, problem.path, problem.start, cycles=1, steps=60)
    assert motion.limit_margin.min() > 0
    assert problem.region.contains(motion.q[::10]).all()
    assert problem.notes == [f"the start is {problem.start_is}"]


def test_what_is_given_is_kept(problem: rp.Problem) -> None:
    start = problem.start + 0.01
    given = rp.Problem(problem.task, start=start, path=problem.path, region=rp.Box(start, 0.2))
    assert given.given == {"start", "path", "region"} and given.path is problem.path
    assert given.notes == ["the start was moved to the first point of the path"]
    assert given.task is problem.task and given.region.half_width[0] == 0.2
    same = rp.Problem(problem.task, start=problem.start, path=problem.path)
    assert np.array_equal(same.start, problem.start) and same.notes == []


def test_a_start_can_be_a_pose_of_the_robot() -> None:
    xarm = rp.Robot.load("xarm7")
    ready = rp.Problem(xarm, start="ready", path=False)
    assert np.array_equal(ready.start, xarm.poses["ready"]) and ready.path is None
    assert ready.start_is == "the ready pose"
    with pytest.raises(rp.InputError, match="no pose 'redy'; did you mean 'ready'"):
        rp.Problem(xarm, start="redy", path=False)


def test_a_region_is_made_at_the_start() -> None:
    def box(task: rp.Task, q0: np.ndarray) -> rp.Box:
        return rp.Box(q0, 0.1).inside(task.lower, task.upper)

    problem = rp.Problem("planar3r", path=False, region=box)
    assert np.array_equal(problem.region.center, problem.start)
    assert rp.Problem("planar3r", path=False, region=0.1).region.half_width[0] == 0.1


@pytest.mark.parametrize(
    ("parts", "argument", "words"),
    [
        ({"start": [0.1, 0.2]}, "start", "start has 2 numbers, but 'tool' is moved by 4 joints"),
        ({"start": [0.1, 0.2, 9e9, 0.1]}, "start", "is outside its limits"),
        ({"path": 3}, "path", "path must be a closed path"),
        ({"path": lambda task: None}, "path", "path must be a closed path"),
        ({"path": "spiral:1"}, "", "no path 'spiral:1'"),
        ({"path": False, "plane": "xy"}, "plane", "take a plane; omit plane="),
        ({"plane": "zz"}, "", "no plane 'zz'"),
        ({"region": "wide"}, "region", "region must be a half-width, rad, or a region"),
        ({"region": rp.Box([0.0, 0.0], 0.1)}, "region", "region has 2 joints, but 'tool'"),
        ({"region": lambda task, q0: 3}, "the result of region", "must be a region"),
        ({"kind": "pose"}, "", "redundant here: xy"),
    ],
)
def test_a_part_that_cannot_be_used_is_named(parts: dict, argument: str, words: str) -> None:
    with pytest.raises(rp.InputError) as caught:
        rp.Problem("planar4r", **parts)
    assert caught.value.argument == argument and words in str(caught.value)


def test_a_task_has_its_own_frame_and_kind(problem: rp.Problem) -> None:
    with pytest.raises(rp.InputError, match="^kind is part of the task already; omit kind=$"):
        rp.Problem(problem.task, kind="xy")


def test_a_problem_without_a_path_has_no_tube() -> None:
    problem = rp.Problem("planar3r", path=False)
    with pytest.raises(rp.InputError, match="this problem has no path"):
        problem.region  # noqa: B018
    with pytest.raises(rp.InputError, match="this problem has no path"):
        rp.study(problem)


def test_a_problem_reads_as_words(problem: rp.Problem) -> None:
    assert repr(problem) == (
        "<Problem of planar4r tool, xy: square of side 0.1 m in xy "
        f"from {problem.start_is}, Ω {problem.region}>"
    )
    assert "no path" in repr(rp.Problem("planar3r", path=False))
    assert problem == problem and problem != copy.copy(problem) and len({problem}) == 1
    with pytest.raises(ValueError, match="read-only"):
        problem.start[0] = 1.0
    with pytest.raises(AttributeError):
        problem.start = np.zeros(4)


@pytest.mark.slow
def test_a_study_of_default_parts_is_the_same_from_both_forms(quick_choices: None) -> None:
    once, again = rp.study("ppr", **QUICK), rp.study(rp.Problem("ppr"), **QUICK)
    assert json.dumps(once.as_dict()) == json.dumps(again.as_dict())


def test_errors_have_parts() -> None:
    with pytest.raises(rp.InputError) as caught:
        rp.Robot.load("ppr", package_dirs=["nope"])
    error = caught.value
    assert (
        error.argument == "package_dirs"
        and error.remedy == "give the path of an existing folder"
        and error.at is None
    )
    text = "package_dirs: there is no folder 'nope'; give the path of an existing folder"
    assert str(error) == text
    error.argument, error.remedy = "--package-dir", "name another"
    assert str(error).startswith("--package-dir: there") and str(error).endswith("; name another")
    back = pickle.loads(pickle.dumps(error))
    assert (str(back), back.argument, back.remedy) == (str(error), error.argument, error.remedy)


def test_an_error_of_a_cell_keeps_its_parts_when_copied() -> None:
    error = rp.NoFunctionError("no function", (), 0.5, partly=True, remedy="move it")
    back = pickle.loads(pickle.dumps(error))
    assert (back.fits, back.partly, str(back)) == (0.5, True, "no function; move it")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["inspect", "ppr", "--package-dir", "nope"], "--package-dir: there is no folder 'nope'"),
        (["study", "ppr", "--start", "1,2"], "--start has 2 numbers"),
        (["design", "ppr", "--start", "1,2"], "--start has 2 numbers"),
        (["check", "ppr", "--start", "1,2,1e9"], "--start: "),
        (
            ["study", "ppr", "--path", "loop.csv", "--plane", "xy"],
            "--plane: the points of the file loop.csv",
        ),
        (
            ["design", "planar4r", "--fourier", "99", "--degree", "1"],
            "--fourier 99: a Fourier basis of order 99 in 4",
        ),
    ],
)
def test_the_command_line_names_options(
    arguments: list[str],
    words: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "loop.csv").write_text("x,y,z\n0,0,0\n1,0,0\n0,0,0\n")
    assert main(arguments) == 2
    assert capsys.readouterr().err.startswith(f"repctl: {words}")


def test_the_library_names_no_option(tmp_path: Path) -> None:
    """Messages of the rooms below the command line name arguments, whose options it knows."""
    package = Path(rp.__file__).parent
    named = [
        "--package-dir",
        "--lock",
        "--base",
        "--degree",
        "--frame",
        "--plane",
        "--start",
        "--region",
    ]
    rooms = ("robot", "urdf", "problem", "studies", "motion", "design", "inverse_function")
    files = [file for room in rooms for file in (package / room).glob("*.py")]
    assert len(files) > 40
    spec = "motion/parse_path.py", "paths/task_path.py"
    for file in files:
        if str(file.relative_to(package)) not in spec:
            assert not [option for option in named if option in file.read_text()], file
