"""Run a command in this process, and take what it says."""

from __future__ import annotations

import base64
import contextlib
import io
import json
import sys
from argparse import ArgumentParser, _SubParsersAction
from collections.abc import Callable
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import pytest

import repctl_pin as rp

if TYPE_CHECKING:
    from matplotlib.figure import Figure

main: Callable[[list[str]], int] = entry_points(group="console_scripts")["repctl"].load()
"""The command ``repctl`` as it is installed: words in, exit code out."""

OUT = [
    *("follow", "planar3r", "--strategy", "pseudoinverse", "--start", "6.2,1,-1.4"),
    *("--path", "circle:0.4:0", "--plane", "xy", "--steps", "100"),
]
"""A motion that leaves its limits: theta1 ends at 2π, where this circle takes it."""


def parsers() -> dict[str, ArgumentParser]:
    """The parsers of all commands by their names; that of ``repctl`` itself has none."""
    asked: list[ArgumentParser] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ArgumentParser, "print_help", lambda it, *_: asked.append(it))
        assert main([]) == 2  # without a command, the help of all
    (whole,) = asked
    (commands,) = (
        action.choices for action in whole._actions if isinstance(action, _SubParsersAction)
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
        captured.out == "" and captured.err.count("\n") == 1 and captured.err.startswith("repctl: ")
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


def without_pictures(monkeypatch: pytest.MonkeyPatch) -> list[Figure]:
    """Leave out what a test does not look at, and what takes half of a command's time: figures are
    written as one pixel, and nothing in them is measured. Gives the figures, as they come."""
    figures: list[Figure] = []

    def save(figure: Figure, file: BinaryIO | str | Path, **_: Any) -> None:
        figures.append(figure)
        if isinstance(file, str | Path):
            Path(file).write_bytes(PIXEL)
        else:
            file.write(PIXEL)

    monkeypatch.setattr("matplotlib.figure.Figure.savefig", save)
    for measured in ("layout_engine.ConstrainedLayoutEngine.execute", "axis.Axis.get_tightbbox"):
        monkeypatch.setattr(f"matplotlib.{measured}", lambda *_, **__: None)
    return figures


def without_tours(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave the motion along a sample path out of the page of a cell."""
    module = import_module("repctl_pin.extensions.cells.cell_command")
    monkeypatch.setattr(module, "_tour", lambda design: ({}, []))


PIXEL = base64.b64decode(
    "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAAAAAA6fptVAAAACklEQVR4nGNgAAAAAgABSK+kcQAAAABJRU5ErkJggg=="
)


def printed(study: rp.Study, folder: Path, *options: str) -> tuple[str, list[Figure]]:
    """What ``repctl study`` prints of a study that is there already, and the figures in the files
    that it writes into a folder. It prints to a terminal if the test has set one up."""
    screen = type(sys.stdout) if isinstance(sys.stdout, io.StringIO) else io.StringIO
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(screen()) as out:
        figures = without_pictures(patch)
        patch.setattr(rp, "Problem", lambda *_, **__: None)
        patch.setattr(rp, "study", lambda *_, **__: study)
        name = str(study.robot.description.path)
        assert main(["study", name, "--out", str(folder), *options]) == 0
    return out.getvalue(), figures
