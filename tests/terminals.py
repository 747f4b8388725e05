"""Terminals of two sizes, in which no command may print a line that is too long."""

from __future__ import annotations

import contextlib
import io
import re
import unicodedata
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from repctl_pin import cli

SIZES = (80, 24), (200, 60)
"""Columns and rows."""


@contextlib.contextmanager
def terminal_of(columns: int, rows: int) -> Iterator[io.StringIO]:
    """Make stdout a terminal of this size."""
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(Screen()) as out:
        patch.setenv("COLUMNS", str(columns))
        patch.setenv("LINES", str(rows))
        yield out


class Screen(io.StringIO):
    """A terminal, as a program sees it."""

    def isatty(self) -> bool:
        return True


def fit_terminals(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """From now on, whatever a command reports is also printed in terminals of both sizes, from the
    same result, and must fit; so it must in a pipe, in 80 columns.

    Gives the outputs of the smaller terminal, which come as the commands run."""
    small: list[str] = []

    def reporting(report: Callable[..., int]) -> Callable[..., int]:
        def reported(options: Any, *rest: Any, **files: Any) -> int:
            if not (options.json or options.quiet):
                for columns, rows in SIZES:
                    with terminal_of(columns, rows) as out:
                        report(options, *rest, **files)
                    fits(out.getvalue(), columns)
                    small.extend([out.getvalue()] * (columns == 80))
                with contextlib.redirect_stdout(io.StringIO()) as pipe:
                    report(options, *rest, **files)
                fits(pipe.getvalue(), 80)
                assert "\x1b" not in pipe.getvalue()
            return report(options, *rest, **files)

        return reported

    reported = reporting(cli.print_result.print_result)
    for _, command in cli.commands():
        if hasattr(command, "print_result"):
            monkeypatch.setattr(command, "print_result", reported)
    return small


def fits(text: str, columns: int) -> None:
    """No line is longer, but for a path, which is to be copied."""
    assert text
    for line in re.sub(r"\x1b\[\d+m", "", text).splitlines():
        seen = sum(not unicodedata.combining(letter) for letter in line)
        assert seen <= columns or max(map(len, line.split())) > 70, line
