"""``repctl move``, and the program of the how-to page that sends its file to a controller."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from commands import main
from sectors import found

import repctl_pin as rp

ROOT = Path(__file__).parents[2]
PLACES = np.array([[0.4, -0.2, 0.35], [0.45, 0.0, 0.4], [0.47, 0.25, 0.3]])


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A saved cell and a file of poses."""
    monkeypatch.chdir(tmp_path)
    rp.save(found("position"), "cell.json")
    np.savetxt("poses.csv", PLACES, delimiter=",", header="x,y,z", comments="")


def move(*words: str) -> int:
    start = ["move", "cell.json", "--through", "poses.csv", "--acceleration", "panda"]
    return main([*start, "--rate", "100", *words])


def test_the_files_are_those_of_the_motion(capsys: pytest.CaptureFixture[str]) -> None:
    assert move("--jerk", "panda", "--csv", "day.csv", "--yaml", "day.yaml") == 0
    said = capsys.readouterr().out
    assert re.match(
        r"3 poses in [\d.]+ s from rest to rest; limits respected, no collision\.\n", said
    )
    assert "at rest at 3" in said and "wrote day.yaml" in said
    F = found("position").function
    R = F.cell.placement.rotation
    poses = [_pose(R, p) for p in PLACES]
    limits = rp.Limits(acceleration="panda", jerk="panda")
    moved = rp.motion_between(F, poses, limits, rate=100.0)
    table = np.genfromtxt("day.csv", delimiter=",", skip_header=1)
    assert np.array_equal(table[:, 1:8], moved.q)


def _pose(R: np.ndarray, p: np.ndarray) -> np.ndarray:
    X = np.eye(4)
    X[:3, :3], X[:3, 3] = R, p
    return X


def test_json_and_quiet(capsys: pytest.CaptureFixture[str]) -> None:
    assert move("--blend", "0.02", "--json") == 0
    result = json.loads(capsys.readouterr().out)
    assert result["rests"] == [0, 2] and len(result["times"]) == 3
    assert result["lines"] == ["tool", "tool"] and result["files"] == []
    assert result["times"][-1] == result["duration"] and result["body_distance"] > 0
    assert move("--quiet") == 0 and not capsys.readouterr().out


def test_what_cannot_be_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    far = [*PLACES[:2], PLACES[2] + [0.3, 0.0, 0.0]]
    np.savetxt("far.csv", far, delimiter=",")
    np.savetxt("timed.csv", np.hstack([[[1], [2], [3]], PLACES]), delimiter=",",
               header="time,x,y,z", comments="")  # fmt: skip
    start = ["move", "cell.json", "--through"]
    for words, reason in (
        ([*start, "poses.csv"], "acceleration= is missing"),
        ([*start, "far.csv", "--acceleration", "5"], "line 3: the target lies outside"),
        ([*start, "timed.csv", "--acceleration", "5"], "remove the column of times"),
        (["move", "panda", "--through", "poses.csv"], "is not a saved design"),
        ([*start, "poses.csv", "--acceleration", "5", "--csv", "a", "--yaml", "a"], "same file"),
    ):
        assert main(words) == 2
        said = capsys.readouterr().err
        assert reason in said and said.count("\n") == 1


def test_a_rate_that_loses_the_motion_between_two_rests_is_refused(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Item 26.18: ten samples between two rests, in a file; the rate that it names is taken."""
    assert move("--rate", "2", "--csv", "day.csv") == 2
    said = capsys.readouterr().err
    found = re.search(
        r"samples per motion between two rests .* at least (\d+) samples per second", said
    )
    assert found is not None and not Path("day.csv").exists() and said.count("\n") == 1
    assert move("--rate", found[1], "--csv", "day.csv") == 0
    assert move("--jerk", "1e-12") == 2
    assert "more than an hour; raise the jerk limits" in capsys.readouterr().err


def test_a_collision_is_said_and_not_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    box = '<box size="0.1 0.1 0.1"/>'
    (tmp_path / "post.urdf").write_text(
        '<robot name="w"><link name="post"><collision><origin xyz="0.47 0.1 0.35"/>'
        f"<geometry>{box}</geometry></collision></link></robot>"
    )
    assert move("--surroundings", "post.urdf", "--csv", "day.csv") == 2
    assert "collide" in capsys.readouterr().err and not Path("day.csv").exists()
    anyway = ("--surroundings", "post.urdf", "--csv", "day.csv", "--allow-violations")
    assert move(*anyway) == 0
    assert "bodies collide." in capsys.readouterr().out and Path("day.csv").exists()


class _Future:
    def __init__(self, value: Any) -> None:
        self.result = lambda: value


def test_the_page_s_program_sends_the_file(monkeypatch: pytest.MonkeyPatch) -> None:
    """On stand-ins for ROS: what a controller that accepts and succeeds receives."""
    assert move("--yaml", "day.yaml", "--quiet") == 0
    page = (ROOT / "docs" / "how-to" / "pick-and-place.md").read_text(encoding="utf-8")
    program = re.search(r"```text\n(import rclpy.*?)```", page, re.DOTALL)
    assert program is not None
    sent: list[Any] = []

    class Action:
        Goal = lambda: SimpleNamespace(trajectory={})  # noqa: E731
        Result = SimpleNamespace(SUCCESSFUL=0)

    class Client:
        def __init__(self, node: str, kind: type, name: str) -> None:
            assert kind is Action and name.endswith("/follow_joint_trajectory")

        def wait_for_server(self) -> None:
            sent.append("found")

        def send_goal_async(self, goal: Any) -> _Future:
            sent.append(goal.trajectory)
            outcome = SimpleNamespace(result=SimpleNamespace(error_code=code))
            outcome.result.error_string = "path tolerance violated"
            handle = SimpleNamespace(accepted=True, get_result_async=lambda: _Future(outcome))
            return _Future(handle)

    modules = {
        "rclpy": {"init": list, "create_node": str,
                  "spin_until_future_complete": lambda node, future: None},
        "control_msgs": {}, "control_msgs.action": {"FollowJointTrajectory": Action},
        "rclpy.action": {"ActionClient": Client}, "rosidl_runtime_py": {},
        "rosidl_runtime_py.set_message": {"set_message_fields": dict.update},
    }  # fmt: skip
    for name, contents in modules.items():
        module = ModuleType(name)
        vars(module).update(contents)
        monkeypatch.setitem(sys.modules, name, module)
    code = 0
    exec(program[1], {})
    assert sent[0] == "found"
    assert sent[1]["joint_names"] == list(found("position").task.joint_names)
    points = sent[1]["points"]
    q = np.array([point["positions"] for point in points])
    F = found("position").function
    assert np.abs(q[-1] - F(_pose(F.cell.placement.rotation, PLACES[-1]))).max() < 1e-11
    assert not np.any(points[-1]["velocities"])
    code = 5
    with pytest.raises(SystemExit, match="path tolerance violated"):
        exec(program[1], {})
