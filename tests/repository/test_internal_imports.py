"""How far the tests reach behind the door: every name that they import from inside the package is
one that a rename breaks. The numbers may fall; they do not rise."""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path

import pytest

import repctl_pin as rp

TESTS = Path(__file__).parents[1]
STATEMENTS, NAMES, STRINGS = 58, 114, 14
"""How many there are today: import statements, names that they import, and strings that name a
place inside, as patches do, also those that are added up."""

PLACE = re.compile(r"repctl_pin(\.[a-z_]+){2,}\.?\w*")


PUBLIC = {*dir(rp), "integrations"}


INSIDE = re.compile(r"repctl_pin\.|from repctl_pin import")


@cache
def nodes(source: str) -> list[ast.AST]:
    """The syntax tree of a file that names something inside; the others are not parsed."""
    return list(ast.walk(ast.parse(source))) if INSIDE.search(source) else []


def behind_the_door(source: str) -> list[list[str]]:
    """The names that each import takes from below ``repctl_pin``, if they are not public ones."""
    public = ("repctl_pin.extensions.integrations", "repctl_pin.redundancy")
    found = []
    for node in nodes(source):
        if isinstance(node, ast.Import):
            modules = [alias.name for alias in node.names]
            names = [name for name in modules if name.startswith("repctl_pin.")]
        elif isinstance(node, ast.ImportFrom) and node.module == "repctl_pin":
            names = [a.name for a in node.names if a.name not in PUBLIC]
        elif isinstance(node, ast.ImportFrom) and node.module:
            inside = node.module.startswith("repctl_pin.")
            names = [alias.name for alias in node.names] if inside else []
            if node.module == public[1] or node.module.startswith(public[0]):
                names = []
        else:
            continue
        names = [name for name in names if not name.startswith(public[0])]
        found += [names] if names else []
    return found


def text_of(node: ast.AST) -> str:
    """The value of a string, also of one that is added up from others."""
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        return text_of(node.left) + text_of(node.right)
    constant = isinstance(node, ast.Constant) and isinstance(node.value, str)
    return node.value if constant else ""


def named_inside(source: str) -> list[str]:
    """The strings that name a module below a room, or something in it."""
    values = [text_of(node) for node in nodes(source)]
    public = "repctl_pin.integrations"
    values = [v.replace("repctl_pin.extensions.", "repctl_pin.") for v in values]
    return [v for v in values if PLACE.fullmatch(v) and not v.startswith(public)]


@pytest.mark.parametrize(
    "line, names",
    [
        ("import repctl_pin as rp", []),
        ("from repctl_pin import Box, redundancy", []),
        ("from repctl_pin.redundancy import nullspace", []),
        ("import repctl_pin.extensions.integrations.pink", []),
        ("from repctl_pin.extensions.integrations.ros2 import node", []),
        ("from repctl_pin import Box, files", [["files"]]),
        ("def f():\n    from repctl_pin.show.text import a, b as c", [["a", "b"]]),
        ("import repctl_pin.cli, numpy", [["repctl_pin.cli"]]),
    ],
)
def test_what_is_counted(line: str, names: list[list[str]]) -> None:
    assert behind_the_door(line) == names


@pytest.mark.parametrize(
    "line, places",
    [
        ("patch('repctl_pin.show.plots.png', 1)", ["repctl_pin.show.plots.png"]),
        ("patch(f'repctl_pin.design.fit.{name}')", ["repctl_pin.design.fit."]),
        ("load('repctl_pin.' + 'show.plots')", ["repctl_pin.show.plots"]),
        ("load('repctl_pin.' + ('show.plots.' + name))", ["repctl_pin.show.plots."]),
        ("run('repctl_pin.cli')", []),
        ("'as repctl_pin.show.plots does'", []),
    ],
)
def test_which_strings_are_counted(line: str, places: list[str]) -> None:
    assert named_inside(line) == places


def test_tests_do_not_reach_further_inside() -> None:
    files = set(TESTS.rglob("*.py")) - {Path(__file__)}
    sources = [file.read_text(encoding="utf-8") for file in files]
    found = [names for source in sources for names in behind_the_door(source)]
    assert sum(len(named_inside(source)) for source in sources) <= STRINGS
    assert len(found) <= STATEMENTS
    assert sum(map(len, found)) <= NAMES
    assert not [name for names in found for name in names if name.startswith("_")]
