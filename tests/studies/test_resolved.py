"""Whether the drift of J⁺ is a number: near a singularity it depends on the number of steps."""

from __future__ import annotations

import json

import numpy as np
import pytest

import repctl_pin as rp
from repctl_pin.motion import unresolved
from repctl_pin.show.plots.motions import drawn
from repctl_pin.show.text.answer import study_answer
from repctl_pin.show.text.captions import summary
from repctl_pin.show.text.table import study_table

NO_NUMBER = "passes close to a singularity; its drift is not a number"
START = [0.3823, -0.1961, -0.7030, 1.4595, 2.9146, -0.0022, 2.0581]


@pytest.fixture(scope="module")
def problem() -> rp.Problem:
    return rp.Problem("baxter", start=START, path="circle:0.2:0", plane="xy")


def test_a_drift_that_depends_on_the_steps_is_not_a_number(problem: rp.Problem) -> None:
    """More steps do not help: with 4 or 16 times as many, J⁺ stops or ends elsewhere."""
    plain = rp.Pseudoinverse(problem.task)
    motion = rp.follow(plain, problem.cycle, START)
    assert unresolved(plain, motion).startswith(NO_NUMBER)
    for steps in (2000, 8000):
        try:
            finer = rp.follow(plain, problem.cycle, START, steps=steps)
        except rp.SingularityError:
            continue
        assert np.linalg.norm(motion.q[-1] - finer.q[-1]) > 0.1


@pytest.mark.parametrize("name", ["ppr", "planar3r", "panda", "so100"])
def test_a_regular_drift_is_a_number(name: str) -> None:
    """For so100 the drift on the default circle is 6e-7 rad, not far above the errors."""
    problem = rp.Problem(name)
    plain = rp.Pseudoinverse(problem.task)
    motion = rp.follow(plain, problem.cycle, problem.start)
    assert unresolved(plain, motion) == ""


def test_too_few_steps_are_found_out() -> None:
    problem = rp.Problem("panda", path="circle:0.1")
    plain = rp.Pseudoinverse(problem.task)
    motion = rp.follow(plain, problem.cycle, problem.start, cycles=1, steps=4)
    assert "with 4 and 8 steps per cycle" in unresolved(plain, motion)


def test_no_part_of_a_study_shows_it(problem: rp.Problem) -> None:
    study = rp.study(problem, degree=1, cycles=6)
    row = study.row("pseudoinverse")
    assert row.motion is None and row.summary() == row.stopped
    assert f"The usual control {NO_NUMBER}." in " ".join(
        "".join(span.text for span in study_answer(study)).split()
    )
    assert f"J⁺ {NO_NUMBER}" in " ".join(study_table(study).split())
    found = json.loads(json.dumps(study.as_dict()))["strategies"]["pseudoinverse"]
    assert set(found) == {"label", "stopped"} and NO_NUMBER in found["stopped"]
    assert f"The pseudoinverse J⁺ {NO_NUMBER}" in " ".join(summary(study))
    assert next(label for label, _, _ in drawn(study)) == "J⁺ + posture"
    assert not [note for note in study.notes if "on an edge" in note]
