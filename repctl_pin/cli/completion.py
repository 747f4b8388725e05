"""``repctl completion``: a script that completes ``repctl`` in a shell."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from dataclasses import dataclass

from .follow import OWN

HELP = "print a script that completes repctl's commands, options and robots in bash, zsh or fish"
EXAMPLE = """examples: repctl completion bash > ~/.local/share/bash-completion/completions/repctl
          repctl completion zsh > ~/.repctl.zsh; echo 'source ~/.repctl.zsh' >> ~/.zshrc
          repctl completion fish > ~/.config/fish/completions/repctl.fish"""

_WORDS = {
    "--task": "pose axis position xy xz yz",
    "--plane": "xy yz xz",
    "--path": "circle:0.1 square:0.2 eight:0.1 rose:0.1 polygon:5:0.1",
    "--weight": "inertia",
    "--degree": "1 2 3 4",
    "--strategy": " ".join(OWN),
    "--only": "pseudoinverse posture posture_off repeatable",
    "design --weight": "inertia limits",
    "design --degree": "auto 1 2 3 4",
}
"""What may stand after an option, or after an option of one command."""

_FILES = {"FILE": "file", "PATH": "file", "ROBOT": "file", "WHAT": "file", "DIR": "folder", "FOLDER": "folder"}
"""What is a file, or a folder, by the name that the help gives it."""


@dataclass(frozen=True)
class _Argument:
    """What a shell has to know of one argument."""

    name: str  # of the option; "" where it has none
    help: str
    takes: str  # what the help calls its value; "" where it takes none
    words: tuple[str, ...]  # that may stand for it
    files: str  # "file", "folder" or ""
    again: bool  # may be given more than once


_Commands = dict[str, tuple[str, list[_Argument]]]


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this subcommand."""
    parser.add_argument("shell", metavar="SHELL", choices=tuple(_WRITERS), help="bash, zsh or fish")


def run(options: argparse.Namespace) -> int:
    """Print the script."""
    from ..urdf.catalogue import entries

    print(script(options.whole, options.shell, [entry.name for entry in entries()]), end="")
    return 0


def script(whole: argparse.ArgumentParser, shell: str, robots: Iterable[str]) -> str:
    """Write the script: everything that may be completed stands in it, and nothing is run to complete.

    Parameters
    ----------
    whole
        The parser of the whole command.
    shell
        ``bash``, ``zsh`` or ``fish``.
    robots
        Names of the catalogue.
    """
    parts = next(a for a in whole._actions if isinstance(a, argparse._SubParsersAction))
    helps = {action.dest: action.help or "" for action in parts._choices_actions}
    commands = {name: (helps[name], _arguments(name, part, robots)) for name, part in parts.choices.items()}
    return f"# completes repctl in {shell}; made by `repctl completion {shell}`\n" + _WRITERS[shell](commands)


def _arguments(command: str, part: argparse.ArgumentParser, robots: Iterable[str]) -> list[_Argument]:
    """Read the arguments of one subcommand."""
    found = []
    for action in part._actions:
        name = next((s for s in action.option_strings if s.startswith("--")), "")
        value = str(action.metavar or action.dest).upper()
        if value in ("ROBOT", "WHAT"):
            words = tuple(robots)
        else:
            words = tuple(_WORDS.get(f"{command} {name}", _WORDS.get(name, "")).split()) or tuple(action.choices or ())
        takes = "" if action.nargs == 0 else value
        again = isinstance(action, argparse._AppendAction)
        found.append(_Argument(name, action.help or "", takes, words, _FILES.get(value, ""), again))
    return found


