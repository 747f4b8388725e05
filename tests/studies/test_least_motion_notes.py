"""A study's notes on the least closed motion: how close, and what another start saves."""

from __future__ import annotations

import re

import numpy as np
import pytest

import repctl_pin as rp
from repctl_pin.problem import at_minimum_speed
from repctl_pin.studies.least_motion_notes import least_motion_notes


@pytest.fixture(scope="module")
def problem() -> rp.Problem:
    return rp.Problem("planar3r")


def designed(problem: rp.Problem) -> rp.Design:
    few = rp.FitOptions(samples=512, held_out=128)
    return rp.nearest_repeatable(
        rp.Pseudoinverse(problem.task), None, problem.region, degree=2, options=few
    )


def test_the_share_above_the_least_and_another_start(problem) -> None:
    task, path, q0 = problem.task, problem.cycle, problem.start
    design = designed(problem)
    above, elsewhere = least_motion_notes(design, path, q0)
    own = rp.follow(
        design.inverse, path, q0, cycles=1, steps=200, integrator=rp.LeafLock(4)
    )
    least = rp.least_closed_motion(task, path, q0, steps=200)
    said = re.fullmatch(
        r"joint speed: (\S+) % above the minimum of .* from this start", above
    )
    assert said is not None
    assert float(said[1]) == pytest.approx(
        100 * (own.rms_speed / least.rms_speed - 1), rel=0.05, abs=1e-3
    )
    assert elsewhere == "another elbow position needs 31 % less: --best-leaf speed"


def test_the_start_of_least_speed_saves_what_was_said(problem) -> None:
    moved = at_minimum_speed(problem)
    assert moved.path is problem.path and "start" in moved.given
    assert (
        "the start was moved along the self-motion, to 31 % less joint speed"
        in moved.notes
    )
    assert (moved.region.ratio(moved.start[None]) <= 1).all()
    assert not np.allclose(moved.start, problem.start)
    lines = least_motion_notes(designed(moved), moved.cycle, moved.start)
    assert len(lines) == 1 and "above the minimum" in lines[0]
    fast, slow = (
        rp.follow(
            designed(it).inverse, it.cycle, it.start, cycles=1, steps=64
        ).rms_speed
        for it in (moved, problem)
    )
    assert fast < 0.71 * slow


def test_no_notes_where_the_motion_violates_a_limit() -> None:
    task = rp.Robot.load("tiago").task("wrist_ft_tool_link", "pose")
    q0 = task.reference
    few = rp.FitOptions(samples=256, held_out=64)
    path = rp.circle(task, q0, 0.05, normal="xy", start_angle=np.pi)
    design = rp.nearest_repeatable(
        rp.Pseudoinverse(task), None, rp.Box(q0, 0.08), degree=1, options=few
    )
    assert (
        rp.follow(design.inverse, path, q0, cycles=1, steps=50).first_violation
        is not None
    )
    assert least_motion_notes(design, path, q0) == []
