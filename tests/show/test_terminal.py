"""What is printed fits a terminal; a pipe gets lines of 80 columns."""

from __future__ import annotations

import re
import shlex
import sys
import unicodedata
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from commands import main, parsers, printed
from controls import some
from shown import drifts
from terminals import Screen, fit_terminals, terminal_of

import repctl_pin as rp

COMMANDS = [
    "inspect talos",
    "check tiago --samples 4",
    "design planar4r --degree 1 --samples 64 --held-out 64 --region 0.1",
    "follow planar7r --strategy pseudoinverse --cycles 2 --steps 40",
    "cell planar3r --half-width 0.1 --held-out 64 --degree 2",
]


@pytest.fixture
def narrow() -> Iterator[None]:
    """A terminal of 80 columns."""
    with terminal_of(80, 24):
        yield


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


def full(study: rp.Study, folder: Path) -> str:
    """The full table, without the files."""
    return printed(study, folder, "--full")[0].partition("\nwrote ")[0]


@pytest.mark.slow
def test_a_study_fits_in_one_piece(narrow: None, tmp_path: Path) -> None:
    """Six joints, three of them without limits and three to spare."""
    kinova = rp.Robot.load("kinova").description.path.read_text(encoding="utf-8")
    bare = re.sub(r"(?s)<visual>.*?</visual>", "", kinova)  # pages of meshes take long
    (tmp_path / "kinova.urdf").write_text(bare, encoding="utf-8")
    study = rp.study(tmp_path / "kinova.urdf", cycles=2, steps=24, degree=1)
    text = full(study, tmp_path)
    fits(text)
    assert text.startswith("After 2 cycles the hand is back")
    assert text.count("─\n") == 1
    plain, closed = (study.row(key).motion for key in ("pseudoinverse", "repeatable"))
    for strategy, motion in (("J⁺", plain), ("nearest repeatable", closed)):
        assert drifts(text, strategy) == pytest.approx((motion.drift[0], motion.drift[-1]), rel=0.5)


@pytest.mark.slow
def test_controls_of_ones_own_go_on_below(narrow: None, tmp_path: Path) -> None:
    task = rp.Robot.load("ppr").task(kind="xy")  # of both units
    own = {
        f"a control with a long name, {k}": rp.WeightedInverse(task, [1.0, 2.0, k])
        for k in (1, 2, 3)
    }
    study = rp.study(rp.Problem("ppr", region=0.2), controls=own, cycles=2, steps=40, degree=1)
    text = full(study, tmp_path)
    fits(text)
    assert text.count("─\n") == 2 and text.count("drift after 2 cycles, rad and m") == 2


@pytest.mark.parametrize("command", some(COMMANDS, *COMMANDS[:2]))
def test_a_command_fits(command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    fit_terminals(monkeypatch)
    with terminal_of(80, 24) as out:
        assert main(shlex.split(command)) == 0
    assert len(out.getvalue()) > 200
    fits(out.getvalue())


@pytest.mark.parametrize("columns", [80, 200])
def test_the_help_of_every_command_fits(columns: int) -> None:
    with terminal_of(columns, 24):
        for part in parsers().values():
            assert max(map(len, part.format_help().splitlines())) <= columns
            for line in part.epilog.splitlines():  # no command is broken
                assert not line.lstrip().startswith("repctl") or len(line) <= 80, line


def test_progress_stays_on_one_row(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A longer line would leave its first rows behind when it is cleared."""
    err = Screen()

    def studied(*_: object, progress: Callable[[str], None], **__: object) -> None:
        progress("word " * 40)
        progress("note: " + "word " * 40)
        raise rp.InputError("enough")

    monkeypatch.setenv("COLUMNS", "60")
    monkeypatch.setattr(sys, "stderr", err)
    monkeypatch.setattr(rp, "study", studied)
    assert main(["study", "ppr", "--out", str(tmp_path)]) == 2
    first, *_, line, note, end = err.getvalue().split("\r\x1b[2K")[1:]
    assert first == "… starting up" and end == "repctl: enough\n"
    assert line.startswith("… word word") and len(line) == 59
    assert note.endswith("\n") and max(map(len, note.splitlines())) <= 60
    assert note.splitlines()[1].startswith("      word")
