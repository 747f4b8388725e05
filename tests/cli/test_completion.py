"""Completion: what bash is offered, and that every word it is offered is one that the commands
take."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest
from arms import KINDS
from commands import main, parsers
from page_file import COLOURS

import repctl_pin as rp

COMMANDS = {name: parser for name, parser in parsers().items() if name}
PLANES = ("xy", "xz", "yz")


def offered(folder: Path, *words: str) -> set[str]:
    """What bash offers in place of the last word."""
    quoted = " ".join(f"'{word}'" for word in ("repctl", *words))
    program = (
        f"source complete.bash; COMP_WORDS=({quoted}); COMP_CWORD={len(words)}; "
        "$(complete -p repctl | sed 's/.*-F \\([^ ]*\\) .*/\\1/') repctl; printf '%s\\n' "
        '"${COMPREPLY[@]}"'
    )
    done = subprocess.run(
        ["bash", "-c", program], cwd=folder, capture_output=True, text=True, timeout=30
    )
    return set(done.stdout.split("\n")) - {""}


@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash here")
def test_bash_is_offered_commands_options_robots_words_and_files(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["completion", "bash"]) == 0
    (tmp_path / "complete.bash").write_text(capsys.readouterr().out, encoding="utf-8")
    (tmp_path / "mine.urdf").touch()
    (tmp_path / "folder").mkdir()
    assert offered(tmp_path, "") >= set(COMMANDS)
    assert offered(tmp_path, "st") == {"study"}
    assert {"panda", "pr2"} <= offered(
        tmp_path, "study", "p"
    ) and "mine.urdf" in offered(tmp_path, "study", "mi")
    assert {"--frame", "--path", "--cycles"} <= offered(
        tmp_path, "study", "panda", "--"
    )
    assert offered(tmp_path, "study", "panda", "--plane", "") >= set(PLANES)
    assert "folder" in offered(tmp_path, "study", "panda", "--out", "f")


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_every_shell_gets_a_script(
    shell: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["completion", shell]) == 0
    text = capsys.readouterr().out
    assert all(name in text for name in (*COMMANDS, "panda", "polygon"))
    if shutil.which(shell):
        done = subprocess.run(
            [shell, "-n"], input=text, capture_output=True, text=True, timeout=30
        )
        assert done.returncode == 0, done.stderr


@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash here")
def test_every_word_is_one_the_commands_take(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["completion", "bash"]) == 0
    (tmp_path / "complete.bash").write_text(capsys.readouterr().out, encoding="utf-8")

    def words(command: str, option: str) -> set[str]:
        return offered(tmp_path, command, "panda", option, "") - {"complete.bash"}

    assert words("study", "--task") == set(KINDS)
    assert words("study", "--plane") == set(PLANES)
    assert words("animate", "--only") == set(COLOURS)
    assert words("study", "--degree") == {"1", "2", "3", "4"}
    for weight in words("check", "--weight"):
        assert main(["check", "panda", "--weight", weight, "--samples", "8"]) == 0
    strategies = words("follow", "--strategy")
    assert len(strategies) == 3
    assert all(name in COMMANDS["follow"].format_help() for name in strategies)
    paths = words("study", "--path")
    assert len(paths) == 5
    for path in paths:
        assert rp.Problem("planar3r", path=path)
