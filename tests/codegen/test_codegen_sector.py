"""Functions over sectors in C, and the control whose leaf they are."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from controls import NEEDS_C, own_cache, some  # noqa: F401
from sectors import WIDTHS, found
from test_codegen import AGREE, disagreement
from test_codegen_builds import CPP17, STRICT, needed, run

import repctl_pin as rp


@pytest.mark.slow
@pytest.mark.parametrize("name", some(WIDTHS, "pose"))
def test_sectors_in_c(name: str, tmp_path: Path) -> None:
    """Issue 37, item 9: the circle of the example loop kept the orientation, which turns with the
    sector's angle, and ended with status 3. It moves, and returns to where it began."""
    needed("gcc", "g++")
    function = found(name).function
    for k, control in enumerate((function, function.inverse)):
        folder = tmp_path / str(k)
        rp.export_c(control, folder, "arm")
        code = (folder / "loop.c").read_text()
        radii = re.search(r"radii\[2\] = \{(.*), (.*)\}, dt", code)
        assert radii is not None and float(radii[1]) > 1e-3
        run(["gcc", "-std=c99", *STRICT, "-c", "arm.c"], folder)
        run(["gcc", "-std=c99", *STRICT, "arm.o", "loop.c", "-o", "loop", "-lm"], folder)
        drift = re.search(r"drift .*: (\S+) rad", run(["./loop"], folder))
        assert drift is not None and float(drift[1]) < 1e-4
    folder = tmp_path / "0"
    vectors = (folder / "test_vectors.h").read_text()
    vectors = vectors.partition("_function_vectors[")[2]
    assert vectors.count("ARM_OK") >= 8
    assert vectors.count("ARM_OUTSIDE") >= (name != "xy")
    run(["gcc", "-std=c99", *STRICT, "arm.o", "check.c", "-o", "check", "-lm"], folder)
    assert run(["./check"], folder).startswith("48 vectors, 0 differences")


@NEEDS_C
@pytest.mark.parametrize("name", some(["pose", "axis"], "pose"))
def test_its_control_steps_as_pythons(name: str) -> None:
    design = found(name)
    function = design.function
    worst, _ = disagreement(function.inverse, function(function.cell.placement), 16, spread=0.1)
    assert worst < AGREE


def test_a_sector_in_c_is_also_cpp(tmp_path: Path) -> None:
    """A truth value narrowed to a double is an error in clang++, and a warning in g++."""
    needed("g++")
    rp.export_c(found("pose").function, tmp_path, "arm")
    run(["g++", *CPP17, *STRICT, "-fsyntax-only", "arm.c"], tmp_path)
