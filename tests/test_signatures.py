"""Signatures at the door: arrays as anything array-like, closed choices, few options."""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

import repctl_pin as rp

HERE = Path(__file__).parent
SCRIPT = HERE / "user_script.py"
MOST = 6
OBJECTS = {"options", "progress"}
"""Options that are objects with options of their own, and the progress callback."""


def made_by_functions(name: str) -> bool:
    """Whether a class is a result, whose constructor users do not call."""
    return "Examples" in (inspect.getdoc(getattr(rp, name)) or "") and name in {
        "Audit",
        "BestCell",
        "CellDesign",
        "ClosingRadius",
        "Design",
        "Motion",
        "MotionBetween",
        "PathCertificate",
        "Proof",
        "Relabeled",
        "Study",
        "TaskPath",
        "TimedMotion",
        "Waypoints",
    }


def public_callables() -> Iterator[tuple[str, Callable[..., Any]]]:
    for name, formula in inspect.getmembers(rp.redundancy, inspect.isfunction):
        yield f"redundancy.{name}", formula
    for name in dir(rp):
        thing = getattr(rp, name)
        if inspect.isfunction(thing):
            yield name, thing
        if not inspect.isclass(thing):
            continue
        if "__init__" in vars(thing) and not made_by_functions(name):
            yield name, thing
        for key in dir(thing):
            method = inspect.getattr_static(thing, key)
            method = getattr(method, "__func__", method)
            if inspect.isfunction(method) and (key == "__call__" or not key.startswith("_")):
                yield f"{name}.{key}", method


CALLABLES = dict(public_callables())


def test_arrays_are_taken_as_anything_array_like() -> None:
    strict = []
    for name, function in CALLABLES.items():
        if name in ("SingularRegionError", "CellDesign.of", "InverseFunction.batch"):
            continue
        for parameter in inspect.signature(function).parameters.values():
            kind = re.sub(r"Callable\[\[[^\]]*\], [^\]]*\]", "", str(parameter.annotation))
            kind = re.sub(r"Sequence\[ArrayLike\] \| Array", "", kind)
            if re.search(r"\b(Array|ndarray|SE3)\b", kind):
                strict.append(f"{name}({parameter.name}: {parameter.annotation})")
    assert strict == []


def test_functions_take_at_most_six_options() -> None:
    many = []
    for name, function in CALLABLES.items():
        parameters = inspect.signature(function).parameters.values()
        options = [p.name for p in parameters if p.kind is p.KEYWORD_ONLY and p.name not in OBJECTS]
        in_step = name.endswith(("step", "FitOptions"))
        if len(options) > MOST and not in_step:
            many.append(name)
    assert many == []


def test_the_users_script_names_everything_at_the_door_and_is_type_checked() -> None:
    """``mypy``, which the house runs, checks the script."""
    tree = ast.parse(SCRIPT.read_text(encoding="utf-8"))
    used = {
        node.attr
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute)
        and isinstance(node.value, ast.Name)
        and node.value.id == "rp"
    }
    assert set(dir(rp)) == used
    settings = (HERE.parent / "pyproject.toml").read_text(encoding="utf-8")
    assert f'files = ["repctl_pin", "tests/{SCRIPT.name}"]' in settings


@pytest.mark.parametrize("name", ["inline", "rose"])
def test_names_of_the_paper_are_not_at_the_door(name: str) -> None:
    assert not hasattr(rp, name)


def test_options_of_a_fit_are_one_object() -> None:
    task = rp.Robot.load("planar3r").task("tool", "xy")
    control, q0 = rp.Pseudoinverse(task), [0.3, 0.8, 0.8]
    box, cell = rp.Box(q0, 0.3), rp.Cell(task, task.placement(q0), 0.1)
    options = rp.FitOptions(samples=128, held_out=64, seed=3)
    design = rp.nearest_repeatable(control, None, box, degree=1, options=options)
    assert design.samples < 1000 and (design.held_out, design.seed) == (64, 3)
    for wrong, says in (
        ({"seed": -1}, "seed must be"),
        ({"samples": 0}, "samples must be"),
        ({"tolerance": 0}, "the tolerance must be"),
    ):
        with pytest.raises(rp.InputError, match=says):
            rp.FitOptions(**wrong)  # type: ignore[arg-type]
    with pytest.raises(rp.InputError, match=r"options must be rp\.FitOptions"):
        rp.nearest_repeatable(control, None, box, degree=1, options={"seed": 1})  # type: ignore[arg-type]
    with pytest.raises(rp.InputError, match="nearest_inverse_function has no option restarts"):
        rp.nearest_inverse_function(control, cell, options=rp.FitOptions(restarts=7))


def test_a_file_of_the_other_kind_is_refused(tmp_path: Path) -> None:
    task = rp.Robot.load("planar3r").task("tool", "xy")
    control, q0 = rp.Pseudoinverse(task), [0.3, 0.8, 0.8]
    few = rp.FitOptions(samples=64, held_out=64)
    design = rp.nearest_repeatable(control, None, rp.Box(q0, 0.3), degree=1, options=few)
    cell = rp.Cell(task, task.placement(q0), 0.1)
    found = rp.nearest_inverse_function(control, cell, degree=1, options=few)
    a, b = rp.save(design, tmp_path / "a.json"), rp.save(found, tmp_path / "b.json")
    assert rp.load_design(a).cost == design.cost and rp.load_cell(b).cost == found.cost
    with pytest.raises(rp.InputError, match=r"holds a repeatable inverse; use rp\.load_design"):
        rp.load_cell(a)
    with pytest.raises(
        rp.InputError, match=r"holds the function of a cell, not a design; use rp\.load_cell"
    ):
        rp.load_design(b)
