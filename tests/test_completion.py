"""Completion as real shells do it: what is typed, Tab, Enter, and what the command is then given."""

from __future__ import annotations

import argparse
import os
import pty
import re
import select
import shlex
import shutil
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

import repctl_pin as rp
from repctl_pin.cli import main, parser
from repctl_pin.cli.check import strategy_of
from repctl_pin.cli.completion import _WORDS, script
from repctl_pin.cli.design import _desired
from repctl_pin.motion.shapes import PLANES
from repctl_pin.motion.spec import parse_path
from repctl_pin.robot.task import KINDS
from repctl_pin.show.plots.motions import COLOURS
from repctl_pin.urdf.catalogue import entries

ROBOTS = ["panda", "pr2", "ur5"]
SHELLS = ("bash", "zsh", "fish")
COMMANDS = next(a for a in parser()._actions if isinstance(a, argparse._SubParsersAction)).choices
FILES = ["my arm.urdf", "plate.urdf", "parts of it", "$x;y.csv"]
TAB, ALL = "\t", {"bash": "\x1b*", "zsh": "\x18*"}
"""Keys: complete; and write out all that may stand here."""

ENVIRONMENT = {"PATH": os.environ["PATH"], "TERM": "dumb", "LC_ALL": "C.UTF-8", "INPUTRC": os.devnull}

ECHO = r"""repctl() { printf '\001'; [ $# = 0 ] || printf '%s\002' "$@"; printf '\003\n'; }"""
"""In the shell's place for the command: it tells what it was given."""

START = {
    "bash": (["bash", "--noprofile", "--norc", "-i"], ""),
    "zsh": (
        ["zsh", "-f", "-i"],
        "zle -C all complete-word _generic; bindkey '^X*' all; zstyle ':completion:all:*' insert true; "
        "zstyle ':completion:all::::' completer _all_matches _complete; ",
    ),
}


class Shell:
    """An interactive shell at a terminal, in a folder with a few files; the script is loaded."""

    def __init__(self, name: str, folder: Path) -> None:
        self.name, self.folder = name, folder
        self.open()

    def open(self) -> None:
        command, settings = START[self.name]
        environment = ENVIRONMENT | {"HOME": str(self.folder), "ZDOTDIR": str(self.folder.parent)}
        self.terminal, theirs = pty.openpty()
        self.process = subprocess.Popen(
            command,
            cwd=self.folder,
            env=environment,
            stdin=theirs,
            stdout=theirs,
            stderr=theirs,
            start_new_session=True,
        )
        os.close(theirs)
        self.given(f"source ../complete.{self.name}; {settings}{ECHO}; repctl")

    def given(self, keys: str) -> list[str]:
        """Press these keys, then Enter; the arguments that the command is given."""
        os.write(self.terminal, (keys + "\r").encode())
        heard, deadline = b"", time.monotonic() + 30
        while b"\x03" not in heard:
            ready, _, _ = select.select([self.terminal], [], [], max(0.0, deadline - time.monotonic()))
            if not ready:
                self.close()
                self.open()  # for the next
                pytest.fail(f"{self.name} does not answer to {keys!r}: {heard.decode(errors='replace')}")
            heard += os.read(self.terminal, 65536)
        told = heard.partition(b"\x03")[0].rpartition(b"\x01")[2].decode()
        return told.split("\x02")[:-1]

    def offered(self, text: str) -> list[str]:
        """Everything that may stand at the end of a line."""
        return sorted(self.given(text + ALL[self.name])[len(shlex.split(text.rpartition(" ")[0])) - 1 :])

    def close(self) -> None:
        os.close(self.terminal)  # which ends it
        self.process.wait(timeout=20)


