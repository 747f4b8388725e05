"""Ctrl-C at the worst moments, and arguments that cannot be used: one line each, and the right exit
code."""

from __future__ import annotations

import json
import os
import signal
import stat
import subprocess
import sys
import threading
import time
import weakref
from pathlib import Path
from unittest.mock import Mock

import pytest
from arms import planar_urdf
from commands import main, refused
from matplotlib.figure import Figure

import repctl_pin as rp

DEVICES = {"full": os.makedev(1, 7), "zero": os.makedev(1, 5)}


def repctl(*arguments: str, cwd: Path, **options) -> subprocess.CompletedProcess:
    """The command in a process of its own; what it writes comes back as bytes."""
    options = {
        "stdout": subprocess.PIPE,
        "stderr": subprocess.PIPE,
        "stdin": subprocess.DEVNULL,
    } | options
    return subprocess.run(
        [sys.executable, "-m", "repctl_pin", *arguments], cwd=cwd, timeout=120, **options
    )


@pytest.fixture
def node(tmp_path: Path):
    """Make a device node in the test's own folder."""

    def make(kind: str) -> Path:
        try:
            os.mknod(tmp_path / kind, 0o600 | stat.S_IFCHR, DEVICES[kind])
            (tmp_path / kind).open("rb").close()
        except OSError:
            pytest.skip("no device nodes here")
        return tmp_path / kind

    return make


