"""The package as a whole: style, types, floors, public names, and imports that stay cheap."""

from __future__ import annotations

import ast
import os
import re
import shutil
import subprocess
import sys
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import matplotlib
import pytest

import repctl_pin

ROOT = Path(__file__).parent.parent


@pytest.mark.parametrize(
    "command",
    [
        ["ruff", "check", "."],
        ["ruff", "format", "--check", "."],
        pytest.param(["mypy"], marks=pytest.mark.slow),
    ],
)
def test_style_and_types(command: list[str]) -> None:
    done = subprocess.run(
        [sys.executable, "-m", *command], cwd=ROOT, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout + done.stderr


SCRIPTS_AND_STYLES = [
    file
    for folder in ("repctl_pin", "docs")
    for kind in ("*.js", "*.css")
    for file in (ROOT / folder).rglob(kind)
]


def test_scripts_and_styles_have_lines_of_at_most_100_characters() -> None:
    assert len(SCRIPTS_AND_STYLES) > 20
    for file in SCRIPTS_AND_STYLES:
        lines = file.read_text(encoding="utf-8").splitlines()
        assert max(map(len, lines)) <= 100, file


@pytest.mark.skipif(shutil.which("prettier") is None, reason="prettier is not installed")
def test_scripts_and_styles_are_formatted_by_prettier() -> None:
    """As pre-commit does."""
    command = ["prettier", "--check", *map(str, SCRIPTS_AND_STYLES)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.skipif(
    matplotlib.__version_info__ < (3, 10), reason="these libraries have other types than newer ones"
)
def test_types_without_those_of_numpy() -> None:
    """NumPy's overloads take three quarters of mypy's time, and only its slow run follows them."""
    options = ["--no-warn-unused-ignores", "--no-warn-redundant-casts"]
    done = subprocess.run(
        [sys.executable, "-m", "mypy", *options, "--cache-dir", ".mypy_cache/quick"],
        cwd=ROOT,
        env=os.environ | {"MYPYPATH": "tests/typing_stubs"},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_floors_import_only_what_lies_below() -> None:
    code = "from importlinter.cli import lint_imports_command; lint_imports_command()"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_documentation_has_the_floors_of_the_contract() -> None:
    contract = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    layers = re.findall(r"^layers = \[\n(.*?)^\]", contract, flags=re.DOTALL | re.MULTILINE)[0]
    floors = [line.replace("repctl_pin.", "") for line in re.findall(r'"(.*)"', layers)]
    assert "```text\n{}\n```".format("\n".join(floors)) in page


def test_no_output_of_a_command_is_in_the_top_folder() -> None:
    """Outputs go to ``repctl-out``, which git ignores, or where --out says."""
    if shutil.which("git") is None or not (ROOT / ".git").exists():
        pytest.skip("requires git and a clone")
    done = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True)
    top = {line.partition("/")[0] for line in done.stdout.splitlines()}
    kept = {"repctl_pin", "urdf", "tests", "examples", "docs"}
    files = {"README.md", "CHANGELOG.md", "CONTRIBUTING.md", "SECURITY.md", "LICENSE"}
    settings = {"pyproject.toml", "mkdocs.yml", "CITATION.cff", "eslint.config.mjs"}
    settings |= {"hatch_build.py"}
    assert {name for name in top if not name.startswith(".")} <= kept | files | settings


def test_the_documentation_names_files_that_exist() -> None:
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    named = set(re.findall(r"`((?:\w+/)+\w+\.(?:py|c|toml))`", page))
    assert len(named) > 20
    for name in named:
        assert any((root / name).is_file() for root in (ROOT, ROOT / "repctl_pin")), name


RELATIVE = re.compile(r"^[ \t]*(from \.[\w.]* import (?:\([^)]*\)|.*))", re.MULTILINE)
"""A statement that imports from the package, inside functions and for types too."""


@cache
def package_files() -> set[Path]:
    return set((ROOT / "repctl_pin").rglob("*.py"))


@cache
def imports_of(path: Path) -> set[Path]:
    """List the files of the package that a file imports; only its imports are parsed."""
    found = set()
    for statement in RELATIVE.findall(path.read_text(encoding="utf-8")):
        (node,) = ast.parse(statement).body
        assert isinstance(node, ast.ImportFrom)
        module = path.parents[node.level - 1].joinpath(
            *(node.module.split(".") if node.module else ())
        )
        for name in node.names:
            stems = (module / name.name, module)
            places = [
                place for stem in stems for place in (Path(f"{stem}.py"), stem / "__init__.py")
            ]
            found.add(next(place for place in places if place in package_files()))
    return found - {path}


def test_no_two_files_import_each_other() -> None:
    """repctl_pin/__init__.py is left out: it imports a public name when the name is first used."""
    files = package_files() - {ROOT / "repctl_pin" / "__init__.py"}
    graph = {path: imports_of(path) & files for path in files}
    assert sum(map(len, graph.values())) > 300
    TopologicalSorter(graph).prepare()  # raises CycleError, which names the files


def test_every_public_name_exists() -> None:
    for name in dir(repctl_pin):
        assert getattr(repctl_pin, name) is not None
    with pytest.raises(AttributeError):
        repctl_pin.no_such_name  # noqa: B018


def test_public_names_are_those_of_the_type_checker() -> None:
    package = Path(repctl_pin.__file__).parent
    assert (package / "py.typed").exists()
    stub = ast.parse((package / "__init__.pyi").read_text(encoding="utf-8"))
    imports = [node for node in stub.body if isinstance(node, ast.ImportFrom)]
    typed = {name.asname for node in imports for name in node.names}
    assert typed == set(dir(repctl_pin))


def test_the_core_imports_no_extension() -> None:
    """Issue 21: it finds them by name, through ``plugins.py``."""
    extensions = ROOT / "repctl_pin" / "extensions"
    core = [path for path in package_files() if extensions not in path.parents]
    found = {path: [p for p in imports_of(path) if extensions in p.parents] for path in core}
    assert len(core) > 100 and not any(found.values()), found


def test_modules_of_the_core_load_no_part_of_scipy() -> None:
    """Issue 56, item 7: its parts take longer to import than a control loop takes to begin.

    The modules are those of the core up to designs, cells, and the relabelling of recordings.
    """
    code = (
        "import sys, repctl_pin as rp\n"
        "rp.relabel, rp.nearest_repeatable, rp.solve_ik, rp.follow, rp.polygon\n"
        "from repctl_pin.extensions.recordings import relabel_command\n"
        "from repctl_pin.show.page import scene\n"
        "loaded = [x for x in sys.modules if x.startswith('scipy.') and x.count('.') == 1]\n"
        "sys.exit(f'imported: {loaded}' if {'scipy.linalg', 'scipy.spatial'} & {*loaded} else 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_import_and_help_load_no_large_package() -> None:
    """`import repctl_pin` and `repctl --help` stay quick; this test measures no time."""
    code = (
        "import sys, repctl_pin, repctl_pin.cli as cli\n"
        "try: cli.main(['--help'])\n"
        "except SystemExit: pass\n"
        "large = {'pinocchio', 'numpy', 'scipy', 'matplotlib', 'meshcat', 'lxml'}\n"
        "loaded = large & set(sys.modules)\n"
        "sys.exit(f'imported: {loaded}' if loaded else 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
