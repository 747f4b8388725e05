"""What is printed fits a terminal; a pipe gets lines of 80 columns."""

from __future__ import annotations

import io
import shlex
import sys
import unicodedata

import pytest
from commands import main, parsers
from shown import drifts
from terminals import fit_terminals, terminal_of

import repctl_pin as rp
from repctl_pin.cli import terminal
from repctl_pin.show.text import fitted, lines, study_table, study_verdict

COMMANDS = [
    "inspect talos",
    "check tiago --samples 4",
    "design planar4r --degree 1 --samples 64 --held-out 64 --region 0.1",
    "follow planar7r --strategy pseudoinverse --cycles 2 --steps 40",
    "cell planar3r --half-width 0.1 --held-out 64 --degree 2",
]


@pytest.fixture
def narrow(monkeypatch: pytest.MonkeyPatch) -> None:
    """A terminal of 80 columns."""
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setattr(lines, "on_terminal", lambda stream: stream is sys.stdout)


def fits(text: str) -> None:
    """No line is longer, but for a path, which is to be copied; and nothing is told as Python
    writes it."""
    for line in text.splitlines():
        seen = sum(not unicodedata.combining(letter) for letter in line)
        assert seen <= 80 or max(map(len, line.split())) > 70, line
    assert not {"<", "array(", "None", "nan", "inf,"} & {
        word for word in text.split() if word[:1].isascii()
    }, text
    assert "potentials>" not in text and "<Task" not in text


def test_a_study_fits_in_one_piece(narrow: None) -> None:
    """Six joints, three of them without limits and three to spare."""
    study = rp.study("kinova", cycles=2, steps=24, degree=1)
    text = study_table(study)
    fits(text)
    assert text.startswith(study_verdict(study)[:60]) and text.count("─\n") == 1
    plain, closed = (study.row(key).motion for key in ("pseudoinverse", "repeatable"))
    for strategy, motion in (("J⁺", plain), ("nearest repeatable", closed)):
        assert drifts(text, strategy) == pytest.approx(
            (motion.drift[0], motion.drift[-1]), rel=0.5
        )


def test_controls_of_ones_own_go_on_below(narrow: None) -> None:
    task = rp.Robot.load("ppr").task(kind="xy")  # of both units
    own = {
        f"a control with a long name, {k}": rp.WeightedInverse(task, [1.0, 2.0, k])
        for k in (1, 2, 3)
    }
    text = study_table(rp.study("ppr", controls=own, cycles=2, steps=40, degree=1))
    fits(text)
    assert text.count("─\n") == 2 and text.count("drift after 2 cycles, rad and m") == 2


@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_fits(
    command: str,
    narrow: None,
    tmp_path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    fit_terminals(monkeypatch)
    assert main(shlex.split(command)) == 0
    text = capsys.readouterr().out
    assert len(text) > 200
    fits(text)


@pytest.mark.parametrize("columns", [80, 200])
def test_the_help_of_every_command_fits(columns: int) -> None:
    with terminal_of(columns, 24):
        for part in parsers().values():
            assert max(map(len, part.format_help().splitlines())) <= columns
            for line in part.epilog.splitlines():  # no command is broken
                assert not line.lstrip().startswith("repctl") or len(line) <= 80, line


def test_progress_stays_on_one_row(monkeypatch: pytest.MonkeyPatch) -> None:
    """A longer line would leave its first rows behind when it is cleared."""
    err = io.StringIO()
    monkeypatch.setenv("COLUMNS", "60")
    monkeypatch.setattr(terminal, "on_terminal", lambda stream: stream is err)
    monkeypatch.setattr(sys, "stderr", err)
    say = terminal.progress(quiet=False)
    say("word " * 40)
    say("note: " + "word " * 40)
    _, first, second, note = err.getvalue().split("\r\x1b[2K")
    assert first == "… starting up" and len(second) == 59
    assert note.endswith("\n") and max(map(len, note.splitlines())) <= 60
    assert note.splitlines()[1].startswith("      word")


def test_what_stands_behind_a_label_goes_on_below_itself(narrow: None) -> None:
    words = "word " * 30
    first, *later = fitted(f"joint drift     {words}").splitlines()
    assert (
        first.startswith("joint drift     word")
        and later
        and all(line.startswith(" " * 16 + "w") for line in later)
    )
    assert fitted(f"note: {words}").splitlines()[1].startswith("      word")
    assert fitted("from /" + "a" * 100) == "from /" + "a" * 100


def test_a_pipe_gets_80_columns() -> None:
    assert max(map(len, fitted("word " * 40).splitlines())) in range(75, 81)
    assert fitted("word " * 40).split() == ["word"] * 40
