"""A cell's inverse kinematic function in C: F of a pose, and the control whose leaf it is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from arms import Q_PANDA
from controls import NEEDS_C, own_cache  # noqa: F401
from test_codegen import AGREE, disagreement
from test_codegen_builds import BUILDS, STRICT, needed, run
from test_section import cell_of, chart_of

import repctl_pin as rp

CELLS = {
    "poses": ("pose", 0.3),
    "poses of one orientation": ("pose", 0.0),
    "tool axes": ("axis", 0.3),
    "positions": ("position", 0.0),
}


def function_of(name: str) -> rp.InverseFunction:
    """A section near straight fibres; what it is worth does not matter here."""
    kind, rotation = CELLS[name]
    cell = cell_of(kind, rotation)
    return rp.InverseFunction(chart_of(cell, rp.solve_ik(cell.task, Q_PANDA, cell.placement)))


@pytest.mark.parametrize("name", CELLS)
def test_f_in_c_is_f(name: str, tmp_path: Path) -> None:
    """Built strictly, check.c compares F in and beyond the cell, and all that any control has."""
    needed("gcc")
    function = function_of(name)
    rp.export_c(function, tmp_path, "arm")
    vectors = (tmp_path / "test_vectors.h").read_text().partition("arm_function_vectors[")[2]
    assert vectors.count("ARM_OK") >= 12 and vectors.count("ARM_OUTSIDE") >= 2
    for compiler in BUILDS if name == "poses" else ["gcc"]:
        needed(compiler)
        run([compiler, *BUILDS[compiler], *STRICT, "arm.c", "check.c", "-o", "check", "-lm"], tmp_path)
        assert run(["./check"], tmp_path).startswith("48 vectors, 0 differences")
    wrong = (tmp_path / "arm.c").read_text().replace("turn < 12", "turn < 1")
    (tmp_path / "arm.c").write_text(wrong)
    run(["gcc", "-w", "arm.c", "check.c", "-o", "check", "-lm"], tmp_path)
    with pytest.raises(AssertionError, match="F returns"):
        run(["./check"], tmp_path)
    run(
        ["g++", "-std=c++17", *STRICT, "-fsyntax-only", "-x", "c++", "arm.hpp", "-Wno-pragma-once-outside-header"],
        tmp_path,
    )


@NEEDS_C
@pytest.mark.parametrize("name", CELLS)
def test_its_control_steps_as_pythons(name: str) -> None:
    function = function_of(name)
    worst, _ = disagreement(function.inverse, function(function.cell.placement), 24, spread=0.1)
    assert worst < AGREE


def test_limits_that_are_not_kept_are_not_written(tmp_path: Path) -> None:
    function = function_of("poses of one orientation")
    for keep in (True, False):
        rp.export_c(rp.InverseFunction(function.chart, keep_limits=keep), tmp_path / str(keep))
        code = (tmp_path / str(keep) / "arm_control.c").read_text()
        assert ("upper[ARM_CONTROL_N] = {HUGE_VAL" in code) != keep
    assert "cell    " in code and np.isfinite(function.task.upper).all()
