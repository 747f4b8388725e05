"""Run a command in this process, and take what it says."""

from __future__ import annotations

import json
from argparse import ArgumentParser, _SubParsersAction
from collections.abc import Callable
from importlib.metadata import entry_points
from typing import Any

import pytest

main: Callable[[list[str]], int] = entry_points(group="console_scripts")[
    "repctl"
].load()
"""The command ``repctl`` as it is installed: words in, exit code out."""

OUT = [
    *("follow", "planar3r", "--strategy", "pseudoinverse", "--start", "6.2,1,-1.4"),
    *("--path", "circle:0.4:0", "--plane", "xy", "--steps", "100"),
]
"""A motion that leaves its limits: theta1 ends at 2π, where this circle takes it."""


def parsers() -> dict[str, ArgumentParser]:
    """The parsers of all commands by their names; that of ``repctl`` itself has none."""
    from repctl_pin.cli import parser

    whole = parser()
    (commands,) = (
        action.choices
        for action in whole._actions
        if isinstance(action, _SubParsersAction)
    )
    return {"": whole, **commands}


def told(capsys: pytest.CaptureFixture[str], *arguments: str) -> dict:
    """The JSON of a command that does what it should."""
    assert main([*arguments, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def refused(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """The one line of a command that refuses what it was given."""
    assert main([*arguments]) == 2
    captured = capsys.readouterr()
    assert (
        captured.out == ""
        and captured.err.count("\n") == 1
        and captured.err.startswith("repctl: ")
    )
    return captured.err


def computed_once(compute: Callable[..., Any]) -> Callable[..., Any]:
    """Compute the first time, and give the same result ever after."""
    found: list[Any] = []

    def computed(*given: Any, **options: Any) -> Any:
        if not found:
            found.append(compute(*given, **options))
        return found[0]

    return computed


def without_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave out what a test does not look at, and what takes half of a command's time: pages and
    figures are written, but hold nothing."""
    from repctl_pin.show import study_files
    from repctl_pin.show.page import playback

    for module in (study_files, playback):
        monkeypatch.setattr(
            module, "playback_page", lambda *_, **__: "<html><head></head></html>"
        )
    monkeypatch.setattr(study_files, "png", lambda *_, **__: b"")
    for figure in ("drift_figure", "joints_figure"):
        monkeypatch.setattr(study_files, figure, lambda *_, **__: None)
