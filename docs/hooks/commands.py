"""Write the page on the command line from the parser itself."""

from __future__ import annotations

import argparse
from functools import partial

from repctl_pin.cli import parser

WIDTH = 80
"""Width of a line of help, characters, on any terminal."""


def commands() -> dict[str, str]:
    """Format the help of every subcommand, by name."""
    (parts,) = (a.choices for a in parser()._actions if isinstance(a, argparse._SubParsersAction))
    for part in parts.values():
        part.formatter_class = partial(argparse.RawDescriptionHelpFormatter, width=WIDTH)
        part.color = False  # Python 3.14 colours help on a terminal
    return {name: part.format_help() for name, part in parts.items()}


def on_page_markdown(text: str, /, **_: object) -> str:
    """Replace the mark of a page by a section for each subcommand."""
    if "<!-- commands -->" not in text:
        return text
    sections = (
        f"## {name}\n\n```text\n{words.rstrip()}\n```" for name, words in commands().items()
    )
    return text.replace("<!-- commands -->", "\n\n".join(sections))