class Fish:
    """fish's own engine, asked as fish asks it at a Tab."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def offered(self, text: str) -> list[str]:
        done = subprocess.run(
            ["fish", "--no-config", "-c", "source ../complete.fish; complete -C $argv[1]", text],
            cwd=self.folder,
            env=ENVIRONMENT | {"HOME": str(self.folder.parent)},
            capture_output=True,
            text=True,
            timeout=60,
        )
        assert done.returncode == 0 and done.stderr == "", done.stderr
        return sorted(line.partition("\t")[0] for line in done.stdout.splitlines())


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    above = tmp_path_factory.mktemp("completion")
    for shell in SHELLS:
        (above / f"complete.{shell}").write_text(script(parser(), shell, ROBOTS), encoding="utf-8")
    folder = above / "here"
    (folder / "parts of it").mkdir(parents=True)
    for name in ("my arm.urdf", "plate.urdf", "parts of it/left arm.urdf", "$x;y.csv"):
        (folder / name).touch()
    return folder


def opened(name: str, folder: Path) -> Shell | Fish:
    if shutil.which(name) is None:
        pytest.skip(f"there is no {name} here")
    return Fish(folder) if name == "fish" else Shell(name, folder)


@pytest.fixture(scope="module", params=START)
def shell(request: pytest.FixtureRequest, folder: Path) -> Iterator[Shell]:
    shell = opened(request.param, folder)
    assert isinstance(shell, Shell)
    yield shell
    shell.close()


COMPLETED = {
    "a command": ("st", ["study"]),
    "a robot": ("study pan", ["study", "panda"]),
    "a robot after flags": ("study --json --report pan", ["study", "--json", "--report", "panda"]),
    "a robot after values": (
        "study --task pose --path eight:1 pan",
        ["study", "--task", "pose", "--path", "eight:1", "panda"],
    ),
    "a robot after =": ("study --task=pose --path=eight:1 pan", ["study", "--task=pose", "--path=eight:1", "panda"]),
    "an option": ("study panda --rep", ["study", "panda", "--report"]),
    "an option of this command only": ("design panda --workspa", ["design", "panda", "--workspace"]),
    "a value": ("study panda --task po\te", ["study", "panda", "--task", "pose"]),
    "a value after =": ("study panda --task=pose --plane=x\ty", ["study", "panda", "--task=pose", "--plane=xy"]),
    "the one value after =": ("study panda --task=ax", ["study", "panda", "--task=axis"]),
    "a path of many numbers": ("study panda --path pol", ["study", "panda", "--path", "polygon:5:0.1"]),
    "a path after =": ("study panda --path=ei", ["study", "panda", "--path=eight:0.1"]),
    "nothing after a colon": ("study --path circle:pan", ["study", "--path", "circle:pan"]),
    "a shell": ("completion f", ["completion", "fish"]),
    "a file": ("inspect pla", ["inspect", "plate.urdf"]),
    "a file with a space": ("inspect my", ["inspect", "my arm.urdf"]),
    "a file begun with a space": ("inspect my\\ ", ["inspect", "my arm.urdf"]),
    "a file in quotes": ("inspect 'my a", ["inspect", "my arm.urdf"]),
    "a file in a folder": ("inspect par\tl", ["inspect", "parts of it/left arm.urdf"]),
    "a file of strange letters": ("animate ppr --motion \\$", ["animate", "ppr", "--motion", "$x;y.csv"]),
    "a file after =": ("animate ppr --motion=pla", ["animate", "ppr", "--motion=plate.urdf"]),
    "a file from home": ("inspect ~/pla", ["inspect", "~/plate.urdf"]),
    "a folder": ("study panda --out par\t --jso", ["study", "panda", "--out", "parts of it", "--json"]),
    "nothing where it is free": ("study panda --cycles p", ["study", "panda", "--cycles", "p"]),
    "nothing for a lone path": ("study panda --frame pla", ["study", "panda", "--frame", "pla"]),
}


@pytest.mark.parametrize("case", COMPLETED)
def test_what_is_typed_is_completed(case: str, shell: Shell, folder: Path) -> None:
    typed, expected = COMPLETED[case]
    given = [word.replace(str(folder), "~").removesuffix("/") for word in shell.given(f"repctl {typed}{TAB}")]
    assert given == expected


OPTIONS = {
    name: [s for a in part._actions for s in a.option_strings if s[:2] == "--"] for name, part in COMMANDS.items()
}

OFFERED = {
    "": [*COMMANDS],
    "stu": ["study"],
    "study ": [*ROBOTS, *FILES],
    "study p": ["panda", "pr2", "parts of it", "plate.urdf"],
    "study panda -": OPTIONS["study"],
    "animate panda --l": ["--lock", "--live"],
    "completion ": [*SHELLS],
    "study panda --task ": [*KINDS],
    "study panda --task=": [*KINDS],
    "study panda --plane ": [*PLANES],
    "study panda --package-dir ": ["parts of it"],
    "design panda --degree ": ["auto", "1", "2", "3", "4"],
    "check panda --weight ": ["inertia"],
    "study panda --cycles ": [],
    "follow design.json --robot p": ["panda", "pr2", "parts of it", "plate.urdf"],
    "animate panda --motion ": FILES,
    "study panda --path ": ["circle:0.1", "square:0.2", "eight:0.1", "rose:0.1", "polygon:5:0.1", *FILES],
}
"""All that may stand at the end of a line."""


def all_offered(shell: Shell | Fish, text: str) -> list[str]:
    return sorted(re.sub("^--task=|/$", "", word) for word in shell.offered(f"repctl {text}"))


@pytest.mark.parametrize("text", OFFERED)
def test_all_that_may_stand_there_is_offered(text: str, shell: Shell) -> None:
    assert all_offered(shell, text) == sorted(OFFERED[text])


def test_after_the_robot_there_are_options_only(shell: Shell) -> None:
    assert all_offered(shell, "study panda ") == sorted(OPTIONS["study"])
    assert all_offered(shell, "study --task pose --json panda ")[0].startswith("--")


@pytest.mark.parametrize("text", OFFERED)
def test_fish_offers_it_too(text: str, folder: Path) -> None:
    assert all_offered(opened("fish", folder), text) == sorted(OFFERED[text])


@pytest.mark.parametrize("shell", SHELLS)
def test_it_is_printed_with_the_whole_catalogue(shell: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["completion", shell]) == 0
    assert capsys.readouterr().out == script(parser(), shell, [entry.name for entry in entries()])


def test_the_words_offered_are_those_that_are_taken() -> None:
    for key, words in _WORDS.items():
        command, _, option = key.rpartition(" ")
        having = [command] if command else [name for name in COMMANDS if option in OPTIONS[name]]
        assert having and all(option in OPTIONS[name] for name in having), key
        for name in having:
            if option in ("--degree", "--plane", "--task"):
                for word in words.split():
                    COMMANDS[name].parse_args(["panda", option, word])
    assert set(_WORDS["--task"].split()) == set(KINDS) and set(_WORDS["--plane"].split()) == set(PLANES)
    assert set(_WORDS["--only"].split()) == set(COLOURS)
    task = rp.Robot.load("panda").task()
    for word in _WORDS["--path"].split():
        parse_path(word)(task, task.reference)
    for key in ("--weight", "design --weight"):
        for word in _WORDS[key].split():
            (_desired if "design" in key else strategy_of)(task, word)
