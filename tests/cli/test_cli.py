"""The command line: what it prints, its exit codes, and that nothing crashes it."""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import pytest
from arms import heed_interrupts
from commands import computed_once, main, parsers
from controls import some

import repctl_pin as rp

PANDA_START = "0,-0.785,0,-2.356,0,1.571,0.785"
BENT = ("study", "planar3r", "--start", "0.3,0.8,0.8")


def repctl(*arguments: str, cwd: Path) -> subprocess.CompletedProcess:
    """Run the command here, where all libraries are loaded already."""
    out, err, before = io.StringIO(), io.StringIO(), Path.cwd()
    os.chdir(cwd)
    try:
        with redirect_stdout(out), redirect_stderr(err):
            code = main(list(arguments))
    except SystemExit as ended:
        code = ended.code
    finally:
        os.chdir(before)
    return subprocess.CompletedProcess(arguments, code, out.getvalue(), err.getvalue())


def refused(done: subprocess.CompletedProcess, *words: str) -> None:
    """One line on stderr that says these words, exit code 2, nothing else."""
    assert done.returncode == 2, (done.returncode, done.stdout, done.stderr)
    lines = done.stderr.strip().splitlines()
    assert lines and "Traceback" not in done.stderr
    assert lines[-1].startswith("repctl"), done.stderr
    for word in words:
        assert word in lines[-1], lines[-1]
    assert done.stdout == ""


def test_json_has_null_for_infinite_numbers(tmp_path: Path) -> None:
    """The joints of kinova without limits; JSON has no infinity, though Python would read one."""

    def unknown(word: str) -> None:
        raise AssertionError(f"{word} is no JSON")

    done = repctl("inspect", "kinova", "--json", cwd=tmp_path)
    joints = json.loads(done.stdout, parse_constant=unknown)["joints"]
    endless = [joint for joint in joints if joint["kind"] == "continuous"]
    assert endless and {joint["lower"] for joint in endless} == {None}
    assert all(isinstance(joint["reference"], float) for joint in joints)


