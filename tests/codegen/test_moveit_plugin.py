"""The MoveIt plugin in ``examples/moveit_plugin``, built against stand-ins for MoveIt's headers."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from cell_functions import function_of
from test_kdl import STRICT, run

import repctl_pin as rp

HERE = Path(__file__).parent
PLUGIN = HERE.parents[1] / "examples" / "moveit_plugin"


def built(function: rp.InverseFunction, folder: Path, *flags: str) -> Path:
    """Export a function, and build the plugin with the program in moveit_use.cpp."""
    if not Path("/usr/include/kdl/tree.hpp").exists() or not shutil.which("g++"):
        pytest.skip("there is no Orocos KDL (Debian: liborocos-kdl-dev) here")
    rp.export_c(function, folder, "arm")
    run(["gcc", "-std=c99", "-O0", *flags, "-c", "arm.c"], folder)
    system = ["/usr/include/eigen3", "/usr/include/kdl_parser"]
    paths = [flag for path in system for flag in ("-isystem", path)]
    paths += [f"-I{HERE / 'moveit_stand_ins'}", f"-I{folder}"]
    sources = [str(PLUGIN / "cell_kinematics.cpp"), str(HERE / "moveit_use.cpp")]
    libraries = ["-lorocos-kdl", "-lkdl_parser"]
    compiler = ["g++", *STRICT, "-O0", *flags, *paths]
    run([*compiler, *sources, "arm.o", "-o", "use", *libraries], folder)
    return folder / "use"


def answers(program: Path, function: rp.InverseFunction, poses: list[np.ndarray]) -> list[str]:
    """The lines of the program for poses (p, quaternion w x y z)."""
    folder, task = program.parent, function.task
    np.array(poses).tofile(folder / "poses.bin")
    urdf, base = str(task.robot.description.path), task.robot.model.frames[1].name
    links = [base, task.frame, "panda_link5"]
    return run(["./use", urdf, *links, "poses.bin", *task.joint_names], folder).split("\n")


def as_row(place: pin.SE3) -> np.ndarray:
    x, y, z, w = pin.Quaternion(place.rotation).coeffs()
    return np.array([*place.translation, w, x, y, z])


@pytest.mark.slow
def test_it_answers_with_f_or_with_the_reason(tmp_path: Path) -> None:
    """1,000 poses of a cell get F to 1e-12; poses outside, and what is no pose, get none."""
    function = function_of("poses")
    program = built(function, tmp_path, "-DROOM_FOR_A_REASON")
    U = function.cell.sample(1000, seed=9)
    inside = [as_row(function.cell.at(u)) for u in U]
    beyond = as_row(function.cell.at(U[0]))
    beyond[0] += 0.3
    loose, wrong = inside[0].copy(), inside[0].copy()
    loose[3:] *= 1 + 1e-4
    wrong[3:] *= 1.1
    nothing = np.full(7, np.nan)
    said = answers(program, function, [*inside, beyond, wrong, nothing, loose])
    errors, (*lines, end, _) = said[:5], said[5:]
    assert end == "end" and len(lines) == 1004
    assert not [line for line in said if line.startswith("wrong")]
    assert errors[0] == "error: group 'leg' needs one tip, and has 1"
    assert errors[1].startswith("error: the joints of group 'part' are not the 7")
    assert "--frame panda_link5 --base panda_link0" in errors[2]
    solved = np.array([line.split() for line in lines[:1000]], float)
    assert (solved[:, 0] == 1).all()
    assert np.abs(solved[:, 1:] - function.batch(U)).max() < 1e-12
    assert lines[1000].startswith("0 -31 the pose is outside the cell")
    assert lines[1001].startswith("0 -31 the pose is not made of")
    assert lines[1002].startswith("0 -31 the pose is not made of")
    near = np.array(lines[1003].split(), float)
    assert np.abs(near - solved[0]).max() < 1e-12


@pytest.mark.slow
def test_older_messages_and_a_sanitiser(tmp_path: Path) -> None:
    function = function_of("tool axes")
    program = built(function, tmp_path, "-fsanitize=address,undefined")
    poses = [as_row(function.cell.at(u)) for u in function.cell.sample(100, seed=9)]
    lines = answers(program, function, [*poses, np.zeros(7)])
    assert sum(line.startswith("1 ") for line in lines) == 100
    assert "0 -31" in lines
