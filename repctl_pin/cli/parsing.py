"""Arguments that cannot be used: one line, the nearest that can, and where the others are."""

from __future__ import annotations

import argparse
from typing import Any, NoReturn

from ..errors import unknown


class Parser(argparse.ArgumentParser):
    """An argument parser whose complaint is one line."""

    def error(self, message: str) -> NoReturn:
        """Say the line and exit with 2."""
        self.exit(2, f"{self.prog}: {message} (see {self.prog} --help)\n")

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is not None and value not in action.choices:
            kind = "command" if isinstance(action, argparse._SubParsersAction) else action.dest.replace("_", " ")
            raise argparse.ArgumentError(None, str(unknown(kind, value, action.choices)))

    def parse_all(self, arguments: list[str]) -> argparse.Namespace:
        """Parse; what is left over is refused by the command that it was given to."""
        options, rest = self.parse_known_args(arguments)
        chosen: Parser = vars(options).pop("parser")
        if rest:
            word = next((w for w in rest if w.startswith("-")), rest[0]).partition("=")[0]
            known = [w for action in chosen._actions for w in action.option_strings if w.startswith("--")]
            chosen.error(str(unknown("option", word, known)) if word.startswith("-") else f"{word!r} is one too many")
        return options