def test_json_and_quiet(tmp_path, monkeypatch) -> None:
    """One study, reported twice."""
    monkeypatch.setattr(rp, "study", computed_once(rp.study))
    options = (
        "--cycles",
        "1",
        "--steps",
        "60",
        "--degree",
        "1",
        "--region",
        "0.3",
        "--start",
        "-0.1,1,1",
        "--path",
        "square:0.1",
    )
    done = repctl("study", "planar3r", *options, "--json", "--out", "here", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    data = json.loads(done.stdout)
    assert data["start"][0] == -0.1 and data["path"].startswith("square of side 0.1")
    assert (tmp_path / "here" / "animation.html").is_file()
    done = repctl("study", "planar3r", *options, "--quiet", "--out", "there", cwd=tmp_path)
    assert done.returncode == 0 and done.stdout == done.stderr == ""


def test_robots_and_inspect(tmp_path, monkeypatch) -> None:
    """Two robots of the catalogue, and a small one for all others; test_readme.py lists all in a
    slow test."""
    load, small = rp.Robot.load, rp.Robot.load("planar3r")
    with monkeypatch.context() as patch:
        patch.setattr(
            rp.Robot, "load", lambda name: load(name) if name in ("panda", "baxter") else small
        )
        done = repctl("robots", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    rows = {row["frame"]: row for row in json.loads(done.stdout)}
    assert (
        rows["panda_hand_tcp"]["chain"] == 7 and rows["panda_hand_tcp"]["redundancy"]["pose"] == 1
    )
    assert rows["right_gripper"]["redundancy"]["position"] == 4
    done = repctl("inspect", "panda", cwd=tmp_path)
    assert (
        done.returncode == 0
        and "panda_joint4" in done.stdout
        and "follows panda_finger_joint1" in done.stdout
    )


BAD_ARGUMENTS = {
    "one file for two": (
        ["follow", "panda", "--csv", "x", "--yaml", "x"],
        ["--csv", "--yaml", "another name"],
    ),
    "unknown robot": (["study", "pandda"], ["no robot 'pandda'", "did you mean 'panda'"]),
    "missing file": (["study", "my/arm.urdf"], ["my/arm.urdf"]),
    "unknown frame": (
        ["study", "panda", "--frame", "panda_hand_tpc"],
        ["did you mean 'panda_hand_tcp'"],
    ),
    "unknown joint": (["study", "panda", "--lock", "panda_joint77"], ["no joint", "did you mean"]),
    "unknown base": (["study", "panda", "--base", "panda_link99"], ["did you mean"]),
    "unknown kind": (["study", "panda", "--task", "poses"], ["no task kind 'poses'", "position"]),
    "start too short": (["study", "panda", "--start", "0,0,0"], ["3 numbers", "7 joints"]),
    "start not numbers": (["study", "panda", "--start", "zero"], ["not a list of numbers"]),
    "start nan": (
        ["study", "panda", "--start", "nan" + PANDA_START[1:]],
        ["panda_joint1", "finite"],
    ),
    "start out of limits": (
        ["study", "panda", "--start", "9" + PANDA_START[1:]],
        ["panda_joint1", "limits"],
    ),
    "start singular": (["study", "planar3r", "--start", "0.1,0,0"], ["singularity"]),
    "unknown path": (["study", "panda", "--path", "spiral:1"], ["circle:RADIUS"]),
    "negative circle": (["study", "panda", "--path", "circle:-1"], ["above 0"]),
    "circle too large": ([*BENT, "--path", "circle:5"], ["no circle"]),
    "square too large": ([*BENT, "--path", "square:5"], ["cannot reach"]),
    "unknown plane": (["study", "panda", "--plane", "ab"], ["no plane 'ab'"]),
    "no such csv": (["study", "panda", "--path", "none.csv"], ["none.csv"]),
    "cycles zero": (["study", "panda", "--cycles", "0"], ["whole number"]),
    "degree word": (["study", "panda", "--degree", "two"], ["whole number"]),
    "degree huge": (["study", "panda", "--degree", "30"], ["lower the degree"]),
    "region negative": (["study", "panda", "--region", "-1"], ["above 0"]),
    "region singular": (["study", "planar3r", "--region", "3"], ["loses rank", "--region"]),
    "no redundancy": (["study", "ur5", "--task", "pose"], ["r = 0", "position (r = 3)"]),
    "unknown command": (["stduy", "panda"], ["stduy"]),
}


@pytest.mark.parametrize("case", BAD_ARGUMENTS)
def test_bad_arguments_get_one_clear_line(tmp_path, case: str) -> None:
    arguments, words = BAD_ARGUMENTS[case]
    refused(repctl(*arguments, cwd=tmp_path), *words)
    assert list(tmp_path.iterdir()) == []  # nothing written half, and no folder


def test_an_output_folder_that_cannot_be_written(tmp_path) -> None:
    (tmp_path / "taken").write_text("a file, not a folder")
    done = repctl("study", "panda", "--out", "taken/inside", cwd=tmp_path)
    refused(done, "cannot write into taken/inside", "Not a directory", "--out")
    assert (tmp_path / "taken").read_text() == "a file, not a folder"


def test_a_broken_urdf_reaches_the_command_line_as_one_line(tmp_path) -> None:
    (tmp_path / "arm.urdf").write_text("<robot name='a'><link name='x'/><link name='y'/></robot>")
    refused(repctl("inspect", "arm.urdf", cwd=tmp_path), "arm.urdf", "line")
    refused(repctl("study", "arm.urdf", cwd=tmp_path), "arm.urdf", "line")


@pytest.mark.slow
def test_a_urdf_of_ones_own_without_its_meshes(tmp_path) -> None:
    text = rp.Robot.load("xarm7").description.path.read_text(encoding="utf-8")
    (tmp_path / "mine.urdf").write_text(text.replace("package://", "package://not_here/"))
    small = ["--cycles", "1", "--steps", "60", "--degree", "1"]
    done = repctl("study", "mine.urdf", *small, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "meshes missing: --package-dir DIR" in done.stdout
    assert (tmp_path / "repctl-out" / "mine" / "animation.html").is_file()


def test_interrupt_ends_with_a_word(tmp_path) -> None:
    import signal

    code = (
        "import sys, repctl_pin as rp\n"
        "from repctl_pin.cli import main\n"
        "begin = rp.Problem\n"  # modules of NumPy that it imports drop an interrupt in their C code
        "def said(*given, **options):\n"
        "    problem = begin(*given, **options)\n"
        "    print('begun', file=sys.stderr, flush=True)\n"
        "    return problem\n"
        "rp.Problem = said\n"
        "sys.argv = ['repctl', 'study', 'planar3r', '--cycles', '50000']\n"
        "sys.exit(main())\n"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=heed_interrupts,
    )
    assert process.stderr is not None and process.stderr.readline() == "begun\n"
    process.send_signal(signal.SIGINT)  # some 100 s before the study would end
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130 and "interrupted" in errors and "Traceback" not in errors
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
@pytest.mark.parametrize("asked", some([None, 2], None))
def test_one_blas_thread_unless_a_person_says_otherwise(asked: int | None, tmp_path: Path) -> None:
    code = """
import sys
sys.argv = ["repctl", "check", "ppr", "--json"]
from repctl_pin.cli import main
main()
from threadpoolctl import threadpool_info
blas = [pool for pool in threadpool_info() if pool["user_api"] == "blas"]
print({pool["num_threads"] for pool in blas}, file=sys.stderr)
"""
    environment = {
        name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")
    }
    if asked is not None:
        environment["OPENBLAS_NUM_THREADS"] = str(asked)
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, env=environment, capture_output=True, text=True
    )
    assert json.loads(done.stdout)["robot"] == "ppr"
    assert done.stderr.strip().splitlines()[-1] == str({min(asked or 1, os.cpu_count() or 1)})


@pytest.mark.slow
def test_a_report_of_before_is_said_to_be_old(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "report.html").write_text("an earlier one")
    small = ["ppr", "--cycles", "1", "--steps", "40", "--degree", "1", "--out", "out"]
    done = repctl("study", *small, cwd=tmp_path)
    assert (
        "note: report.html is from an earlier study; use --report to write a new one" in done.stdout
    )
    assert (tmp_path / "out" / "report.html").read_text() == "an earlier one"


@pytest.mark.slow
def test_a_study_opens_its_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """28.12: ``--open`` and ``.open()`` give the browser the page that was written; without a
    browser one line says so."""
    opened: list[str] = []
    monkeypatch.setattr(rp, "study", computed_once(rp.study))
    monkeypatch.setattr("webbrowser.open", lambda address: not opened.append(address))
    command = ("study", "planar3r", "--degree", "1", "--cycles", "2", "--steps", "60", "--open")
    done = repctl(*command, "--out", "here", cwd=tmp_path)
    page = tmp_path / "here" / "animation.html"
    assert done.returncode == 0 and opened == [page.as_uri()]
    monkeypatch.setattr("webbrowser.open", lambda address: False)
    done = repctl(*command, "--out", "here", cwd=tmp_path)
    assert done.returncode == 0 and "no browser was found" in done.stderr
    monkeypatch.setattr("webbrowser.open", lambda address: not opened.append(address))
    study = rp.study("planar3r", cycles=2, steps=60, degree=1)
    file = study.open()
    assert opened[-1] == file.as_uri() and "<html" in file.read_text("utf-8")


@pytest.mark.parametrize(
    "given, like",
    [
        (["help", "study"], ["study", "--help"]),
        (["help"], ["--help"]),
        (["version"], ["--version"]),
    ],
)
def test_help_and_version_are_commands_too(
    given: list[str], like: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    """28.9: words that other programs have as commands."""
    said = []
    for arguments in (given, like):
        with pytest.raises(SystemExit) as ended:
            main(arguments)
        said.append((ended.value.code, capsys.readouterr()))
    assert said[0] == said[1]
    assert said[0][0] == 0


def test_a_start_in_degrees_is_guessed(capsys: pytest.CaptureFixture[str]) -> None:
    """28.9: the message names the unit, and the same configuration in rad."""
    assert main(["study", "panda", "--start", "0,0,90,-120,0,90,45"]) == 2
    said = capsys.readouterr().err
    assert "panda_joint3 = 90 rad is outside its limits [-2.8973, 2.8973] rad" in said
    assert "give 0,0,1.571,-2.094,0,1.571,0.7854" in said


def test_a_repeated_frame_is_another_frame() -> None:
    """``--frame a --frame b`` is ``--frame a,b``; no frame is dropped."""
    parse = parsers()[""].parse_args
    assert parse(["check", "baxter", "--frame", "a", "--frame", "b"]).frame == "a,b"
    assert parse(["check", "baxter", "--frame", "a"]).frame == "a"
    assert parse(["check", "baxter"]).frame is None
