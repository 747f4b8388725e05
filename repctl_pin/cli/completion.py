"""``repctl completion``: a script that completes ``repctl`` in a shell."""

from __future__ import annotations

import argparse
import shlex

HELP = "print a script that completes repctl's commands, options and robots in bash or zsh"
EXAMPLE = """example: repctl completion bash > ~/.local/share/bash-completion/completions/repctl
         repctl completion zsh > ~/.repctl.zsh; echo 'source ~/.repctl.zsh' >> ~/.zshrc"""

_CHOICES = {
    "--task": "pose axis position xy xz yz",
    "--plane": "xy yz xz",
    "--path": "circle:0.1 eight:0.1 rose:0.1 square:0.2 polygon:5:0.1",
    "--weight": "inertia",
    "--degree": "1 2 3 4",
}
"""What may stand after an option, where it is neither free nor a file."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this subcommand."""
    parser.add_argument("shell", metavar="SHELL", choices=("bash", "zsh"), help="bash or zsh")


def run(options: argparse.Namespace) -> int:
    """Print the script."""
    from ..robot.catalogue import entries
    from . import parser

    print(script(parser(), options.shell, [entry.name for entry in entries()]), end="")
    return 0


def script(whole: argparse.ArgumentParser, shell: str, robots: list[str]) -> str:
    """Write the script: everything that may be completed stands in it, and nothing is run to complete.

    Parameters
    ----------
    whole
        The parser of the whole command.
    shell
        ``bash`` or ``zsh``, which understands bash's.
    robots
        Names of the catalogue.
    """
    commands = next(a.choices for a in whole._actions if isinstance(a, argparse._SubParsersAction))
    choices = "\n".join(f'    {name}) words="{words}" ;;' for name, words in _CHOICES.items())
    cases, takes, positional = [], set(), {}
    for name, part in commands.items():
        words = [string for action in part._actions for string in action.option_strings if string.startswith("--")]
        takes |= {s for a in part._actions if a.option_strings and a.nargs != 0 for s in a.option_strings}
        cases.append(f'    {name}) words="{" ".join(words)}" ;;')
        first = next((a for a in part._actions if not a.option_strings), None)
        if first is not None:
            given = " ".join(map(str, first.choices or robots))
            positional[name] = f"    {name}) words={shlex.quote(given)} ;;"
    after = "|".join(sorted(takes - set(_CHOICES)))
    zsh = "autoload -U +X compinit && compinit\nautoload -U +X bashcompinit && bashcompinit\n" if shell == "zsh" else ""
    return f"""# completes repctl in {shell}; made by `repctl completion {shell}`
{zsh}_repctl() {{
  local word="${{COMP_WORDS[COMP_CWORD]}}" before="${{COMP_WORDS[COMP_CWORD-1]}}" command="${{COMP_WORDS[1]}}" words=""
  COMPREPLY=()
  if [ "$COMP_CWORD" -eq 1 ]; then
    COMPREPLY=($(compgen -W "{" ".join(commands)} --help --version" -- "$word"))
    return
  fi
  case "$before" in
{choices}
    {after}) COMPREPLY=($(compgen -f -- "$word")); return ;;
  esac
  if [ -z "$words" ]; then
    if [ "${{word#-}}" != "$word" ]; then
      case "$command" in
{chr(10).join("    " + line for line in cases)}
      esac
    else
      case "$command" in
{chr(10).join("    " + line for line in positional.values())}
      esac
      COMPREPLY=($(compgen -f -- "$word"))
    fi
  fi
  COMPREPLY+=($(compgen -W "$words" -- "$word"))
}}
complete -o filenames -F _repctl repctl
"""