@pytest.mark.skipif(sys.platform == "win32", reason="signals are POSIX's")
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP], ids=lambda number: number.name)
def test_stopped_while_it_writes_no_file_is_left(
    number: signal.Signals,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """The signal comes when the file's content was written, and before it has its name."""
    monkeypatch.chdir(tmp_path)
    there: list[Path] = []

    def stopped(handle: int) -> None:
        there.extend(tmp_path.iterdir())
        signal.raise_signal(number)

    monkeypatch.setattr(os, "fsync", stopped)
    small = ["follow", "ppr", "--strategy", "pseudoinverse", "--steps", "40", "--allow-violations"]
    before = signal.signal(number, signal.SIG_DFL)  # under nohup it would be ignored
    try:
        assert main([*small, "--csv", "m.csv"]) == 128 + number
    finally:
        signal.signal(number, before)
    assert [file.name.startswith(".repctl-") for file in there] == [True]
    assert list(tmp_path.iterdir()) == []
    told = capsys.readouterr().err
    assert told == f"repctl: stopped by {number.name}; no incomplete file was left\n"


@pytest.mark.skipif(sys.platform == "win32", reason="signals are POSIX's")
def test_a_stop_inside_a_finaliser_is_not_lost(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Python drops exceptions that are raised there."""
    dropped = threading.Event()

    def finalise(reference: object) -> None:
        signal.raise_signal(signal.SIGTERM)
        dropped.set()

    class Thing:
        pass

    def load(*_: object, **__: object) -> None:
        thing = Thing()
        reference = weakref.ref(thing, finalise)
        del thing
        assert reference() is None and not dropped.is_set()
        time.sleep(10)

    monkeypatch.setattr(rp.Robot, "load", load)
    before = signal.signal(signal.SIGTERM, signal.SIG_DFL)
    try:
        assert main(["inspect", "ppr"]) == 128 + signal.SIGTERM
        assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
    finally:
        signal.signal(signal.SIGTERM, before)
    told = capsys.readouterr().err
    assert told == "repctl: stopped by SIGTERM; no incomplete file was left\n"


ESCAPES = "\x1b[2J\x1b]0;title\x07\x9b2J\r\t\u202e"


def test_what_a_command_prints_controls_no_terminal(
    capsys: pytest.CaptureFixture, tmp_path: Path, monkeypatch
) -> None:
    """Texts of files, whatever reads them: on stdout, as JSON, and on stderr."""
    escaped = "\\x1b[2J\\x1b]0;title\\x07\\x9b2J\\r\\t\\u202e"
    for error in (rp.InputError(f"no {ESCAPES}"), KeyError(ESCAPES)):
        monkeypatch.setattr(rp.Robot, "load", Mock(side_effect=error))
        main(["inspect", "ppr"])
        told = capsys.readouterr()
        assert (
            told.out == ""
            and told.err.rstrip("\n").isprintable()
            and "\\x1b[2J\\x1b]0;title" in told.err
        )
    monkeypatch.undo()
    monkeypatch.chdir(tmp_path)
    follow = ["follow", "ppr", "--strategy", "pseudoinverse", "--steps", "20", "--cycles", "1"]
    for form in ([], ["--json"]):
        assert main([*follow, "--csv", f"{ESCAPES}.csv", *form]) == 0
        told = capsys.readouterr().out
        assert all(line.isprintable() for line in told.split("\n"))
        assert json.loads(told)["files"] == [f"{ESCAPES}.csv"] if form else escaped in told


def test_no_control_character_stands_in_a_robots_name(
    tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    for escape in ("&#13;", "&#9;", "&#10;forged: a line", "\x9b2J", "\u202e"):
        file = tmp_path / "arm.urdf"
        file.write_text(
            planar_urdf([1, 0.8, 0.6]).replace('"planar"', f'"arm{escape}"'), encoding="utf-8"
        )
        assert main(["inspect", str(file)]) == 2
        told = capsys.readouterr()
        assert told.out == "" and "the robot's name contains a control character" in told.err


def test_a_fault_of_ours_is_one_line_and_says_how_to_report_it(capsys, monkeypatch) -> None:
    monkeypatch.setattr(rp.Robot, "load", Mock(side_effect=ValueError("two\nlines")))
    assert main(["inspect", "pan da"]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("repctl: internal error (ValueError: two lines); please report it")
    assert line.endswith("repctl --debug inspect 'pan da'")
    with pytest.raises(ValueError):  # the traceback
        main(["--debug", "inspect", "panda"])

    monkeypatch.setattr(rp.Robot, "load", Mock(side_effect=MemoryError))
    assert main(["inspect", "panda"]) == 2 and "not enough memory" in capsys.readouterr().err


def test_a_full_disk_behind_stdout_is_one_line(tmp_path: Path, node) -> None:
    with node("full").open("wb") as out:
        done = repctl("inspect", "ppr", cwd=tmp_path, stdout=out)
    assert (done.returncode, done.stderr) == (2, b"repctl: No space left on device: the output\n")


@pytest.mark.slow
def test_a_reader_of_a_file_that_is_stdout_may_leave_early(tmp_path: Path) -> None:
    """Item 26.18: ``repctl follow … --csv /dev/stdout | head -1`` ends without a message."""
    words = ["follow", "planar3r", "--strategy", "pseudoinverse", "--steps", "1500"]
    words += ["--csv", "/dev/stdout"]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    command = [sys.executable, "-m", "repctl_pin", *words]
    with subprocess.Popen(command, cwd=tmp_path, **pipes) as process:
        assert process.stdout is not None and process.stderr is not None
        # the first line of the file, or of the report
        assert process.stdout.readline()
        process.stdout.close()
        errors = process.stderr.read().decode()
        assert process.wait(60) in (0, 128 + 13) and "repctl: " not in errors
    assert "Traceback" not in errors and not list(tmp_path.iterdir())


def test_an_endless_design_is_refused_at_once(
    tmp_path: Path, node, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "x.json").symlink_to(node("zero"))
    os.mkfifo(tmp_path / "y.json")
    os.mkfifo(tmp_path / "loop.csv")
    for arguments in (
        ["follow", "x.json"],
        ["check", "y.json"],
        ["animate", "ppr", "--motion", "loop.csv"],
        ["study", "ppr", "--path", "loop.csv"],
    ):
        assert "it is a device or a pipe" in refused(capsys, *arguments)


def test_a_working_folder_that_is_gone(tmp_path: Path) -> None:
    program = (
        "import os, sys; os.mkdir('gone'); os.chdir('gone'); os.rmdir('../gone')\n"
        "from repctl_pin.cli import main; sys.argv[1:] = ['study', 'ppr']; sys.exit(main())"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, timeout=60
    )
    assert (
        done.returncode == 2
        and done.stderr.count("\n") == 1
        and "No such file or directory" in done.stderr
    )


STUDIED = """
import sys
from repctl_pin.cli import main
code = main()
print(*sorted({"scipy.stats", "IPython", "tornado", "zmq"} & set(sys.modules)), file=sys.stderr)
sys.exit(code)
"""
"""The command, which says on stderr what it imported of what a study does not need."""


@pytest.mark.slow
def test_what_a_person_has_set_for_other_programs_does_not_matter(tmp_path: Path) -> None:
    """A study in a process of its own prints its table and writes its files, whatever is set; it
    imports no statistics and no server."""
    small = [
        "study",
        "planar3r",
        "--cycles",
        "1",
        "--steps",
        "40",
        "--region",
        "0.3",
        "--degree",
        "1",
    ]
    nonsense = {"MPLBACKEND": "nonsense", "MPLCONFIGDIR": "/dev/null", "PYTHONWARNINGS": "error"}
    done = subprocess.run(
        [sys.executable, "-c", STUDIED, *small],
        cwd=tmp_path,
        env=os.environ | nonsense,
        capture_output=True,
        text=True,
    )
    assert (done.returncode, done.stderr) == (0, "\n")  # progress is for terminals
    for word in ("tool, xy", "circle of radius ", "usual control", "repeatable", "outside"):
        assert word in done.stdout
    names = {"animation.html", "drift.png", "joints.png", "motion.csv", "control.json"}
    assert {p.name for p in (tmp_path / "repctl-out" / "planar3r").iterdir()} == names


@pytest.mark.slow
@pytest.mark.pictures
def test_names_that_are_no_text_and_names_with_dollars(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The figures are drawn, though coarsely: between dollars matplotlib reads formulas."""
    name = os.fsdecode(b"arm\xff.urdf")
    urdf = (
        planar_urdf([1, 0.8, 0.6]).replace('"planar"', '"arm_$a_$b"').replace("theta", "$th$eta_{")
    )
    monkeypatch.chdir(tmp_path)
    try:
        Path(name).write_text(urdf, encoding="utf-8")
    except OSError:
        name = "arm.urdf"  # where names must be text
        Path(name).write_text(urdf, encoding="utf-8")
    save = Figure.savefig
    monkeypatch.setattr(Figure, "savefig", lambda *given, **how: save(*given, **how | {"dpi": 30}))
    small = ("--cycles", "1", "--steps", "24", "--region", "0.3", "--degree", "1")
    assert main(["study", name, *small, "--report", "--out", "out"]) == 0
    assert capsys.readouterr().err == ""
    assert {"animation.html", "drift.png", "joints.png", "motion.csv", "report.html"} <= {
        p.name for p in (tmp_path / "out").iterdir()
    }


@pytest.mark.parametrize("name", ["", ".", "/"])
def test_files_that_cannot_be(name: str, tmp_path: Path, capsys, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    for option in ("--csv", "--yaml"):
        assert (
            main(["follow", "ppr", "--strategy", "pseudoinverse", "--steps", "40", option, name])
            == 2
        )
        told = capsys.readouterr()
        assert told.out == "" and told.err.count("\n") == 1 and "cannot write" in told.err


def test_names_that_are_too_long(capsys) -> None:
    for arguments in (
        ["inspect", "ppr", "--package-dir", "x" * 5000],
        ["follow", "ppr", "--path", "x" * 5000],
    ):
        assert main(arguments) == 2
        assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["stuy", "panda"], "no command 'stuy'; did you mean 'study'?"),
        (
            ["study", "panda", "--fraem", "x"],
            "repctl study: no option '--fraem'; did you mean '--frame'",
        ),
        (
            ["study", "panda", "--fraem=x"],
            "repctl study: no option '--fraem'; did you mean '--frame'",
        ),
        (["study", "panda", "more"], "repctl study: unexpected argument 'more'"),
        (["study"], "repctl study: the following arguments are required: ROBOT"),
        (
            ["study", "panda", "--cycles", "0"],
            "repctl study: argument --cycles: '0' is not a whole number",
        ),
        (
            ["study", "panda", "--seed", "-1"],
            "argument --seed: '-1' is not a whole number from 0 up",
        ),
        (["study", "panda", "--cycles", "9" * 5000], "is not a whole number from 1 up"),
        (["study", "panda", "--cycles", "²"], "is not a whole number from 1 up"),
    ],
)
def test_arguments_are_refused_in_one_line(
    arguments: list[str], words: str, capsys: pytest.CaptureFixture
) -> None:
    with pytest.raises(SystemExit) as stopped:
        main(arguments)
    told = capsys.readouterr()
    assert stopped.value.code == 2 and told.out == ""
    (line,) = told.err.splitlines()
    assert words in line and line.startswith("repctl")
    assert line.endswith(" --help)")


def test_without_arguments_it_helps(capsys: pytest.CaptureFixture) -> None:
    assert main([]) == 2
    assert "examples:" in capsys.readouterr().err


@pytest.mark.slow
def test_a_terminal_that_knows_no_greek_gets_question_marks(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "repctl_pin", "check", "ppr"],
        cwd=tmp_path,
        env={"PATH": "/usr/bin:/bin", "PYTHONIOENCODING": "ascii"},
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 0 and "strategy  J?" in done.stdout and done.stderr == ""
