"""Every public name has a docstring that says what it raises, and an example that runs."""

from __future__ import annotations

import doctest
import functools
import inspect
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import repctl_pin as rp

NAMES = [
    name for name in dir(rp) if name != "__version__" and not inspect.ismodule(getattr(rp, name))
]
SHARED = re.search(
    r"```python\n(.*?)```",
    (Path(__file__).parents[2] / "docs" / "reference" / "index.md").read_text(encoding="utf-8"),
    flags=re.DOTALL,
)


@pytest.mark.slow
@pytest.mark.filterwarnings("error::UserWarning")
def test_every_public_name_has_an_example_that_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, quick_choices: None, quick_places: None
) -> None:
    """All in one test: the arms and designs that the reference page begins with are made once."""
    monkeypatch.chdir(tmp_path)
    for function in ("study", "best_leaf", "best_cell", "relabel", "nearest_inverse_function"):
        monkeypatch.setattr(rp, function, computed_once_each(getattr(rp, function)))
    assert SHARED is not None
    shared: dict[str, object] = {}
    exec(SHARED[1], shared)
    runner, said = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE), []
    for name in NAMES:
        found = doctest.DocTestParser().get_doctest(
            inspect.getdoc(getattr(rp, name)), dict(shared), name, None, 0
        )
        assert found.examples, f"{name} has no example"
        assert not any("+SKIP" in example.source for example in found.examples), (
            f"{name}'s example does not run"
        )
        runner.run(found, out=said.append)
    assert runner.summarize(verbose=False).failed == 0, "".join(said)


def computed_once_each(compute: Callable[..., Any]) -> Callable[..., Any]:
    """Compute once for each set of arguments, as several examples have the same."""
    found: dict[str, Any] = {}

    @functools.wraps(compute)
    def computed(*given: Any, **options: Any) -> Any:
        key = repr((given, options))
        if key not in found:
            found[key] = given, options, compute(*given, **options)
        return found[key][-1]

    return computed


def test_what_a_name_raises_is_said() -> None:
    """Of every function, and of every class that is made by calling it; results of functions raise
    nothing."""
    for name in NAMES:
        thing = getattr(rp, name)
        text = inspect.getdoc(thing) or ""
        if inspect.isfunction(thing) or "Parameters\n---" in text:
            assert "Raises\n------\n" in text, name


PURE = re.findall(
    r"\w+",
    "cost cost_error fit_cost gradient_norm scanned_costs degrees relative_distance leaf_margin "
    "inside_limits shrunk found factor "
    "tolerance damping leaf_damping gain parameter scanned bounds leaf margin path rate weight",
)
"""Shares, costs, gains and truth values: no unit, or that of a user's own function."""


def test_numbers_have_units_and_arrays_have_shapes() -> None:
    """Of every parameter, and of every field of a result, that is a number or an array of them."""
    for name in NAMES:
        thing = getattr(rp, name)
        if not (isinstance(thing, type) and issubclass(thing, Exception)):
            check_units_and_shapes(name, thing)


def check_units_and_shapes(name: str, thing: Any) -> None:
    entries: dict[str, str] = {}
    for head, body in re.findall(
        r"^(\w.*)\n((?:[ ]{4}.*\n?)+)", inspect.getdoc(thing) or "", flags=re.MULTILINE
    ):
        entries |= {key.strip(): f"{head} {body}" for key in head.split(":")[0].split(",")}
    for key, parameter in inspect.signature(thing).parameters.items():
        kind = str(parameter.annotation)
        if not re.search(r"Array|float", kind) or "Callable" in kind:
            continue
        text = entries.get(key, "")
        assert key in PURE or re.search(
            r"\b(rad|m|s|Hz|N|Nm|1/s|radius)\b|axes|as `|As :func:", text
        ), (name, key, text)
        assert "Array" not in kind or re.search(
            r"\(\w+(, \w+)*,?( \+ 1)?,?\)|\([A-Za-z] ?\+", text
        ), (name, key, text)
