"""``repctl check``: the verdict, the drift it predicts, and what it refuses."""

from __future__ import annotations

import json

import numpy as np
import pytest
from arms import planar_urdf
from commands import main

import repctl_pin as rp

START = "0,-0.78539816,0,-2.35619449,0,1.57079633,0.78539816"


def test_check_says_what_the_functions_say(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "panda", "--start", START]) == 0
    text = capsys.readouterr().out
    for word in (
        "panda_hand_tcp, pose",
        "J⁺",
        "not repeatable",
        "x–y",
        "6.99",
        "0.000699",
        "0.0699",
    ):
        assert word in text
    assert "stable surface" not in text  # seven joints


def test_check_as_json(capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["check", "panda", "--start", START, "--samples", "16", "--json"]
    assert main([*arguments, "--weight", "inertia"]) == 0
    data = json.loads(capsys.readouterr().out)
    task = rp.Robot.load("panda").task(None, "pose")
    drift = rp.drift_per_area(
        rp.WeightedInverse(task, "inertia"), np.array([float(v) for v in START.split(",")])
    )
    assert data["repeatable"] is False and data["defect"] > 100 * data["tolerance"]
    assert np.isclose(data["drift_per_m2"]["yz"], drift[1, 2], rtol=1e-6)
    assert main([*arguments, "--weight", "1,1,1,1,1,1,1"]) == 0
    assert np.isclose(json.loads(capsys.readouterr().out)["drift_per_m2"]["xy"], 6.986, atol=5e-4)


@pytest.mark.slow
def test_check_finds_the_stable_surface_in_absolute_angles_only(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["check", "planar3r", "--samples", "16"]) == 0
    assert "no stable surface" in capsys.readouterr().out
    assert main(["check", "planar3r", "--samples", "16", "--weight", "absolute"]) == 0
    text = capsys.readouterr().out
    assert "stable surfaces:" in text and "weighted by absolute angles" in text


SLIDE = (
    planar_urdf([1, 0.8, 0.6])
    .replace('<joint name="theta2" type="revolute">', '<joint name="theta2" type="prismatic">')
    .replace(
        '<limit lower="-7.0" upper="7.0" effort="1" velocity="1"/></joint><joint name="theta3"',
        '<limit lower="0" upper="0.04" effort="1" velocity="1"/></joint><joint name="theta3"',
    )
)


def test_check_stays_inside_the_joint_limits_and_says_so(
    tmp_path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A slide of 0.04 m, and joints that start near a limit: every configuration looked at can be
    reached."""
    near = "0,-0.785,0,-2.356,0,3.7,0.785"
    (tmp_path / "slide.urdf").write_text(SLIDE, encoding="utf-8")
    for arm, more, joint in (
        ("panda", ["--start", near], "panda_joint6"),
        ("panda", ["--start", near, "--region", "0.1"], "panda_joint6"),
        (str(tmp_path / "slide.urdf"), ["--start", "0.3,0.01,0.8"], "theta2"),
    ):
        assert main(["check", arm, *more, "--samples", "16"]) == 0
        told = " ".join(capsys.readouterr().out.split())
        assert f"note: Ω was cut at the joint limits of {joint}" in told
        assert main(["check", arm, *more, "--samples", "16", "--json"]) == 0
        data = json.loads(capsys.readouterr().out)
        task = rp.Robot.load(arm).task(data["frame"], data["task"])
        middle, half = (np.array(data["region"][key]) for key in ("center", "half_width"))
        assert (middle - half >= task.lower - 1e-12).all() and (
            middle + half <= task.upper + 1e-12
        ).all()
        asked = 0.1 if "--region" in more else 0.4
        wide = np.array([name != joint for name in task.joint_names])
        np.testing.assert_allclose(half[wide], asked)
        i = task.joint_names.index(joint)
        low, high = (
            max(task.lower[i], data["start"][i] - asked),
            min(task.upper[i], data["start"][i] + asked),
        )
        np.testing.assert_allclose([middle[i] - half[i], middle[i] + half[i]], [low, high])
        assert data["notes"] == [f"Ω was cut at the joint limits of {joint}"]
    assert main(["check", "panda", "--samples", "16", "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["notes"] == [] and data["region"]["center"] == data["start"]
    assert data["region"]["half_width"] == pytest.approx([0.4] * 7)


def test_check_refuses_in_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    for arguments, word in (
        (["panda", "--weight", "heavy"], "neither inertia, limits, absolute, nor numbers"),
        (["panda", "--weight", "1,2"], "give 7 numbers or a symmetric 7 × 7 matrix"),
        (["panda", "--weight=-1,1,1,1,1,1,1"], "positive definite"),
        (["panda", "--weight", "absolute"], "parallel axes"),
        (["ur5", "--task", "pose"], "r = 0"),
    ):
        assert main(["check", *arguments]) == 2
        error = capsys.readouterr().err.strip().splitlines()
        assert len(error) == 1 and word in error[0]


@pytest.mark.slow
def test_a_saved_design_is_checked_over_its_own_region(
    tmp_path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, saved = str(tmp_path), str(tmp_path / "design.json")
    options = ["--degree", "2", "--region", "0.3", "--start", "1,-1.5,1.2", "--samples", "512"]
    assert main(["design", "planar3r", *options, "--out", out, "--quiet"]) == 0
    assert main(["check", saved, "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert (
        result["repeatable"] is True
        and result["defect"] < 1e-8
        and result["region"]["is"].startswith("box ±0.3")
    )
    for extra in (
        ["--weight", "inertia"],
        ["--frame", "link2"],
        ["--task", "xz"],
        ["--base", "link1"],
    ):
        assert main(["check", saved, *extra]) == 2
        assert "; omit --" in capsys.readouterr().err
