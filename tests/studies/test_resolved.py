"""Whether the drift of J⁺ is a number: near a singularity it depends on the number of steps."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import main
from controls import some

import repctl_pin as rp

NO_NUMBER = "passes close to a singularity; its drift cannot be computed reliably"
START = [0.3823, -0.1961, -0.7030, 1.4595, 2.9146, -0.0022, 2.0581]
LOOP = ["--path", "circle:0.2:0", "--plane", "xy", f"--start={str(START)[1:-1]}"]


def followed(capsys: pytest.CaptureFixture[str], *words: str) -> dict[str, Any]:
    """Follow with J⁺ for ten cycles, on the command line."""
    command = ["follow", *words, "--strategy", "pseudoinverse", "--cycles", "10"]
    assert main([*command, "--json"]) == 0
    found: dict[str, Any] = json.loads(capsys.readouterr().out)
    return found


@pytest.mark.slow
def test_a_drift_that_depends_on_the_steps_is_not_a_number(capsys) -> None:
    """More steps do not help: with 4 times as many, J⁺ stops or ends elsewhere."""
    found = followed(capsys, "baxter", *LOOP)
    assert found["drift"] is None and NO_NUMBER in found["notes"][-1]
    problem = rp.Problem("baxter", start=START, path="circle:0.2:0", plane="xy")
    plain, ends = rp.Pseudoinverse(problem.task), []
    for steps in (500, 2000):
        try:
            motion = rp.follow(plain, problem.cycle, START, steps=steps)
            ends.append(motion.q[-1])
        except rp.SingularityError:
            ends.append(np.full(7, np.inf))
    assert np.linalg.norm(ends[0] - ends[1]) > 0.1


@pytest.mark.parametrize("name", some(["ppr", "planar3r", "panda", "so100"], "ppr"))
def test_a_regular_drift_is_a_number(name: str, capsys) -> None:
    """For so100 the drift on the default circle is 6e-7 rad, not far above the errors."""
    found = followed(capsys, name)
    assert len(found["drift"]) == 10
    assert not [note for note in found["notes"] if NO_NUMBER in note]


def test_too_few_steps_are_found_out(capsys) -> None:
    found = followed(capsys, "panda", "--path", "circle:0.1", "--steps", "4")
    assert found["drift"] is None and "with 4 and 8 steps" in found["notes"][-1]


@pytest.mark.slow
def test_no_part_of_a_study_shows_it(tmp_path: Path, capsys) -> None:
    folder = tmp_path / "out"
    command = ["study", "baxter", *LOOP, "--degree", "1", "--cycles", "6"]
    assert main([*command, "--out", str(folder)]) == 0
    out = capsys.readouterr().out
    first = "Under the repeatable control, left_w0 leaves its range in cycle 1. "
    assert " ".join(out.split()).startswith(f"{first}The usual control {NO_NUMBER}. ")
    (row,) = [line for line in out.splitlines() if line.startswith("joints off their start")]
    assert row.split()[-3] == "–" and row.split()[-1] == "0"
    page = (folder / "animation.html").read_text("utf-8")
    assert f"The usual control {NO_NUMBER}." in page and '"label":"J⁺"' not in page
    written = (folder / "motion.csv").read_text("utf-8")
    assert "repeatable" in written and "pseudoinverse" not in written
    assert "on an edge" not in out
