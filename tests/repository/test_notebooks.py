"""Every example as a notebook, cut from the script itself, runs in a kernel and prints what the
script prints."""

from __future__ import annotations

import ast
import json
import re
import runpy
import sys
from pathlib import Path
from typing import Any

import pytest
from shown import steady
from test_examples import SHOWN

HOOK = runpy.run_path(str(Path(__file__).parents[2] / "docs" / "hooks" / "examples.py"))
SCRIPTS = HOOK["scripts"]()


def code(book: dict) -> str:
    """All that is run, the cells one after the other."""
    return "\n\n".join(
        "".join(cell["source"]) for cell in book["cells"] if cell["cell_type"] == "code"
    )


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_a_notebook_holds_its_script_whole(script: Path) -> None:
    """Every function and constant, unchanged; the words are its first cell."""
    text = HOOK["notebook"](script)
    assert text == HOOK["notebook"](script)  # the same each time
    book = json.loads(text)
    assert book["cells"][0]["cell_type"] == "markdown"
    mine = [ast.dump(node) for node in ast.parse(script.read_text(encoding="utf-8")).body[1:-1]]
    assert [ast.dump(node) for node in ast.parse(code(book)).body][: len(mine)] == mine


@pytest.mark.slow
def test_the_code_of_a_notebook_runs_and_prints(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """In this process and few steps: pink alone drifts. The slow test runs every notebook in a
    kernel, and holds what it prints against the page."""
    pytest.importorskip("pink")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [])
    script = next(script for script in SCRIPTS if script.stem == "audit_pink")
    names: dict = {"__name__": "__main__"}
    for cell in json.loads(HOOK["notebook"](script))["cells"]:
        if cell["cell_type"] == "code":
            source = "".join(cell["source"])
            for many, few in (("default=10)", "default=2)"), ("default=500,", "default=100,")):
                source = source.replace(many, few)
            exec(source, names)
    shown = SHOWN[f"python examples/{script.name}"].splitlines()
    told = capsys.readouterr().out.splitlines()
    assert [s[:18] for s in told] == [s[:18] for s in shown]
    first, last = ([float(s.split()[k]) for s in told[2:5]] for k in (-3, -2))
    assert last[0] > 1.9 * first[0] > 0.1 and last[2] < 1e-2
    assert abs(last[2] - first[2]) < 1e-5


BOOK = Path(__file__).parents[2] / "examples" / "first_study.ipynb"


def test_the_notebook_of_the_examples_has_no_outputs_and_is_on_their_page() -> None:
    book = json.loads(BOOK.read_text(encoding="utf-8"))
    assert not any(cell.get("outputs") for cell in book["cells"])
    page = (BOOK.parent / "README.md").read_text(encoding="utf-8")
    assert f"## {BOOK.name}: " in page


@pytest.mark.slow
def test_the_notebook_of_the_examples_runs_from_top_to_bottom(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its first cell shows the animation, the table and two figures; J⁺ drifts, ours does not."""
    done = run_in_a_kernel(BOOK.read_text(encoding="utf-8"), tmp_path, monkeypatch)
    outputs = [cell.outputs for cell in done.cells if cell.cell_type == "code"]
    shown = outputs[0][-1].data["text/html"]
    assert shown.startswith("<iframe ") and "<pre " in shown and shown.count("<img ") == 2
    last = outputs[1][0].text.splitlines()[-1]
    usual, repeatable = map(float, re.findall(r"(\S+) rad", last))
    assert usual > 1 and repeatable < 1e-9
    drifts = [float(text) for text in re.findall(r"drift (\S+) rad", outputs[2][0].text)]
    assert drifts[0] > 1e-2 and drifts[-1] < 1e-10


def run_in_a_kernel(book: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Run a notebook from top to bottom in an empty folder, with nobody's own settings."""
    from nbclient import NotebookClient
    from nbformat import reads

    for name in ("JUPYTER_CONFIG_DIR", "JUPYTER_DATA_DIR", "JUPYTER_RUNTIME_DIR", "IPYTHONDIR"):
        monkeypatch.setenv(name, str(folder / name.lower()))
    client = NotebookClient(reads(book, as_version=4), kernel_name="python3", timeout=900)
    return client.execute(cwd=str(folder))


@pytest.mark.slow
@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_a_notebook_runs_and_prints_what_the_script_prints(
    script: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if script.stem == "audit_pink":
        pytest.importorskip("pink")
    done = run_in_a_kernel(HOOK["notebook"](script), tmp_path, monkeypatch)
    outputs = [output for cell in done.cells if cell.cell_type == "code" for output in cell.outputs]
    told = "".join(
        output.text
        for output in outputs
        if output.output_type == "stream" and output.name == "stdout"
    )
    if f"python examples/{script.name}" in SHOWN:  # the survey's is the table of docs/survey.md
        assert steady(told) == steady(SHOWN[f"python examples/{script.name}"])
    pictures = [output for output in outputs if "image/png" in output.get("data", {})]
    assert bool(pictures) == (".savefig(" in script.read_text(encoding="utf-8"))
