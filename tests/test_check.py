"""``repctl check``: the verdict, the drift it predicts, and what it refuses."""

from __future__ import annotations

import json

import numpy as np
import pytest

import repctl_pin as rp
from repctl_pin.cli import main

START = "0,-0.78539816,0,-2.35619449,0,1.57079633,0.78539816"


def test_check_says_what_the_functions_say(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "panda", "--start", START]) == 0
    text = capsys.readouterr().out
    for word in ("panda_hand_tcp, pose", "J⁺", "not repeatable", "x–y", "6.986", "0.000699", "0.0699"):
        assert word in text
    assert "stable surface" not in text  # seven joints


def test_check_as_json(capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["check", "panda", "--start", START, "--samples", "16", "--json"]
    assert main([*arguments, "--weight", "inertia"]) == 0
    data = json.loads(capsys.readouterr().out)
    task = rp.Robot.load("panda").task(None, "pose")
    drift = rp.drift_per_area(rp.WeightedInverse(task, "inertia"), np.array([float(v) for v in START.split(",")]))
    assert data["repeatable"] is False and data["defect"] > 100 * data["tolerance"]
    assert np.isclose(data["drift_per_m2"]["yz"], drift[1, 2], rtol=1e-6)
    assert main([*arguments, "--weight", "1,1,1,1,1,1,1"]) == 0
    assert np.isclose(json.loads(capsys.readouterr().out)["drift_per_m2"]["xy"], 6.986, atol=5e-4)


def test_check_finds_the_stable_surface_in_absolute_angles_only(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "planar3r", "--samples", "16"]) == 0
    assert "no stable surface" in capsys.readouterr().out
    assert main(["check", "planar3r", "--samples", "16", "--absolute"]) == 0
    text = capsys.readouterr().out
    assert "stable surfaces:" in text and "in absolute angles" in text


def test_check_refuses_in_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    for arguments, word in (
        (["panda", "--weight", "heavy"], "neither inertia nor numbers"),
        (["panda", "--weight", "1,2"], "2 numbers, but the task has 7"),
        (["panda", "--weight=-1,1,1,1,1,1,1"], "positive definite"),
        (["panda", "--absolute"], "parallel axes"),
        (["ur5", "--task", "pose"], "r = 0"),
    ):
        assert main(["check", *arguments]) == 2
        error = capsys.readouterr().err.strip().splitlines()
        assert len(error) == 1 and word in error[0]


def test_a_saved_design_is_checked_over_its_own_region(tmp_path, capsys: pytest.CaptureFixture[str]) -> None:
    out, saved = str(tmp_path), str(tmp_path / "design.json")
    options = ["--degree", "2", "--region", "0.3", "--start", "1,-1.5,1.2", "--samples", "512"]
    assert main(["design", "planar3r", *options, "--out", out, "--quiet"]) == 0
    assert main(["check", saved, "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["repeatable"] is True and result["defect"] < 1e-8 and result["region"].startswith("box ±0.3")
    for extra in (["--weight", "inertia"], ["--frame", "tool"], ["--absolute"]):
        assert main(["check", saved, *extra]) == 2
        assert "leave --" in capsys.readouterr().err
