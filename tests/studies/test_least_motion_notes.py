"""A study's notes on the least closed motion: how close, and what another start saves."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from commands import told, without_pictures

import repctl_pin as rp

ABOVE = r"joint speed: (\S+) % above a local minimum of .* from this start"


@pytest.fixture(scope="module")
def study() -> rp.Study:
    few = rp.FitOptions(samples=512, held_out=128)
    return rp.study("planar3r", cycles=1, steps=64, degree=2, options=few)


@pytest.mark.slow
def test_the_share_above_the_least_and_another_start(study: rp.Study) -> None:
    above, elsewhere = study.notes[-2:]
    task, path, q0 = study.task, study.path, study.q0
    own = rp.follow(study.design.inverse, path, q0, cycles=1, steps=200, integrator=rp.LeafLock(4))
    least = rp.least_closed_motion(task, path, q0, steps=200)
    said = re.fullmatch(ABOVE, above)
    assert said is not None
    assert float(said[1]) == pytest.approx(
        100 * (own.rms_speed / least.rms_speed - 1), rel=0.05, abs=1e-3
    )
    assert elsewhere == "another elbow position needs 31 % less joint speed; use --best-leaf speed"


@pytest.mark.slow
def test_the_start_of_least_speed_saves_what_was_said(
    study: rp.Study,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    without_pictures(monkeypatch)
    few = ("--cycles", "1", "--steps", "64", "--degree", "2")
    moved = told(capsys, "study", "planar3r", "--best-leaf", "speed", *few)
    saved = "the start was moved along the self-motion, to 31 % less joint speed"
    assert saved in moved["notes"] and re.fullmatch(ABOVE, moved["notes"][-1])
    start = np.array(moved["start"])
    assert not np.allclose(start, study.q0)
    places = study.task.positions(np.array([start, study.q0]))
    np.testing.assert_allclose(*places, atol=1e-8)
    assert moved["path"] == study.path.name
    design = rp.load("repctl-out/planar3r/control.json")
    points = design.cycle.path.points()
    np.testing.assert_allclose(points, study.path.points(), atol=1e-8)
    assert (design.region.ratio(start[None]) <= 1).all()
    fast = moved["strategies"]["repeatable"]["rms_speed"]
    assert fast < 0.71 * study.row("repeatable").motion.rms_speed
