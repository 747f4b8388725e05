"""Run a command in this process, and take what it says."""

from __future__ import annotations

import json

import pytest

from repctl_pin.cli import main


def told(capsys: pytest.CaptureFixture[str], *arguments: str) -> dict:
    """The JSON of a command that does what it should."""
    assert main([*arguments, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def refused(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """The one line of a command that refuses what it was given."""
    assert main([*arguments]) == 2
    captured = capsys.readouterr()
    assert (
        captured.out == "" and captured.err.count("\n") == 1 and captured.err.startswith("repctl: ")
    )
    return captured.err