def _bash(commands: _Commands) -> str:
    flags = sorted({a.name for _, arguments in commands.values() for a in arguments if not a.takes})
    blocks = []
    for command, (_, arguments) in commands.items():
        cases: dict[str, list[str]] = {}
        for a in arguments:
            if a.name and a.takes:
                cases.setdefault(_bash_answer(a), []).append(a.name)
        first = next((_bash_answer(a) for a in arguments if not a.name), "")
        options = " ".join(a.name for a in arguments if a.name)
        lines = [f"      {'|'.join(names)}) {answer} ;;" for answer, names in cases.items()]
        lines.append(f'      *) {first}; options="{options}" ;;' if first else f'      *) options="{options}" ;;')
        blocks.append(f'    {command}) case "$before" in\n' + "\n".join(lines) + "\n    esac ;;")
    return f"""_repctl() {{
  local word="${{COMP_WORDS[COMP_CWORD]}}" before="${{COMP_WORDS[COMP_CWORD-1]}}" words="" files="" options="" name i
  COMPREPLY=()
  case "$before$word" in :*|*:) return ;; esac  # bash cuts words at : and =
  if [ "$word" = "=" ]; then word=""; elif [ "$before" = "=" ]; then before="${{COMP_WORDS[COMP_CWORD-2]}}"; fi
  [ "$COMP_CWORD" -gt 1 ] || words="{" ".join(commands)}" options="--help --version"
  [ "$COMP_CWORD" -eq 1 ] || case "${{COMP_WORDS[1]}}" in
{chr(10).join(blocks)}
  esac
  if [ -n "$options" ]; then
    for ((i = 2; i < COMP_CWORD; i++)); do  # once the first argument is given, there are options only
      case "${{COMP_WORDS[i]}}" in -*|[=:]) continue ;; esac
      case "${{COMP_WORDS[i-1]}}" in {"|".join(flags)}) ;; -*|[=:]) continue ;; esac
      words="" files=""
    done
    if [ -z "$words$files" ] || [ "${{word#-}}" != "$word" ]; then words="$options" files=""; fi
  fi
  COMPREPLY=($(compgen -W "$words" -- "$word"))
  [ -n "$files" ] || return
  while IFS= read -r name; do
    COMPREPLY+=("$name")
    compopt -o filenames 2>/dev/null
  done < <(compgen "$files" -- "$word")
}}
complete -F _repctl repctl
"""


def _bash_answer(argument: _Argument) -> str:
    files = {"file": "files=-f", "folder": "files=-d", "": ""}[argument.files]
    words = f'words="{" ".join(argument.words)}"' if argument.words else ""
    return " ".join(filter(None, (words, files))) or "return"


def _zsh(commands: _Commands) -> str:
    def quoted(text: str) -> str:
        return "'" + text.replace("'", "'\\''") + "'"

    def spec(a: _Argument) -> str:
        if not a.name:
            return quoted(f"1:{a.takes}:{action(a)}")
        note = a.help.replace("[", "\\[").replace("]", "\\]")
        value = f"=[{note}]:{a.takes}:{action(a)}" if a.takes else f"[{note}]"
        return quoted("*" * a.again + a.name + value)

    def action(a: _Argument) -> str:
        words = " ".join(a.words).replace(":", "\\:")
        files = {"file": "_files", "folder": "_files -/", "": ""}[a.files]
        return f"{{compadd -- {words}; {files}}}" if words and files else f"({words})" if words else files or " "

    blocks = [
        f"      {name}) _arguments " + " \\\n        ".join(map(spec, arguments)) + " ;;"
        for name, (_, arguments) in commands.items()
    ]
    return f"""_repctl() {{
  local curcontext="$curcontext" state line
  local -a commands=(
{chr(10).join("    " + quoted(f"{name}:{text}") for name, (text, _) in commands.items())}
  )
  _arguments -C '(- *)--help[show the help]' '(- *)--version[show the version]' \\
    '1:command:->command' '*::argument:->rest'
  case $state in
    command) _describe command commands ;;
    rest) case $words[1] in
{chr(10).join(blocks)}
    esac ;;
  esac
}}
(( $+functions[compdef] )) || {{ autoload -Uz compinit && compinit }}
compdef _repctl repctl
"""


def _fish(commands: _Commands) -> str:
    def quoted(text: str) -> str:
        return "'" + text.replace("\\", "\\\\").replace("'", "\\'") + "'"

    lines = ["complete -c repctl -f", "complete -c repctl -n __fish_use_subcommand -l help -d 'show the help'"]
    lines.append("complete -c repctl -n __fish_use_subcommand -l version -d 'show the version'")
    for name, (text, arguments) in commands.items():
        lines.append(f"complete -c repctl -n __fish_use_subcommand -a {name} -d {quoted(text)}")
        for a in arguments:
            words = " ".join([*a.words, *(["(__fish_complete_directories)"] if a.files == "folder" else [])])
            line = f"complete -c repctl -n '__fish_seen_subcommand_from {name}'"
            line += f" -l {a.name[2:]} -d {quoted(a.help)}" if a.name else ""
            line += " -r" * bool(a.name and a.takes) + (" -F" if a.files == "file" else " -f" if a.takes else "")
            lines.append(line + (f" -a {quoted(words)}" if words else ""))
    return "\n".join(lines) + "\n"


_WRITERS = {"bash": _bash, "zsh": _zsh, "fish": _fish}
