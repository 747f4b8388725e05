"""The documentation builds without a warning, names every public thing, and its Python runs."""

from __future__ import annotations

import ast
import inspect
import json
import re
import runpy
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec
import pytest
import yaml
from shown import likeness

import repctl_pin as rp
from repctl_pin.saving.schema import DesignFile

ROOT = Path(__file__).parents[2]
# run with its examples
PAGES = [
    page
    for page in sorted((ROOT / "docs").rglob("*.md"))
    if "reference" not in page.relative_to(ROOT).parts
]


@pytest.mark.slow
def test_the_site_builds_strictly(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Dead links and names that do not exist are warnings, and warnings are errors."""
    pytest.importorskip("mkdocs")
    from mkdocs.commands.build import build
    from mkdocs.config import load_config

    monkeypatch.setenv("NO_MKDOCS_2_WARNING", "1")
    monkeypatch.setenv("REPCTL_LIVE", "no")
    monkeypatch.chdir(ROOT)
    build(load_config("mkdocs.yml", strict=True, site_dir=str(tmp_path)))
    assert (tmp_path / "theory" / "index.html").read_text(encoding="utf-8").count("<math") > 20
    commands = (tmp_path / "commands" / "index.html").read_text(encoding="utf-8")
    assert "--allow-violations" in commands and "<!-- commands -->" not in commands
    home = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert 'media="(prefers-color-scheme)"' in home and "md-footer__link--next" in home
    assert len(list((tmp_path / "pictures").glob("*.png"))) == len(
        list((ROOT / "examples" / "pictures").glob("*.png"))
    )
    pages = (file.read_text(encoding="utf-8") for file in tmp_path.rglob("*.html"))
    assert not any(re.search("<!-- (live: |robots)", page) or "](../" in page for page in pages)


def test_links_between_pages_lead_to_files_and_headings() -> None:
    """Quickly, what the strict build of the site checks of them."""
    checked = 0
    for page in sorted((ROOT / "docs").rglob("*.md")):
        text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
        for link in re.findall(r"\]\(([^)\s]+)\)", text):
            name, _, part = link.partition("#")
            if ":" in name:
                continue
            file = (page.parent / name).resolve() if name else page
            made = ROOT / "examples" / f"{file.stem}.py", ROOT / "examples" / "pictures" / file.name
            assert file.exists() or any(source.exists() for source in made), link
            if part and file.suffix == ".md" and ROOT / "docs" in file.parents:
                assert part in headings(file), link
            checked += 1
    assert checked > 100


def headings(page: Path) -> set[str]:
    """The names of the places of a page to which links lead."""
    text = page.read_text(encoding="utf-8")
    heads = [
        re.sub(r"[^\w\s-]", "", h.lower()).strip() for h in re.findall(r"^#+ (.*)$", text, re.M)
    ]
    found = {re.sub(r"[\s-]+", "-", head) for head in heads}
    found |= {f"live-{name}" for name in re.findall(r"<!-- live: (\w+) -->", text)}
    if "<!-- robots -->" in text:
        robots = runpy.run_path(str(ROOT / "docs" / "hooks" / "live.py"))["ROBOTS"]
        found.add(f"live-{next(iter(robots))}")
    found |= set(re.findall(r'\bid="([^"]+)"', text)) | set(re.findall(r"\{ *#([\w-]+)", text))
    if "<!-- commands -->" in text:
        found |= set(runpy.run_path(str(ROOT / "docs" / "hooks" / "commands.py"))["commands"]())
    return found


@pytest.mark.slow
def test_live_pages_are_made_for_the_marks(tmp_path: Path) -> None:
    """Each mark has its page; one of them is made here, all by a strict build of the site."""
    live = runpy.run_path(str(ROOT / "docs" / "hooks" / "live.py"))
    text = "".join(page.read_text(encoding="utf-8") for page in PAGES)
    marked = set(re.findall(r"<!-- live: (\w+) -->", text))
    assert marked | set(live["ROBOTS"]) == set(live["PAGES"])
    assert text.count("<!-- robots -->") == 1 and len(live["ROBOTS"]) == 12
    home = SimpleNamespace(
        is_homepage=True, file=SimpleNamespace(dest_uri="index.html", src_uri="index.md")
    )
    assert 'src="live/panda.html"' in live["on_page_markdown"]("<!-- live: panda -->", page=home)
    choice = live["on_page_markdown"]("<!-- robots -->", page=home)
    offered = re.findall(r'<option value="live/(\w+)\.html">', choice)
    assert offered == list(live["ROBOTS"]) and choice.count("<iframe") == 1
    made = live["studied"]("planar3r", cycles=1, steps=40, degree=1)
    assert made.startswith("<!DOCTYPE html>") and "http://" not in made.split("<script")[0]


def test_links_to_the_repository_follow_its_one_address() -> None:
    hook = runpy.run_path(str(ROOT / "docs" / "hooks" / "repository.py"))["on_page_markdown"]
    page = SimpleNamespace(file=SimpleNamespace(src_uri="how-to/a.md"))
    text = "[b](../b.md) and [script](../../examples/c.py)"
    without, at = (
        SimpleNamespace(repo_url=None),
        SimpleNamespace(repo_url="https://host.example/r/"),
    )
    assert hook(text, page=page, config=without) == "[b](../b.md) and script"
    assert hook(text, page=page, config=at) == (
        "[b](../b.md) and [script](https://host.example/r/blob/HEAD/examples/c.py)"
    )


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
    pages = sorted((ROOT / "docs" / "reference").glob("*.md"))
    listed = [
        name
        for page in pages
        for name in re.findall(r"^::: (\S+)$", page.read_text("utf-8"), flags=re.MULTILINE)
    ]
    public = [
        getattr(rp, name) for name in dir(rp) if name not in ("arrays", "redundancy", "__version__")
    ]
    public += [rp.arrays.inverse_function, rp.arrays.pose_and_leaf, rp.arrays.velocity]
    assert sorted(listed) == sorted(f"{thing.__module__}.{thing.__qualname__}" for thing in public)
    index = (ROOT / "docs" / "reference" / "index.md").read_text("utf-8")
    table = re.findall(r"^\| \[.*?\| (.*) \|$", index, flags=re.MULTILINE)
    named = re.findall(r"`(\w+)`", " ".join(table))
    assert sorted(named) == sorted(thing.__name__ for thing in public)


def python_of(page: Path) -> list[str]:
    """The blocks of Python in a page."""
    return re.findall(r"```python\n(.*?)```", page.read_text("utf-8"), flags=re.DOTALL)


LONG = {"proof", "cell", "pick-and-place", "learning", "bodies", "two-hands", "pink", "audit"}
LONG |= {
    "python",
    "paths-and-time",
    "architecture",
    "own-urdf",
    "surveys",
    "which",
    "robot",
    "mujoco",
}
"""Pages whose Python takes seconds: among the slow tests."""


@pytest.mark.parametrize(
    "page",
    [
        pytest.param(page, marks=[pytest.mark.slow] if page.stem in LONG else [])
        for page in filter(python_of, PAGES)
    ],
    ids=lambda page: page.stem,
)
def test_the_python_of_a_page_runs(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, quick_choices: None
) -> None:
    """With fewer nodes, which change no claim. What is compiled by jax runs in the slow test."""
    monkeypatch.chdir(tmp_path)
    for robot in ("my_arm", "weld_cell", "rail_cell", "turntable_cell"):
        shutil.copy(ROOT / "examples" / f"{robot}.urdf", tmp_path)
    names: dict = {}
    for block in python_of(page):
        code = compile(block, str(page), "exec")
        if "import jax" not in block:
            exec(code, names)


@pytest.mark.parametrize("page", [*filter(python_of, PAGES)], ids=lambda page: page.stem)
def test_the_python_of_a_page_uses_names_that_exist(page: Path) -> None:
    """Quickly, of the pages whose Python runs in the slow test too."""
    for node in ast.walk(ast.parse("\n".join(python_of(page)))):
        if isinstance(node, ast.Attribute) and getattr(node.value, "id", "") == "rp":
            assert hasattr(rp, node.attr), node.attr
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            if getattr(node.func.value, "id", "") != "rp":
                continue
            taken = inspect.signature(getattr(rp, node.func.attr)).parameters.values()
            if not any(one.kind is one.VAR_KEYWORD for one in taken):
                given = {word.arg for word in node.keywords if word.arg}
                assert given <= {one.name for one in taken}, ast.unparse(node)


@pytest.mark.slow
@pytest.mark.parametrize(
    "page", [page for page in PAGES if "import jax" in page.read_text("utf-8")], ids=str
)
def test_the_python_of_a_page_with_jax_runs(page: Path, tmp_path: Path) -> None:
    """In a process of its own, because the threads of jax do not survive forks."""
    code = "\n".join(python_of(page))
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, check=False)
    assert done.returncode == 0


def test_the_schema_of_a_design_file_is_the_decoders() -> None:
    pytest.importorskip("msgspec", minversion="0.22")  # earlier ones write a schema in other words

    def without_indents(node: Any) -> Any:
        """Strip the indents of docstrings, which msgspec keeps before its version 0.23."""
        if isinstance(node, dict):
            return {key: without_indents(value) for key, value in node.items()}
        if isinstance(node, list):
            return [without_indents(value) for value in node]
        return inspect.cleandoc(node) if isinstance(node, str) else node

    schema = json.loads((ROOT / "docs" / "design.schema.json").read_text(encoding="utf-8"))
    assert schema == without_indents(msgspec.json.schema(DesignFile))


def redraw(names: list[str], folder: Path) -> None:
    """Draw figures anew, and hold them against those that are kept."""
    script = runpy.run_path(str(ROOT / "docs" / "figures.py"))
    script["main"](folder, names)
    assert {file.stem for file in folder.iterdir()} == set(names)
    for file in folder.iterdir():
        assert likeness(file, ROOT / "docs" / "figures" / file.name) > 0.8, file.name


def test_the_figures_of_the_theory_are_there(tmp_path: Path) -> None:
    """Those of the examples are held to their scripts by test_examples.py."""
    kept = sorted((ROOT / "docs" / "figures").glob("*.png"))
    names = [
        "cell",
        "cloning",
        "closing",
        "drift",
        "proofs",
        "ring",
        "states",
        "survey",
        "teleoperation",
    ]
    assert [file.stem for file in kept] == names
    assert all(file.stat().st_size < 150_000 for file in kept)
    linked = re.findall(
        r"\]\((\S+\.png)\)", (ROOT / "docs" / "theory.md").read_text(encoding="utf-8")
    )
    assert len(linked) == 6 and all((ROOT / "docs" / name).resolve().is_file() for name in linked)
    redraw(["states"], tmp_path)


@pytest.mark.slow
def test_the_dear_figures_of_the_theory_are_what_the_package_draws(tmp_path: Path) -> None:
    redraw(["cell", "drift", "proofs", "ring", "survey"], tmp_path)


def test_version_and_date_are_the_same_wherever_they_stand() -> None:
    """In the changelog, which is one page, in CITATION.cff and in the BibTeX entry of the site."""
    changes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    version, date = re.findall(r"^## (\S+), (\d{4}-\d\d-\d\d)$", changes, flags=re.MULTILINE)[0]
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert version == rp.__version__ == citation["version"]
    assert date == str(citation["date-released"])
    entry = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    assert f"version = {{{version}}}" in entry and f"year    = {{{date[:4]}}}" in entry
    assert len(changes.splitlines()) <= 80


def test_the_slow_tests_run_on_a_schedule() -> None:
    """Issue 37, item 23: they had been failing unseen."""
    workflow = yaml.safe_load((ROOT / ".github" / "workflows" / "slow.yml").read_text())
    assert workflow[True]["schedule"]  # YAML reads the key "on" as true
    (job,) = workflow["jobs"].values()
    command = "python -m pytest -m slow -n 0"
    parts = job["strategy"]["matrix"]["part"]
    assert [part.split("/") for part in parts] == [
        [str(k), str(len(parts))] for k in range(1, len(parts) + 1)
    ]
    last = f"{command} --part ${{{{ matrix.part }}}}"
    assert any(last in step.get("run", "") for step in job["steps"])
    assert f"`{command}`" in (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
