"""The README is true: every command of it runs, writes what it says and prints what is shown; so
does its Python."""

from __future__ import annotations

import contextlib
import io
import json
import re
import shlex
import shutil
from collections.abc import Iterable
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from arms import catalogue
from commands import computed_once, main, parsers, without_pictures
from controls import some
from shown import answered, drifts, steady, written
from terminals import fit_terminals

import repctl_pin as rp

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
PROSE = re.sub(r"```.*?```", "", README, flags=re.DOTALL)
OWN = [ROOT / "examples" / name for name in ("my_arm.urdf", "loop.csv")]
"""What the README says to copy."""

STUDY = {
    f"repctl-out/my_arm/{name}"
    for name in ("animation.html", "drift.png", "joints.png", "motion.csv", "control.json")
}
WRITES = {
    "inspect my_arm.urdf": set(),
    "study my_arm.urdf --report": STUDY | {"repctl-out/my_arm/report.html"},
    "study my_arm.urdf --path loop.csv": STUDY,
    "follow repctl-out/my_arm/control.json --robot my_arm.urdf --csv motion.csv --yaml "
    "trajectory.yaml": {"motion.csv", "trajectory.yaml"},
    "check my_arm.urdf": set(),
    "design my_arm.urdf --region 0.4": {
        "repctl-out/my_arm/design.png",
        "repctl-out/my_arm/design.json",
    },
    "export repctl-out/my_arm/design.json --robot my_arm.urdf --out c": {
        *(f"c/arm_control{end}" for end in (".h", ".c", ".hpp", "_kdl.hpp")),
        *(f"c/{name}" for name in ("test_vectors.h", "check.c", "loop.c", "CMakeLists.txt")),
    },
    "cell my_arm.urdf --half-width 0.05": {
        f"repctl-out/my_arm/cell.{end}" for end in ("html", "json", "png")
    },
    "robots": set(),
}
"""The commands of "Your own arm", and the files that each should write."""


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", README, flags=re.DOTALL)


def commands() -> list[str]:
    lines = [line for block in blocks("bash") for line in block.splitlines()]
    return [
        part.split("#")[0].strip() for line in lines for part in re.findall(r"\brepctl (.*)", line)
    ]


@pytest.mark.parametrize("command", commands())
def test_commands_parse(command: str) -> None:
    assert callable(parsers()[""].parse_args(shlex.split(command)).run)


def test_the_two_commands_are_there() -> None:
    install = [
        line
        for block in blocks("bash")
        for line in block.splitlines()
        if line.startswith("python3 -m venv")
    ]
    assert install[0].endswith("repctl study panda") and install[1].endswith("python -m pytest")


def test_three_commands_lead_to_ones_own_report() -> None:
    (three,) = (block for block in blocks("bash") if "--report" in block)
    install, *others = (line.split("#")[0].strip() for line in three.splitlines())
    assert (
        install
        == "python3 -m venv .venv && source .venv/bin/activate && pip install -q ~/repctl_pin"
    )
    assert others == ["repctl inspect my_arm.urdf", "repctl study my_arm.urdf --report"]


CHAINS = [
    ["inspect", "study"],
    ["study", "follow"],
    ["check", "cell"],
    ["design", "export"],
    ["robots"],
]
"""Commands of "Your own arm" that use what earlier ones of the same chain wrote."""


def chains() -> dict[str, list[str]]:
    """The README's commands, cut into chains that can run side by side; by each one's last."""
    left, found = list(WRITES), {}
    for words in CHAINS:
        chain = []
        for word in words:
            chain.append(next(command for command in left if command.startswith(word)))
            left.remove(chain[-1])
        found[chain[-1]] = chain
    assert not left
    return found


def test_the_commands_for_ones_own_arm_are_these() -> None:
    *others, node = sorted(commands(), key=lambda command: command.startswith("ros2"))
    assert others == ["study panda", *WRITES]
    assert node.startswith("ros2 repctl-out/my_arm/control.json")  # needs ROS 2 to run
    assert all(f"(examples/{file.name})" in README for file in OWN)


def run_in(folder: Path, chain: list[str], capsys: pytest.CaptureFixture[str]) -> list[str]:
    """Run commands one after the other; each writes its files and no others."""
    printed = []
    for command in chain:
        before = stamps(folder)
        assert main(shlex.split(command)) == 0, command
        text, complaints = capsys.readouterr()
        assert complaints == "", command
        printed.append(text)
        after = stamps(folder)
        made = {name for name in after if after[name] != before.get(name)}
        assert made == written(printed[-1]) == WRITES[command], command
    return printed


JOINTS = [f"joint{i}" for i in range(1, 8)]


