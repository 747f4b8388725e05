"""``repctl completion``: a completion script for a shell, written by shtab."""

from __future__ import annotations

import argparse

from ..errors import needed
from .follow import OWN
from .given import Options
from .options import Parser

_SHELLS = ("bash", "zsh", "fish")

HELP = "print a script that completes repctl's commands, options and robots in a shell"
EXAMPLE = """examples:
  repctl completion bash > ~/.local/share/bash-completion/completions/repctl
  repctl completion zsh > ~/.repctl.zsh
  echo 'source ~/.repctl.zsh' >> ~/.zshrc
  repctl completion fish > ~/.config/fish/completions/repctl.fish"""

_WORDS = {
    "--task": "pose axis position xy xz yz",
    "--plane": "xy yz xz",
    "--path": "circle:0.1 square:0.2 eight:0.1 rose:0.1 polygon:5:0.1",
    "--weight": "inertia limits",
    "--degree": "1 2 3 4",
    "--strategy": " ".join(OWN),
    "--only": "pseudoinverse posture posture_off repeatable",
}
"""Completions offered for the values of options."""


def add_options(parser: Parser) -> None:
    """Add the options of this subcommand."""
    parser.add_argument(
        "shell", metavar="SHELL", choices=_SHELLS, help=", ".join(_SHELLS)
    )


def run(options: Options) -> int:
    """Print the completion script."""
    print(script(options.whole, options.shell), end="")
    return 0


def script(whole: argparse.ArgumentParser, shell: str) -> str:
    """Generate a static completion script for a shell, which never calls repctl.

    Modifies the parser ``whole``, which must not be reused.
    """
    needed("shtab", by="completion")
    import shtab

    from ..model.catalogue import entries

    robots = [entry.name for entry in entries()]
    commands = next(
        a for a in whole._actions if isinstance(a, argparse._SubParsersAction)
    ).choices
    for part in commands.values():
        for action in part._actions:
            name = next((s for s in action.option_strings if s.startswith("--")), "")
            takes = str(action.metavar or "")
            if takes in ("ROBOT", "WHAT", "PATH"):
                action.complete = _words_and_files(
                    "path" if takes == "PATH" else "robot", robots
                )
            elif name in _WORDS:
                action.choices = _WORDS[name].split()
            elif takes in ("FILE", "LOG"):
                action.complete = shtab.FILE
            elif takes in ("DIR", "FOLDER"):
                action.complete = shtab.DIRECTORY
    functions = "".join(
        f'_repctl_{name}() {{ compgen -W "{" ".join(words)}" -- "$1"; compgen -f -- "$1"; }}\n'
        for name, words in (("robot", robots), ("path", _WORDS["--path"].split()))
    )
    text = shtab.complete(whole, shell, preamble=functions if shell == "bash" else "")
    return (
        f"# completes repctl in {shell}; made by `repctl completion {shell}`\n{text}\n"
    )


def _words_and_files(name: str, robots: list[str]) -> dict[str, str]:
    """Write shell code that completes words and files, by shell; shtab cannot combine the two."""
    words = " ".join(robots) if name == "robot" else _WORDS["--path"]
    return {
        "bash": f"_repctl_{name}",
        "zsh": f"{{compadd -- {words.replace(':', chr(92) + ':')}; _files}}",
        "fish": f"(string split ' ' '{words}'; __fish_complete_path (commandline -ct))",
    }
