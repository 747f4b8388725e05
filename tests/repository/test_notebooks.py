"""Every example as a notebook, cut from the script itself, runs in a kernel and prints what the
script prints."""

from __future__ import annotations

import ast
import json
import runpy
import sys
from pathlib import Path

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


@pytest.mark.slow
@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_a_notebook_runs_and_prints_what_the_script_prints(
    script: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from nbclient import NotebookClient
    from nbformat import reads

    if script.stem == "audit_pink":
        pytest.importorskip("pink")
    for name in ("JUPYTER_CONFIG_DIR", "JUPYTER_DATA_DIR", "JUPYTER_RUNTIME_DIR", "IPYTHONDIR"):
        monkeypatch.setenv(name, str(tmp_path / name.lower()))
    book = reads(HOOK["notebook"](script), as_version=4)
    done = NotebookClient(book, kernel_name="python3", timeout=900).execute(cwd=str(tmp_path))
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