def check_study(text: str, path: str) -> None:
    """A study's answer: the start it took, its path, and which strategies drift."""
    assert re.search(rf"^my_arm tool0, pose, r = 1: {path}, \d+ cycles$", text, flags=re.MULTILINE)
    assert "note: the start is the reference pose\n" in text or "more notes: --full\n" in text
    usual, _, repeatable = answered(text, "joints off")
    assert float(usual) > 0.1 and repeatable == "0"
    assert answered(text, "first cycle closes")[::2] == ["no", "yes"]


def check_export(folder: Path, _: str) -> None:
    """The design's file and the motion that was timed."""
    file = folder / "repctl-out/my_arm/design.json"
    assert json.loads(file.read_text(encoding="utf-8"))["task"]["joints"] == JOINTS


def check_robots(names: Iterable[str], printed: str) -> None:
    """The named robots, in 80 columns; the README says how many there are."""
    lines = printed.splitlines()
    assert max(map(len, lines)) <= 80
    (robots,) = re.findall(r"repctl robots +# (\d+) robots", README)
    assert {line.split()[0] for line in lines[2:-3]} == set(names)
    assert len(catalogue()) == int(robots)


def check_follow(folder: Path, printed: str) -> None:
    """The followed motion: closed, inside Ω, in both files."""
    assert printed.startswith("my_arm tool0, pose: loop.csv\n")
    assert "\noutside Ω       0 %\n" in printed
    text = (folder / "trajectory.yaml").read_text(encoding="utf-8")
    assert yaml.safe_load(text)["joint_names"] == JOINTS
    rows = np.genfromtxt(folder / "motion.csv", delimiter=",", names=True)
    assert all(abs(rows[name][-1] - rows[name][0]) < 1e-9 for name in JOINTS)
    assert np.ptp(rows["joint1"]) > 0.1


def some_of_them() -> dict[str, Any]:
    """The rows of the small robots and of those with the longest names."""
    rows = catalogue()
    longest = sorted(rows, key=len)[-3:]
    return {name: rows[name] for name in rows if "planar" in name or name in longest}


@pytest.mark.slow
def test_every_robot_is_listed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """In a terminal of 80 columns."""
    fit_terminals(monkeypatch)
    assert main(["robots"]) == 0
    check_robots(catalogue(), capsys.readouterr().out)


