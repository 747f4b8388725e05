"""From a study or a design to the robot: what is saved is followed inside Ω, on eleven arms."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from commands import computed_once, main, told, without_pictures

import repctl_pin as rp

yaml = pytest.importorskip("yaml")

ARMS = {
    "panda": [],
    "xarm7": [],
    "baxter": [],
    "tiago": [],
    "pr2": [],
    "talos": [],
    "kinova": [],
    "ur5": [],
    "z1": ["--task", "position"],
    "planar3r": [],
    "planar4r": [],
}


def inside(capsys: pytest.CaptureFixture[str], control: str, arm: str) -> dict:
    """Follow and animate a saved control without a further word, and read what was written for the
    robot."""
    followed = told(
        capsys, "follow", control, "--steps", "200", "--csv", "m.csv", "--yaml", "m.yaml"
    )
    assert followed["outside"] == 0 and max(followed["drift"]) < 1e-8
    animated = told(capsys, "animate", control, "--steps", "60", "--cycles", "2", "--out", "page")
    assert animated["drift"]["repeatable"][-1] < 1e-6
    design = rp.load(control)
    written = np.genfromtxt("m.csv", delimiter=",", names=True)
    joints = [name for name in design.task.joint_names if name in written.dtype.names]
    assert tuple(joints) == design.task.joint_names
    q = np.column_stack([written[name] for name in joints])
    assert not (design.region.ratio(q) > 1).any()
    points = np.array(
        [
            p["positions"]
            for p in yaml.safe_load(Path("m.yaml").read_text(encoding="utf-8"))["points"]
        ]
    )
    assert np.abs(points - q).max() < 1e-9 and np.abs(points[0] - design.cycle.start).max() < 1e-9
    return followed


def deployed(arm: str, capsys: pytest.CaptureFixture[str]) -> tuple[dict, dict]:
    """Both ways to a control: a study's, and a design's over a box."""
    studied = told(capsys, "study", arm, *ARMS[arm], "--cycles", "2", "--steps", "200")
    followed = inside(capsys, f"repctl-out/{arm}/control.json", arm)
    assert followed["path"] == studied["path"] and np.allclose(followed["start"], studied["start"])
    assert followed["duration"] == pytest.approx(studied["period"])
    row = studied["strategies"]["repeatable"]
    assert (row["outside"] == 0 and row["speed_ratio"] is None) or row["speed_ratio"] <= 1
    width = [
        "--region",
        "0.2",
        "--shrink",
        "--degree",
        "2",
        "--samples",
        "1024",
        "--held-out",
        "512",
    ]
    told(capsys, "design", arm, *ARMS[arm], *width)
    return followed, inside(capsys, f"repctl-out/{arm}/design.json", arm)


@pytest.mark.slow
def test_a_control_is_followed_inside_its_region(tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    without_pictures(monkeypatch)
    deployed("planar3r", capsys)


@pytest.mark.slow
@pytest.mark.parametrize("arm", ARMS)
def test_eleven_arms(arm: str, tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    for way, found in zip(("study", "design"), deployed(arm, capsys), strict=True):
        with capsys.disabled():
            print(
                f"\n{arm:9s} {way:6s} {found['path']}, {found['duration']:.3g} s: outside "
                f"{found['outside']:.1%}"
            )


def test_outside_is_the_loudest_line(tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    box = rp.Box([0.1, 0.2, 0.3], 0.1)
    task = rp.Robot.load("ppr").task("tool", "xy")
    rp.save(
        rp.nearest_repeatable(
            rp.Pseudoinverse(task),
            None,
            box,
            degree=1,
            options=rp.FitOptions(samples=64, held_out=64),
        ),
        "d.json",
    )
    within = told(capsys, "follow", "d.json")  # a design for no cycle: the largest circle inside Ω
    assert within["outside"] == 0 and max(within["drift"]) < 1e-6
    assert main(["follow", "d.json", "--path", "circle:0.3"]) == 0
    first = " ".join(capsys.readouterr().out.partition("\n\n")[0].split())
    assert first.startswith("warning: ")
    assert " % of the motion lies outside Ω, where repeatability is not guaranteed;" in first
    assert told(capsys, "follow", "d.json", "--path", "circle:0.3")["outside"] > 0.3


@pytest.mark.slow
def test_a_cycle_takes_as_long_as_the_joints_need(tmp_path, monkeypatch, capsys) -> None:
    """A joint that is slow: the time is lengthened, said, and kept; asked for the usual time, what
    breaks is marked."""
    monkeypatch.chdir(tmp_path)
    without_pictures(monkeypatch)
    text = rp.Robot.load("planar3r").description.path.read_text(encoding="utf-8")
    assert 'velocity="' in text
    import re

    Path("slow.urdf").write_text(
        re.sub(r'velocity="[^"]*"', 'velocity="0.05"', text), encoding="utf-8"
    )
    few = ["slow.urdf", "--cycles", "2", "--steps", "100", "--degree", "1"]
    studied = told(capsys, "study", *few)
    assert studied["period"] > 5 and any("period increased to" in note for note in studied["notes"])
    for key in ("pseudoinverse", "repeatable"):
        assert (
            0.7
            < max(studied["strategies"][k]["speed_ratio"] for k in ("pseudoinverse", "repeatable"))
            <= 0.95
        )
        assert studied["strategies"][key]["speed_ratio"] <= 0.95
    assert (
        told(capsys, "follow", "repctl-out/slow/control.json", "--robot", "slow.urdf")["slowed_by"]
        < 1 + 1e-6
    )
    monkeypatch.setattr(rp, "study", computed_once(rp.study))
    assert main(["study", *few, "--period", "5"]) == 0
    out = capsys.readouterr().out
    assert re.search(r"^limits .*speed × \d", out, flags=re.MULTILINE)
    assert re.search(r"^! usual control: \w+ reaches .* times its speed", out, flags=re.MULTILINE)
    assert main(["study", *few, "--period", "5", "--full"]) == 0
    out = capsys.readouterr().out
    assert (
        re.search(r"^peak joint speed.*\d!", out, flags=re.MULTILINE)
        and "times its speed limit" in out
    )
    said = " ".join(out.partition("\n\n")[0].split())
    whose = "Under (either control|the repeatable one), "
    assert re.search(rf"{whose}\S+ reaches [\d.]+ times its speed limit in cycle \d+\. ", said)


@pytest.mark.slow
def test_a_studys_weight_is_its_controls(tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    without_pictures(monkeypatch)
    few = ["study", "planar3r", "--degree", "1", "--cycles", "1", "--steps", "40"]
    few += ["--region", "0.2", "--out", "o"]
    costs = {}
    for weight in ([], ["--weight", "9,1,1"]):
        told(capsys, *few, *weight)
        design = rp.load("o/control.json")
        costs[len(weight)] = np.abs(design.inverse(design.cycle.start)[0]).sum()
    # the first joint moves less
    assert isinstance(design.desired, rp.WeightedInverse) and costs[2] < 0.7 * costs[0]


@pytest.mark.slow
def test_a_failed_command_leaves_the_files_of_the_one_before(tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    few = [
        "design",
        "ppr",
        "--degree",
        "1",
        "--region",
        "0.2",
        "--samples",
        "64",
        "--held-out",
        "64",
        "--out",
        "e",
    ]
    kinds = {}
    for weight in ("inertia", "1,2,3"):
        told(capsys, *few, "--weight", weight)
        kinds[weight] = json.loads(Path("e/design.json").read_text(encoding="utf-8"))["desired"]
    assert kinds["inertia"]["weight"] == "inertia" and len(kinds["1,2,3"]["weight"]) == 3
    limits = ["design", "planar3r", *few[2:]]
    told(capsys, *limits, "--weight", "limits")
    saved = json.loads(Path("e/design.json").read_text(encoding="utf-8"))
    assert (
        saved["desired"] == {"kind": "limits", "gain": 1.0, "onset": 0.1}
        and saved["task"]["robot"] == "planar3r"
    )

    def refuse(design: rp.Design, file: Path) -> Path:
        raise rp.InputError("cannot write it")

    monkeypatch.setattr(rp, "save", refuse)
    assert main(few) == 2
    assert "cannot write it" in capsys.readouterr().err
    assert json.loads(Path("e/design.json").read_text(encoding="utf-8")) == saved
    assert sorted(p.name for p in Path("e").iterdir()) == ["design.json", "design.png"]
