"""Write the page on the command line from the parser itself, so that page and program cannot
differ."""

from __future__ import annotations

import argparse
from functools import partial

from repctl_pin.cli import parser

WIDTH = 100
"""Characters of a line of help, whatever the terminal."""


def commands() -> dict[str, str]:
    """Give the help of every subcommand, by name."""
    (parts,) = (a.choices for a in parser()._actions if isinstance(a, argparse._SubParsersAction))
    for part in parts.values():
        part.formatter_class = partial(argparse.RawDescriptionHelpFormatter, width=WIDTH)
        part.color = False  # Python 3.14 asks the terminal
    return {name: part.format_help() for name, part in parts.items()}


def on_page_markdown(text: str, /, **_: object) -> str:
    """Put a section for each subcommand where a page asks for them."""
    if "<!-- commands -->" not in text:
        return text
    sections = (
        f"## {name}\n\n```text\n{words.rstrip()}\n```" for name, words in commands().items()
    )
    return text.replace("<!-- commands -->", "\n\n".join(sections))
