"""The documentation builds without a warning, names every public thing, and its Python runs."""

from __future__ import annotations

import json
import os
import re
import runpy
import subprocess
import sys
from pathlib import Path

import msgspec
import pytest
from shown import likeness

import repctl_pin as rp
from repctl_pin.saving.schema import DesignFile

ROOT = Path(__file__).parents[2]
PAGES = [
    page for page in sorted((ROOT / "docs").rglob("*.md")) if page.name != "reference.md"
]  # run with its examples


def test_the_site_builds_strictly(tmp_path: Path) -> None:
    """Dead links and names that do not exist are warnings, and warnings are errors."""
    pytest.importorskip("mkdocs")
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "-q", "-d", str(tmp_path)],
        cwd=ROOT,
        env=os.environ | {"NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "theory" / "index.html").read_text(encoding="utf-8").count("<math") > 20
    commands = (tmp_path / "commands" / "index.html").read_text(encoding="utf-8")
    assert "--allow-violations" in commands and "<!-- commands -->" not in commands


def test_the_page_of_the_command_line_says_when_to_use_each() -> None:
    """Their help is put there from the parser when the site is built."""
    text = (ROOT / "docs" / "commands.md").read_text(encoding="utf-8")
    helps = runpy.run_path(str(ROOT / "docs" / "hooks" / "commands.py"))["commands"]()
    assert sorted(re.findall(r"^\| \[`(\w+)`\]\(#\1\) \| ", text, flags=re.MULTILINE)) == sorted(
        helps
    )
    for name, words in helps.items():
        assert words.startswith(f"usage: repctl {name} ") and "\x1b" not in words


def test_the_reference_names_everything_public() -> None:
    listed = re.findall(
        r"^::: (\S+)$",
        (ROOT / "docs" / "reference.md").read_text(encoding="utf-8"),
        flags=re.MULTILINE,
    )
    public = [getattr(rp, name) for name in dir(rp) if name not in ("redundancy", "__version__")]
    assert sorted(listed) == sorted(f"{thing.__module__}.{thing.__qualname__}" for thing in public)


@pytest.mark.parametrize(
    "page", [page for page in PAGES if "```python" in page.read_text(encoding="utf-8")], ids=str
)
def test_the_python_of_a_page_runs(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    blocks = re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    if any("import jax" in block for block in blocks):  # its threads do not survive forks
        done = subprocess.run([sys.executable, "-c", "\n".join(blocks)], check=False)
        assert done.returncode == 0
        return
    for block in blocks:
        exec(block, names)


def test_the_schema_of_a_design_file_is_the_decoders() -> None:
    pytest.importorskip("msgspec", minversion="0.22")  # earlier ones write a schema in other words
    schema = json.loads((ROOT / "docs" / "design.schema.json").read_text(encoding="utf-8"))
    assert schema == msgspec.json.schema(DesignFile)


def test_the_figures_of_the_theory_are_what_the_package_draws(tmp_path: Path) -> None:
    """Drawn anew; those of the examples are held to their scripts by test_examples.py."""
    script = ROOT / "docs" / "figures.py"
    runpy.run_path(str(script))["main"](tmp_path)
    kept = sorted((ROOT / "docs" / "figures").glob("*.png"))
    assert [file.name for file in kept] == sorted(file.name for file in tmp_path.iterdir())
    for file in kept:
        assert file.stat().st_size < 150_000
        assert likeness(tmp_path / file.name, file) > 0.8, file.name
    linked = re.findall(
        r"\]\((\S+\.png)\)", (ROOT / "docs" / "theory.md").read_text(encoding="utf-8")
    )
    assert len(linked) == 5 and all((ROOT / "docs" / name).resolve().is_file() for name in linked)
