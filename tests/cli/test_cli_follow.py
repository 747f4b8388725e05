"""``repctl follow``: files ready for a robot, and one clear line where something cannot be used."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from commands import main
from test_cli import refused, repctl

import repctl_pin as rp

yaml = pytest.importorskip("yaml")


@pytest.fixture
def saved(tmp_path: Path, panda_design: rp.Design, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return rp.save(panda_design, tmp_path / "design.json")


def table(file: Path) -> tuple[list[str], np.ndarray]:
    """What stands beside the first column, the cycle in fractions, which grows from 0."""
    with file.open(newline="") as lines:
        header, *rows = csv.reader(lines)
    numbers = np.array(rows, float)
    assert header[0] == "cycle" and numbers[0, 0] == 0 and (np.diff(numbers[:, 0]) > 0).all()
    return header[1:], numbers[:, 1:]


def test_a_path_around_the_base_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    turn = np.pi / 18 * np.append(np.arange(36), 0)
    ring = np.c_[2.6 * np.cos(turn), 2.6 * np.sin(turn), 0 * turn]
    np.savetxt(tmp_path / "ring.csv", ring, delimiter=",")
    command = ["follow", "planar3r", "--strategy", "pseudoinverse", "--json"]
    assert main([*command, "--path", str(tmp_path / "ring.csv")]) == 0
    notes = json.loads(capsys.readouterr().out)["notes"]
    assert notes[0] == (
        "the path winds once around the axis of theta1, so it need not close under any control"
    )


def test_the_csv_is_the_motion(saved, panda_design, q_panda, capsys) -> None:
    command = [
        "follow",
        "design.json",
        "--path",
        "circle:0.1:0",
        "--plane",
        "yz",
        "--steps",
        "400",
        "--csv",
        "motion.csv",
    ]
    assert main(command) == 0
    printed = capsys.readouterr().out
    for words in (
        "circle of radius 0.1 m in yz",
        "joint drift",
        "limit margin",
        "wrote motion.csv",
    ):
        assert words in printed
    header, rows = table(Path("motion.csv"))
    names = list(panda_design.task.joint_names)
    assert header == ["time", *names, *(f"{name}_velocity" for name in names)]
    t, Q, Qdot = rows[:, 0], rows[:, 1:8], rows[:, 8:]
    assert rows.shape == (401, 15) and t[0] == 0 and np.isclose(t[-1], 5.0)
    path = rp.circle(panda_design.task, q_panda, 0.1, normal="yz")
    assert np.linalg.norm(Q[-1] - Q[0]) < 1e-9 and np.allclose(Q[0], q_panda)
    for s, q, qdot in zip(np.linspace(0, 1, 401)[::40], Q[::40], Qdot[::40], strict=True):
        assert np.linalg.norm(panda_design.task.error(q, path.placement(s))) < 1e-9
        assert np.allclose(
            panda_design.task.jacobian(q) @ qdot, path.twist(min(s, 1 - 1e-12)) / 5.0, atol=1e-9
        )
    # The velocities are the positions' own: central differences agree to their order.
    middle = (Q[2:] - Q[:-2]) / (t[2:] - t[:-2])[:, None]
    assert np.abs(middle - Qdot[1:-1]).max() < 1e-4


def test_the_yaml_is_a_joint_trajectory(saved, panda_design) -> None:
    assert (
        main(["follow", "design.json", "--steps", "100", "--csv", "m.csv", "--yaml", "t.yaml"]) == 0
    )
    _, rows = table(Path("m.csv"))
    data = yaml.safe_load(Path("t.yaml").read_text())
    assert set(data) == {"header", "joint_names", "points"}
    assert data["header"] == {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}
    assert data["joint_names"] == list(panda_design.task.joint_names)
    assert len(data["points"]) == len(rows)
    for point, row in zip(data["points"], rows, strict=True):
        assert set(point) == {"positions", "velocities", "time_from_start"}
        time = point["time_from_start"]
        assert (
            0 <= time["nanosec"] < 10**9
            and abs(time["sec"] + time["nanosec"] * 1e-9 - row[0]) < 1e-9
        )
        assert np.allclose(point["positions"], row[1:8], atol=1e-11)
        assert np.allclose(point["velocities"], row[8:], atol=1e-11)


def test_a_fast_cycle_is_slowed_down_to_the_speed_limits(saved, panda_design, capsys) -> None:
    options = [
        "follow",
        "design.json",
        "--plane",
        "yz",
        "--period",
        "0.3",
        "--json",
        "--csv",
        "m.csv",
    ]
    assert main(options) == 0
    data = json.loads(capsys.readouterr().out)
    _, rows = table(Path("m.csv"))
    assert data["slowed_by"] > 1.5 and np.isclose(rows[-1, 0], data["duration"])
    assert (np.abs(rows[:, 8:]) <= panda_design.task.velocity_limit * (1 + 1e-12)).all()
    steps = np.abs(np.diff(rows[:, 1:8], axis=0)) / np.diff(rows[:, 0])[:, None]
    assert (steps <= panda_design.task.velocity_limit * (1 + 1e-9)).all()


@pytest.mark.slow
def test_best_leaf_and_start(saved, capsys) -> None:
    options = ["follow", "design.json", "--plane", "yz", "--steps", "100", "--json"]
    assert main(options) == 0
    given = json.loads(capsys.readouterr().out)
    assert main(["follow", "--best-leaf", *options[1:]]) == 0  # a design is no value of it
    best = json.loads(capsys.readouterr().out)
    assert best["limit_margin"] > given["limit_margin"] and best["drift"][-1] < 1e-7
    assert main([*options, "--start", "0.1,-0.7,0,-2.3,0,1.6,0.8"]) == 0
    assert json.loads(capsys.readouterr().out)["start"][0] == 0.1


def test_a_proved_radius_is_of_one_leaf(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    task = rp.Robot.load("planar3r").task("tool", "xy")
    q = np.array([0.3, 0.8, 0.8])
    box = rp.Box(q, 0.6)
    design = rp.nearest_repeatable(rp.Pseudoinverse(task), None, box, degree=1)
    proof = rp.prove(design, seconds=5)
    rp.save(replace(design, proof=proof), "design.json")
    follow = ["follow", "design.json", "--path", "circle:0.02", "--json"]
    assert main(follow) == 0
    own = json.loads(capsys.readouterr().out)
    assert own["beyond_closing_radius"] == 0
    assert not any("another leaf" in note for note in own["notes"])
    beside = q + 0.02 * rp.redundancy.nullspace(task.jacobian(q))[:, 0]
    start = ",".join(map(str, beside))
    assert main([*follow, f"--start={start}"]) == 0
    other = json.loads(capsys.readouterr().out)
    assert other["beyond_closing_radius"] is None
    assert any("another leaf" in note for note in other["notes"])


def test_a_design_for_an_arm_of_ones_own(tmp_path, monkeypatch, capsys) -> None:
    from arms import planar_task

    monkeypatch.chdir(tmp_path)
    task, q0 = planar_task([1, 0.8, 0.6], tmp_path), np.array([0.3, 0.8, 0.8])
    potentials, region = rp.Polynomial(q0, 1, 0.3), rp.Box(q0, 0.3)
    rp.save(
        rp.nearest_repeatable(
            rp.Pseudoinverse(task),
            potentials,
            region,
            options=rp.FitOptions(samples=256, held_out=256),
        ),
        "arm.json",
    )
    assert main(["follow", "arm.json"]) == 2
    assert "not in the catalogue" in capsys.readouterr().err
    assert main(["follow", "arm.json", "--robot", "planar3.urdf", "--steps", "50"]) == 0
    assert main(["follow", "arm.json", "--robot", "panda"]) == 2
    assert "not 'panda'" in capsys.readouterr().err


BAD = {
    "no design": (["follow", "none.json"], "No such file"),
    "no control": (
        ["follow", "panda", "--strategy", "psuedoinverse"],
        "did you mean 'pseudoinverse'",
    ),
    "a design and a strategy": (
        ["follow", "design.json", "--strategy", "pseudoinverse"],
        "mutually exclusive and require a robot",
    ),
    "a frame for a design": (["follow", "design.json", "--frame", "panda_link8"], "its own frame"),
    "out of reach": (["follow", "design.json", "--path", "circle:2"], "no circle of radius 2 m"),
    "no path": (["follow", "design.json", "--path", "hexagon:1"], "no path 'hexagon:1'"),
    "start": (["follow", "design.json", "--start", "0,0"], "--start"),
    "best leaf of what has none": (
        ["follow", "panda", "--strategy", "pseudoinverse", "--best-leaf"],
        "repeatable",
    ),
    "folder": (
        ["follow", "design.json", "--csv", "none/motion.csv", "--steps", "20"],
        "cannot write none",
    ),
    "period": (["follow", "design.json", "--period", "0"], "--period"),
    "a rate of no time": (
        ["follow", "design.json", "--rate", "100"],
        "--rate requires --acceleration",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_arguments_get_one_clear_line_and_no_file(saved, capsys, case: str) -> None:
    arguments, words = BAD[case]
    try:
        code = main([*arguments])
    except SystemExit as done:  # argparse's own refusals
        code = done.code
    error = capsys.readouterr().err.strip().splitlines()
    assert code == 2 and words in error[-1] and error[-1].startswith("repctl")
    assert [p.name for p in Path.cwd().iterdir()] == ["design.json"]


def test_in_a_process_of_its_own(saved, tmp_path) -> None:
    done = repctl("follow", "design.json", "--steps", "50", "--yaml", "t.yaml", cwd=tmp_path)
    assert done.returncode == 0 and done.stderr == "" and (tmp_path / "t.yaml").is_file()
    text = saved.read_text()
    saved.write_text(text[: len(text) // 2])
    refused(repctl("follow", "design.json", cwd=tmp_path), "design.json", "not a design file")


def test_a_robot_alone_gets_the_nearest_repeatable(capsys) -> None:
    options = ["--path", "circle:0.1", "--cycles", "2", "--steps", "100", "--json"]
    assert main(["follow", "ppr", *options]) == 0
    followed = json.loads(capsys.readouterr().out)
    assert max(followed["drift"]) < 1e-9 and followed["outside"] == 0