def in_three_cycles(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have every study take few cycles and steps, whatever else it is asked."""
    few = {"cycles": 3, "steps": 100}
    study = rp.study
    monkeypatch.setattr(rp, "study", lambda *given, **o: study(*given, **(o | few)))


@pytest.mark.parametrize(
    "last", some(chains(), *(c for c in chains() if c.startswith(("export", "robots"))))
)
def test_the_commands_for_ones_own_arm_run(
    last: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    blank_pictures: None,
    no_tours: None,
    quick_choices: None,
    two_degrees: None,
) -> None:
    """In the README's order, with the two files it says to copy; later commands of a chain use what
    earlier ones wrote. What figures show is a matter of tests/show, tours of tests/cli."""
    monkeypatch.chdir(tmp_path)
    in_three_cycles(monkeypatch)
    few = some_of_them()
    monkeypatch.setattr("repctl_pin.model.catalogue.table", lambda: few)
    fit_terminals(monkeypatch)
    for file in OWN:
        shutil.copy(file, tmp_path)
    printed = dict(zip(chains()[last], run_in(tmp_path, chains()[last], capsys), strict=True))
    for command, text in printed.items():
        if command.startswith("inspect"):
            assert "frame tool0, moved by 7: joint1, " in text and "  pose r = 1, " in text
        elif command.startswith("study"):
            path = "loop.csv" if "loop.csv" in command else "circle of radius 0.1 m in xy"
            check_study(text, path)
        elif "control.json" in command:
            check_follow(tmp_path, text)
        elif command.startswith("check"):
            assert text.startswith("not repeatable: ")
        elif command.startswith("design"):
            assert "\ndegree" in text
        elif command.startswith("export"):
            check_export(tmp_path, text)
        elif command == "robots":
            check_robots(few, text)


@pytest.mark.slow
@pytest.mark.parametrize(
    "command",
    [
        pytest.param(command, marks=() if "ppr" in command else pytest.mark.slow)
        for command in re.findall(r"`repctl (study [^`]+)`", PROSE)
    ],
)
def test_the_gallerys_commands_run(
    command: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    blank_pictures: None,
    few_nodes: None,
) -> None:
    monkeypatch.chdir(tmp_path)
    in_three_cycles(monkeypatch)
    shutil.copy(OWN[0], tmp_path)
    assert main([*shlex.split(command), "--full"]) == 0
    table = capsys.readouterr().out
    assert drifts(table, "J⁺")[1] > 0.03 and drifts(table, "nearest repeatable")[1] < 1e-7


def stamps(folder: Path) -> dict[str, int]:
    """When each file of a folder was written."""
    return {
        str(f.relative_to(folder)): f.stat().st_mtime_ns for f in folder.rglob("*") if f.is_file()
    }


def test_the_main_jobs_table_is_what_the_command_prints(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """One study of one problem, written once and printed twice; its figures hold nothing."""
    monkeypatch.chdir(tmp_path)
    without_pictures(monkeypatch)
    files = import_module(".study_files", "repctl_pin.show")
    for module, name in ((rp, "Problem"), (rp, "study"), (files, "write_study")):
        monkeypatch.setattr(module, name, computed_once(getattr(module, name)))
    assert main(["study", "panda"]) == 0
    (shown,) = blocks("text")
    answer = capsys.readouterr().out
    assert steady(shown) == steady(answer) and answer.count("\n") <= 22
    assert set(stamps(tmp_path)) == written(shown)
    assert main(["study", "panda", "--full"]) == 0
    page = (ROOT / "docs" / "commands.md").read_text(encoding="utf-8")
    (full,) = re.findall(r"```text\n(.*?)```", page, flags=re.DOTALL)
    assert steady(full) == steady(capsys.readouterr().out)
    assert set(stamps(tmp_path)) == written(full)


def test_the_python_runs_and_its_arm_comes_back(monkeypatch: pytest.MonkeyPatch) -> None:
    """With fewer nodes and steps, which change no claim; docs/how-to/python.md has the rest."""
    few = rp.FitOptions(samples=512, held_out=256)
    monkeypatch.setattr(rp, "nearest_repeatable", partial(rp.nearest_repeatable, options=few))
    monkeypatch.setattr(rp, "follow", partial(rp.follow, steps=200))
    (code,) = blocks("python")
    names: dict = {}
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        exec(code, names)
    drifting, closed = map(
        float, re.findall(r"^drift (\S+) rad,", out.getvalue(), flags=re.MULTILINE)
    )
    assert drifting > 0.1 and closed < 1e-8
    inverse, q0 = names["design"].inverse, names["q0"]
    xdot = names["path"].twist(0.0)
    assert "`design.inverse.velocity(q, xdot)`" in PROSE
    assert np.allclose(inverse.velocity(q0, xdot), inverse(q0) @ xdot)


def test_its_first_paragraph_and_its_numbers_speak_the_users_words() -> None:
    """What it is for in the words that users search for; the table's two numbers are said again
    with their robot, path and number of cycles."""
    first = " ".join(PROSE.split("\n\n")[1].split())
    for words in ("Same pose, same joints", "elbow drift", "configuration lock", "any URDF"):
        assert words in first
    (table,) = blocks("text")
    bridge = " ".join(next(p for p in PROSE.split("\n\n") if "So a " in p).split())
    assert "Panda" in bridge and "circle ten times" in bridge and "10 cycles" in table
    for label, unit in (("elbow off its start", "cm"), ("joints off their start", "rad")):
        value = re.search(rf"{label}[^\n\d]*([\d.]+)", table)
        assert value is not None and f"{value[1]} {unit}" in bridge


def test_it_is_short() -> None:
    """One screen after the other: at most 1,200 words, one picture before the two commands."""
    assert len(README.split()) <= 1200
    assert README.partition("## Two commands")[0].count("![") == 1


def test_every_file_it_names_is_there() -> None:
    for name in re.findall(r"\]\(([^)#:]+)\)", README) + re.findall(
        r"python ((?:examples|tests)/\S+\.py)", README
    ):
        assert (ROOT / name).is_file(), name


def test_the_arm_to_copy_is_sound() -> None:
    """As its comments describe it: upright at 0, 0.85 m from shoulder to tool, its middle a pose to
    work from."""
    robot = rp.Robot.load(OWN[0])
    assert (
        robot.warnings == () and robot.description.meshes == () and robot.default_frame == "tool0"
    )
    task = robot.task("tool0", "pose")
    upright = task.placement(np.zeros(7))
    assert np.allclose(upright.translation, [0.04, 0, 0.32 + 0.85]) and np.allclose(
        upright.rotation, np.eye(3)
    )
    assert np.allclose(task.reference, (task.lower + task.upper) / 2)
    middle = task.placement(task.reference)
    assert (
        middle.translation[0] > 0.4
        and middle.translation[2] > 0.3
        and middle.rotation[2, 2] < -0.999
    )
    for inertia in robot.model.inertias[1:]:
        a, b, c = np.linalg.eigvalsh(inertia.inertia)
        assert inertia.mass > 0 and 0 < a <= b <= c <= a + b  # a body can have it


def test_the_loop_to_copy_is_the_seam_of_two_pipes() -> None:
    points = rp.read_waypoints(OWN[1]).points
    assert np.array_equal(points[0], points[-1])
    x, y, z = points.T
    assert (
        np.abs(np.hypot(x - 0.45, y) - 0.08).max() < 1e-4
        and np.abs(np.hypot(y, z - 0.25) - 0.15).max() < 1e-4
    )
