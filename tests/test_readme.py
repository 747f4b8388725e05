"""The README is true: its commands parse, its Python runs, and its table is what the command prints."""

from __future__ import annotations

import contextlib
import io
import re
import shlex
from pathlib import Path

import pytest

from repctl_pin.cli import main, parser

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", README, flags=re.DOTALL)


def commands() -> list[str]:
    lines = [line for block in blocks("bash") for line in block.splitlines()]
    return [part.split("#")[0].strip() for line in lines for part in re.findall(r"\brepctl (.*)", line)]


@pytest.mark.parametrize("command", commands())
def test_commands_parse(command: str) -> None:
    assert callable(parser().parse_args(shlex.split(command)).run)


def test_the_two_commands_are_there() -> None:
    install = [line for block in blocks("bash") for line in block.splitlines() if line.startswith("python3 -m venv")]
    assert install[0].endswith("repctl study panda") and install[1].endswith("python -m pytest")


def test_the_main_jobs_table_is_what_the_command_prints(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["study", "panda"]) == 0

    def steady(text: str) -> list[str]:
        """Rounding errors differ from machine to machine; their size is all that is promised."""
        return [
            re.sub(r" +\de-(\d\d)", lambda m: " tiny" if int(m[1]) >= 10 else m[0], line) for line in text.split("\n")
        ]

    (shown,) = blocks("text")
    assert steady(shown.strip()) == steady(capsys.readouterr().out.strip())


def test_the_python_runs_and_its_arm_comes_back() -> None:
    (code,) = blocks("python")
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        exec(code, {})
    creeping, closed = (float(line.split()[0]) for line in out.getvalue().splitlines()[-2:])
    assert creeping > 0.1 and closed < 1e-8


def test_every_file_it_names_is_there() -> None:
    for name in re.findall(r"\]\(([^)#:]+)\)", README) + re.findall(r"python ((?:examples|tests)/\S+\.py)", README):
        assert (ROOT / name).is_file(), name
