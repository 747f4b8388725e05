"""The words of the house: names and phrases that were replaced do not come back."""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from commands import parsers

import repctl_pin as rp

ROOT = Path(__file__).parents[1]

NAMES = """
    section fields Field FieldMap Family room apart dexterity
    Wish Way Guarded Watch Keeper Kept Stop Sides Deed Limb Broken Track
    rung told toward wanted stacks gate keeper inplace judgement settled
"""
"""Identifiers that are not used anywhere: classes, functions, parameters, attributes, variables."""

ORDINARY = {
    "fields": {"repctl_pin/motion/joint_motion.py"}  # dataclasses.fields
}
"""Files in which such an identifier has its ordinary sense."""

MEMBERS = {
    rp: "Potentials settled",
    rp.Robot: "velocity",
    rp.Task: "part full rate T",
    rp.TaskPath: "words",
}
"""Attributes that an object does not have; elsewhere the words have their ordinary sense."""

FUNCTIONS = {"repctl_pin/base/arguments.py": "wanted chosen whole spread stacks rows numbers"}
"""Functions that a file does not have."""

PARAMETERS = {
    rp.nearest_repeatable: "fields",
    rp.nearest_inverse_function: "room apart dexterity",
    rp.LimitWeight: "room",
    rp.RepeatableInverse.step: "limit",
    rp.Cell: "rotation",
    rp.study: "task",
}
"""Parameters that a function does not have."""

OPTIONS = {"--room", "--apart", "--dexterity", "--rotation", "--fields"}
"""Options that no command has."""

STEMS = """
    section fields gate way keeper stops tour middle inplace result judgement
"""
"""Names that no file or folder of the package has."""

PHRASES = {
    "a person": r"\ba\s+person\b(?!'s skeleton)",
    "so many": r"\bso\s+many\b",
    "at hand": r"\bat\s+hand\b",
    "of one's own": r"\bof\s+one['’]?s\s+own\b",
    "the least": r"\bthe\s+least\b(?![\s-]+squares)",
    "nobody": r"\bnobody\b",
    "told": r"\btold\b",
    "Of …": r"(?-i:(?<![\w-])Of)\b",  # a sentence that begins so
}
"""Phrases that no text has, each with its regular expression."""

TEXTS = {
    ".py",
    ".md",
    ".toml",
    ".yml",
    ".js",
    ".html",
    ".css",
    ".c",
    ".h",
    ".hpp",
    ".urdf",
    ".srdf",
}
"""Suffixes of the files that are read."""


def files() -> Iterator[tuple[str, Path]]:
    """Yield the files of the package, the documentation and the examples."""
    pages = [ROOT / name for name in ("README.md", "CONTRIBUTING.md", "mkdocs.yml")]
    for folder in ("repctl_pin", "docs", "examples", "urdf"):
        pages += sorted((ROOT / folder).rglob("*"))
    for path in pages:
        name = path.relative_to(ROOT).as_posix()
        if path.suffix in TEXTS:
            yield name, path


def identifiers(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Yield the identifiers of a module with their lines."""
    for node in ast.walk(tree):
        for key in ("name", "asname", "id", "attr", "arg"):
            value = getattr(node, key, None)
            if isinstance(value, str):
                line = getattr(node, "lineno", 0)
                yield from ((line, part) for part in value.split("."))


def test_replaced_names_are_not_identifiers() -> None:
    found = []
    replaced = set(NAMES.split())
    written = re.compile(rf"\b(?:{'|'.join(replaced)})\b")
    for name, path in files():
        text = path.read_text(encoding="utf-8")
        if path.suffix != ".py" or not written.search(text):
            continue  # unparsed: an identifier is a word of the text
        for line, word in identifiers(ast.parse(text)):
            if word in replaced and name not in ORDINARY.get(word, ()):
                found.append(f"{name}:{line}: {word}")
    assert not found, "\n".join(found)


def test_replaced_phrases_are_not_in_texts() -> None:
    found = []
    for name, path in files():
        text = path.read_text(encoding="utf-8")
        lower = text.lower()
        for phrase, pattern in PHRASES.items():
            if not all(word in lower for word in re.findall(r"[a-z]+", phrase.lower())):
                continue  # a phrase is searched for where all its words are
            for match in re.finditer(pattern, text, re.IGNORECASE):
                line = text.count("\n", 0, match.start()) + 1
                found.append(f"{name}:{line}: {phrase}")
    assert not found, "\n".join(found)


def test_replaced_names_are_not_files() -> None:
    names = {path.relative_to(ROOT).as_posix() for path in (ROOT / "repctl_pin").rglob("*")}
    assert not [name for name in sorted(names) if Path(name).stem in STEMS.split()]


def test_replaced_members_and_parameters_are_gone() -> None:
    for thing, words in MEMBERS.items():
        assert not [word for word in words.split() if hasattr(thing, word)]
    for file, words in FUNCTIONS.items():
        tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))
        functions = {n.name for n in tree.body if isinstance(n, ast.FunctionDef)}
        assert functions and not functions & set(words.split())
    for function, words in PARAMETERS.items():
        assert not set(words.split()) & set(inspect.signature(function).parameters)


def test_replaced_options_are_gone() -> None:
    for command in parsers().values():
        options = {option for action in command._actions for option in action.option_strings}
        assert not options & OPTIONS


@pytest.mark.parametrize(
    "text",
    [
        "what a\nperson gives",
        "at most so many",
        "the least joint speed",
        "Told by θ₃",
        '"""Of the path."""',
        "limits. Of these, two",
    ],
)
def test_the_phrases_are_found(text: str) -> None:
    assert any(re.search(pattern, text, re.IGNORECASE) for pattern in PHRASES.values())


@pytest.mark.parametrize("text", ["the least-squares start", "at least one", "a list of paths"])
def test_ordinary_phrases_are_not_found(text: str) -> None:
    assert not any(re.search(pattern, text, re.IGNORECASE) for pattern in PHRASES.values())
