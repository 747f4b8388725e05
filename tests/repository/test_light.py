"""A robot's computer needs seven packages; whatever needs one that was left out names it."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from commands import refused

import repctl_pin as rp

ROOT = Path(__file__).parents[2]
LEFT_OUT = [
    "array_api_compat",
    "PIL",
    "collada",
    "contourpy",
    "embreex",
    "example_robot_data",
    "jinja2",
    "manifold3d",
    "matplotlib",
    "meshcat",
]
LEFT_OUT += ["networkx", "rtree", "shapely", "tornado", "tqdm", "trimesh", "umsgpack"]
LOOP = """
import sys
sys.modules.update(dict.fromkeys(sys.argv[2:]))  # None: as if they were not installed
import numpy as np
import repctl_pin as rp

task = rp.Robot.load(sys.argv[1]).task("tool0", "pose")
design = rp.load("design.json", task)
q = q0 = np.array(task.reference)
leaf, path = design.inverse.leaf(q0), rp.circle(task, q0, 0.05)
for k in range(400):
    q = design.inverse.step(q, path.placement((k + 1) / 200 % 1), 0.01, leaf=leaf)
assert np.abs(q - q0).max() < 1e-3, q - q0
plain, box, few = rp.Pseudoinverse(task), rp.Box(q0, 0.2), rp.FitOptions(samples=64, held_out=64)
again = rp.nearest_repeatable(plain, None, box, degree=1, options=few)
motion = rp.follow(again.inverse, path, q0, cycles=1, steps=50)
assert motion.drift[0] < 1e-6
assert rp.timed(motion, rp.Limits(acceleration=5.0)).duration > 0
rp.export_c(design.inverse, "c")
for ask in (
    lambda: rp.animation({"it": motion}),
    lambda: __import__("repctl_pin.show.plots.designs"),
    lambda: rp.nearest_repeatable(plain, None, box, degree=1, progress=True),
    lambda: rp.Bodies(rp.Robot.load("panda").task()).nearest(np.zeros(7)),
):
    try:
        ask()
    except rp.InputError as error:
        print(error)
"""


def test_the_loop_runs_without_what_pictures_need(tmp_path: Path) -> None:
    """URDF, design file, steps, a design, C: all but pictures; and these say which package they
    lack."""
    arm = ROOT / "examples" / "my_arm.urdf"
    task = rp.Robot.load(arm).task("tool0", "pose")
    box = rp.Box(task.reference, 0.2)
    design = rp.nearest_repeatable(
        rp.Pseudoinverse(task), None, box, degree=1, options=rp.FitOptions(samples=64, held_out=64)
    )
    rp.save(design, tmp_path / "design.json")
    command = [sys.executable, "-c", LOOP, str(arm), *LEFT_OUT]
    path = os.environ | {
        "XDG_CACHE_HOME": str(tmp_path),  # no hull of a mesh is cached
        "PYTHONPATH": os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]),
    }
    done = subprocess.run(command, cwd=tmp_path, env=path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert [
        line.split("requires")[0] + line.split("`pip install ")[1]
        for line in done.stdout.splitlines()
    ] == [
        "an animation pillow pycollada jinja2 meshcat tornado trimesh`",
        "a figure matplotlib`",
        "a progress bar tqdm`",
        "the distance to the mesh link0.stl trimesh`",
    ]


def test_the_commands_of_the_page_ask_for_what_the_package_does() -> None:
    """The same least versions; all else that the package depends on is left out above."""
    page = (ROOT / "docs" / "how-to" / "robot-computer.md").read_text(encoding="utf-8")
    (line,) = re.findall(r"^pip install (.*numpy.*)$", page, flags=re.MULTILINE)
    asked = re.findall(r'"(.*?)"', line)
    (listed,) = re.findall(
        r"^dependencies = \[(.*?)^\]", (ROOT / "pyproject.toml").read_text("utf-8"), re.M | re.S
    )
    wants = [text for text in re.findall(r'"(.*?)"', listed) if not text.startswith("tomli")]
    assert set(asked) < set(wants)
    modules = {"pycollada": "collada", "pillow": "PIL"}
    others = {re.split(r"[>=]", text)[0].replace("-", "_") for text in set(wants) - set(asked)}
    assert {modules.get(name, name) for name in others} <= set(LEFT_OUT)


def test_what_is_there_is_not_asked_for(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ("cell", "ppr", "--shrink", "--keep")
    assert "mutually exclusive" in refused(capsys, *command)
    monkeypatch.setitem(sys.modules, "meshcat", None)  # as if it were not installed
    assert refused(capsys, *command) == (
        "repctl: repctl cell requires meshcat, which is not installed; run `pip install meshcat`\n"
    )
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    assert refused(capsys, *command) == (
        "repctl: repctl cell requires matplotlib, meshcat, which are not installed; "
        "run `pip install matplotlib meshcat`\n"
    )
