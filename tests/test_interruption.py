"""Ctrl-C at the worst moments, and arguments that cannot be used: one line each, and the right exit code."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from arms import heed_interrupts

from repctl_pin.cli import main

SWALLOW = "import os, signal\ntry:\n    os.kill(os.getpid(), signal.SIGINT)\nexcept BaseException:\n    pass\n"

MOMENTS = {
    "in an import that catches everything": "import swallow",
    "in a finaliser": """
import os, signal
class Thing:
    def __del__(self):
        os.kill(os.getpid(), signal.SIGINT)
Thing()
""",
}


def run(code: str, folder: Path) -> subprocess.CompletedProcess:
    (folder / "swallow.py").write_text(SWALLOW, encoding="utf-8")
    program = f"from repctl_pin.cli.interruption import heed_interrupts\nheed_interrupts()\n{code}\nprint('went on')"
    return subprocess.run(
        [sys.executable, "-c", program],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=60,
        preexec_fn=heed_interrupts,
    )


@pytest.mark.parametrize("moment", MOMENTS)
def test_ctrl_c_is_not_lost(moment: str, tmp_path: Path) -> None:
    done = run(MOMENTS[moment], tmp_path)
    assert (done.returncode, done.stdout) == (130, "")
    assert done.stderr == "repctl: interrupted; nothing half-written was left\n"


def test_elsewhere_it_is_an_exception_and_files_stay_whole(tmp_path: Path) -> None:
    code = """
import os, signal
from pathlib import Path
from repctl_pin.files import write_whole
def content(path):
    path.write_text("half")
    os.kill(os.getpid(), signal.SIGINT)
try:
    write_whole(Path("whole.txt"), content)
except KeyboardInterrupt:
    print("raised", sorted(p.name for p in Path().glob("*.txt")), sorted(p.name for p in Path().glob(".*")))
"""
    done = run(code, tmp_path)
    assert done.stdout.splitlines() == ["raised [] []", "went on"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["stuy", "panda"], "no command 'stuy'; did you mean 'study'?"),
        (["study", "panda", "--fraem", "x"], "repctl study: no option '--fraem'; did you mean '--frame'"),
        (["study", "panda", "--fraem=x"], "repctl study: no option '--fraem'; did you mean '--frame'"),
        (["study", "panda", "more"], "repctl study: 'more' is one too many"),
        (["study"], "repctl study: the following arguments are required: ROBOT"),
        (["study", "panda", "--cycles", "0"], "repctl study: argument --cycles: '0' is not a whole number"),
        (["completion", "tcsh"], "repctl completion: no shell 'tcsh'; "),
    ],
)
def test_arguments_are_refused_in_one_line(arguments: list[str], words: str, capsys: pytest.CaptureFixture) -> None:
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
