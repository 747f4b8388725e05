"""The exported solvers of Orocos KDL, built strictly, and judged by KDL's forward kinematics."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from arms import Q_PANDA
from cell_functions import function_of

import repctl_pin as rp

USE = Path(__file__).with_name("kdl_use.cpp")
STRICT = ["-std=c++17", "-pedantic", "-Wall", "-Wextra", "-Wconversion", "-Werror"]
CHECKED = {"pose": 6, "axis": 3, "position": 3}


def run(command: list[str], folder: Path) -> str:
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{command}\n{done.stdout[-2000:]}\n{done.stderr[-2000:]}"
    return done.stdout


def solve(
    control: rp.RepeatableInverse | rp.InverseFunction,
    poses: np.ndarray,
    start: np.ndarray,
    folder: Path,
    *flags: str,
) -> tuple[list[str], np.ndarray]:
    """Build the program in kdl_use.cpp and run it: its lines, and the joints (K, n)."""
    if not Path("/usr/include/kdl/chainiksolver.hpp").exists() or not shutil.which("g++"):
        pytest.skip("there is no Orocos KDL (Debian: liborocos-kdl-dev, libkdl-parser-dev) here")
    task = control.task
    rp.export_c(control, folder, "arm")
    poses.tofile(folder / "poses.bin")
    system = ["-isystem", "/usr/include/eigen3", "-isystem", "/usr/include/kdl_parser"]
    run(["gcc", "-std=c99", "-O0", *flags, "-c", "arm.c"], folder)
    run(
        ["g++", *STRICT, "-O0", *flags, f"-DCHECKED={CHECKED[task.kind]}", *system, f"-I{folder}"]
        + [str(USE), "arm.o", "-o", "use", "-lorocos-kdl", "-lkdl_parser"],
        folder,
    )
    urdf, root = str(task.robot.description.path), task.robot.model.frames[1].name
    numbers = [repr(float(v)) for v in start]
    said = run(["./use", urdf, root, task.frame, "poses.bin", *numbers], folder)
    return said.splitlines(), np.fromfile(folder / "joints.bin").reshape(-1, task.n)


def of_cell(function: rp.InverseFunction, count: int) -> np.ndarray:
    p, R = function.cell.placements(function.cell.sample(count, seed=9))
    return np.concatenate([p, np.asarray(R).reshape(count, 9)], axis=1)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "count", "flags"),
    [
        ("poses", 100, ()),
        pytest.param("poses", 10_000, ("-fsanitize=address,undefined",), marks=pytest.mark.slow),
        pytest.param("tool axes", 10_000, (), marks=pytest.mark.slow),
        pytest.param("positions", 10_000, (), marks=pytest.mark.slow),
    ],
)
def test_the_function_of_a_cell(
    name: str, count: int, flags: tuple[str, ...], tmp_path: Path
) -> None:
    function = function_of(name)
    poses = of_cell(function, count)
    (numbers, *refused), joints = solve(function, poses, np.zeros(7), tmp_path, *flags)
    solved, failed, off, rate = (float(v) for v in numbers.split())
    assert (solved, failed) == (count, 0)
    assert off < 1e-9 and rate < 1e-6
    U = function.cell.sample(count, seed=9)
    assert np.abs(joints - function.batch(U)).max() < 1e-9
    assert refused[0] == "this control has 7 joints; the chain has 0"
    assert "joint 0 of this control is panda_joint1; the chain's is panda_joint7" in refused
    assert refused[2].startswith("the chain's tip is not the frame of this control")


@pytest.mark.slow
def test_a_design_keeps_the_leaf_of_the_guess(panda_design: rp.Design, tmp_path: Path) -> None:
    inverse = panda_design.inverse
    Q = Q_PANDA + 0.2 * np.random.default_rng(3).uniform(-1, 1, (10_000, 7))
    at = [inverse.task.placement(q) for q in Q]
    poses = np.array([np.concatenate([x.translation, x.rotation.ravel()]) for x in at])
    (numbers, *_), joints = solve(inverse, poses, Q_PANDA, tmp_path)
    solved, failed, off, rate = (float(v) for v in numbers.split())
    assert solved + failed == 10_000 and failed < 100
    assert off < 1e-9 and rate < 1e-6
    c = inverse.leaf(Q_PANDA)
    assert max(np.abs(inverse.leaf(q) - c).max() for q in joints) < 1e-9
