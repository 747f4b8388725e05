"""``repctl ros2`` where ROS 2 is missing, or with what is not a design: one line."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from commands import main, parsers

import repctl_pin as rp


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    task = rp.Robot.load("planar3r").task("tool", "xy")
    q0, few = np.array([0.3, 0.8, 0.8]), rp.FitOptions(samples=64, held_out=64)
    design = rp.nearest_repeatable(
        rp.Pseudoinverse(task), None, rp.Box(q0, 0.2), degree=1, options=few
    )
    return rp.save(design, tmp_path / "design.json")


def test_a_missing_rclpy_is_one_line(
    saved: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "rclpy", None)
    monkeypatch.delitem(sys.modules, "repctl_pin.extensions.integrations.ros2", raising=False)
    assert main(["ros2", str(saved)]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and said.startswith("repctl: the node requires ROS 2 (")
    assert "setup.bash" in said and "extra ros2" in said


def test_a_robot_is_no_design(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["ros2", "panda"]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "'panda' is not a saved design" in said


def test_the_arguments_of_ros_are_passed_on() -> None:
    words = ["-p", "acceleration:=5.0", "-r", "target_pose:=/pose", "--log-level", "warn"]
    options = parsers()[""].parse_all(["ros2", "design.json", "--ros-args", *words])
    assert options.what == "design.json" and options.ros_args == words
