"""Repeatable inverses of every kind that can be written as C: arms, tasks, joint coordinates,
bases, potentials."""

from __future__ import annotations

import os
import shlex
import shutil
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from arms import Q_PANDA, spatial_task

import repctl_pin as rp


def c_compiler() -> list[str] | None:
    """The command of this machine's C compiler: ``CC`` if set, else the first that is there."""
    asked = shlex.split(os.environ.get("CC", ""))
    for command in [asked] if asked else [["cc"], ["gcc"], ["clang"]]:
        if (path := shutil.which(command[0])) is not None:
            return [path, *command[1:]]
    return None


def shared_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of this run of the tests, which its workers share."""
    folder = tmp_path_factory.getbasetemp()
    return folder.parent if "PYTEST_XDIST_WORKER" in os.environ else folder


def evaluate_cells_quickly(monkeypatch: pytest.MonkeyPatch) -> None:
    """Search for the worst poses of a cell from fewer starts, by fewer steps."""
    evaluate = "repctl_pin.extensions.cells.evaluate."
    monkeypatch.setattr(import_module(evaluate + "cell_evaluation"), "_SPEED_STARTS", 2)
    margins = import_module(evaluate + "margins")
    monkeypatch.setattr(margins, "_LENGTHS", replace(margins._LENGTHS, steps=5))


def some(names: Iterable[Any], *default: Any) -> list[Any]:
    """Make the parameters of a test: the default ones, and the others as slow ones."""
    slow = pytest.mark.slow
    return [name if name in default else pytest.param(name, marks=slow) for name in names]


def use_few_nodes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fit and evaluate designs at 1024 nodes, where their number is left to the package."""
    for name in ("_LEAST_NODES", "NODES"):
        monkeypatch.setattr(f"repctl_pin.design.fit.{name}", 1024)


NEEDS_C = pytest.mark.skipif(c_compiler() is None, reason="there is no C compiler on this machine")


@pytest.fixture(scope="session", autouse=True)
def own_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Compiled libraries go into a folder of this run of the tests, which its workers share."""
    folder = shared_folder(tmp_path_factory)
    (folder / "cache").mkdir(exist_ok=True)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(folder / "cache"))
        yield


IIWA = """<?xml version="1.0"?>
<robot name="lbr_iiwa"><link name="world"/><link name="lbr_iiwa_link_0"/>
<joint name="world_fixed" type="fixed"><parent link="world"/><child link="lbr_iiwa_link_0"/>
<origin xyz="0.1 0 0"/></joint>
{joints}
<link name="flange"/><joint name="flange_fixed" type="fixed"><parent link="lbr_iiwa_link_7"/>
<child link="flange"/>
<origin rpy="0 0 0.3" xyz="0 0 0.045"/></joint></robot>"""
"""An arm written as pybullet's data are: rounded right angles, a fixed joint at either end."""

_IIWA_ORIGINS = (
    ("0 0 0", "0 0 0.1575"),
    ("1.57079632679 0 3.14159265359", "0 0 0.2025"),
    ("1.57079632679 0 3.14159265359", "0 0.2045 0"),
    ("1.57079632679 0 0", "0 0 0.2155"),
    ("-1.57079632679 3.14159265359 0", "0 0.1845 0"),
    ("1.57079632679 0 0", "0 0 0.2155"),
    ("-1.57079632679 3.14159265359 0", "0 0.081 0"),
)


def iiwa(folder: Path) -> rp.Robot:
    """Load the arm of :data:`IIWA`."""
    joints = "".join(
        f'<link name="lbr_iiwa_link_{i}"/><joint name="lbr_iiwa_joint_{i}" type="revolute">'
        f'<parent link="lbr_iiwa_link_{i - 1}"/><child link="lbr_iiwa_link_{i}"/><origin '
        f'rpy="{rpy}" xyz="{xyz}"/>'
        '<axis xyz="0 0 1"/><limit effort="300" lower="-2.9" upper="2.9" velocity="10"/></joint>'
        for i, (rpy, xyz) in enumerate(_IIWA_ORIGINS, 1)
    )
    path = folder / "iiwa.urdf"
    path.write_text(IIWA.format(joints=joints), encoding="utf-8")
    return rp.Robot.load(path)


def control(
    task: rp.Task,
    center: np.ndarray,
    potentials: rp.Polynomial | rp.Fourier | rp.CustomPotentials,
    seed: int = 0,
) -> rp.RepeatableInverse:
    """Potentials of a family whose gradients at a configuration span the null space there, and that
    curve."""
    rng = np.random.default_rng(seed)
    N = rp.redundancy.nullspace(task.jacobian(center))
    A = np.linalg.lstsq(potentials.gradients(center[None])[0], N, rcond=None)[0]
    return rp.RepeatableInverse(
        task, potentials.weighted(A + 0.02 * rng.normal(size=A.shape) / np.sqrt(potentials.size))
    )


def target_at(task: rp.Task, q: np.ndarray, turn: Any = None) -> Any:
    """The placement at q, of several frames all of them; each turned, about the base."""
    placed = [x if turn is None else turn * x for x in task.placements(q)]
    return placed[0] if len(placed) == 1 else placed


def _start(task: rp.Task) -> np.ndarray:
    """A configuration away from singularities."""
    rng = np.random.default_rng(7)
    Q = task.reference + rng.uniform(-1.2, 1.2, (64, task.n))
    least = np.linalg.svd(task.jacobians(Q), compute_uv=False)[:, -1]
    return Q[int(np.argmax(least))]


def _polynomial(task: rp.Task, degree: int) -> tuple[rp.RepeatableInverse, np.ndarray]:
    q0 = Q_PANDA if task.robot.name == "panda" else _start(task)
    return control(task, q0, rp.Polynomial(q0, degree, 0.5)), q0


def _panda(kind: str = "pose") -> rp.Task:
    return rp.Robot.load("panda").task("panda_hand_tcp", kind)


def _with_base() -> rp.Task:
    return rp.Robot.load("talos", base="torso_2_link").task("wrist_left_ft_tool_link", "position")


def _both_hands() -> rp.Task:
    """A tray: the left hand's position and axis, and the right hand relative to it."""
    left, right = "gripper_left_base_link", "gripper_right_base_link"
    return rp.Robot.load("talos").task([(left, "axis"), (right, "pose", left)])


def _elbow_and_hand() -> rp.Task:
    """Two frames on one chain, one of them moved by three joints alone."""
    return rp.Robot.load("panda").task([("panda_link4", "xy"), ("panda_link8", "position")])


def _joined(task: rp.Task) -> tuple[rp.RepeatableInverse, np.ndarray]:
    potentials = (
        rp.Fourier(7, 1)
        + rp.Polynomial(Q_PANDA, 3, 0.5, variables=[1, 3])
        + rp.Polynomial(Q_PANDA, 2, 0.6)
    )
    return control(task, Q_PANDA, potentials), Q_PANDA


def _fourier(order: int, **options: object) -> tuple[rp.RepeatableInverse, np.ndarray]:
    return control(_panda(), Q_PANDA, rp.Fourier(7, order, **options)), Q_PANDA  # type: ignore[arg-type]


def _partial() -> tuple[rp.RepeatableInverse, np.ndarray]:
    """PPR's own kind: a polynomial of the slides, and one of the turning joint alone."""
    task = rp.Robot.load("ppr").task(None, "xy")
    q0 = np.array([0.2, 0.3, 0.8])
    potentials = rp.Polynomial(q0, 1, 0.5, variables=[0, 1]) + rp.Polynomial(
        q0, 5, 0.5, variables=[2], cross=False
    )
    return control(task, q0, potentials), q0


CONTROLS: dict[str, Callable[[Path], tuple[rp.RepeatableInverse, np.ndarray]]] = {
    **{f"panda, pose, degree {d}": lambda _, d=d: _polynomial(_panda(), d) for d in (1, 2, 3, 4)},
    "panda, pose, Fourier": lambda _: _fourier(1),
    "panda, pose, Fourier of some joints": lambda _: _fourier(2, cross=False),
    "panda, pose, joined": lambda _: _joined(_panda()),
    "panda, position, degree 2": lambda _: _polynomial(_panda("position"), 2),
    "panda, axis, degree 2": lambda _: _polynomial(_panda("axis"), 2),
    "panda, xz, degree 1": lambda _: _polynomial(_panda("xz"), 1),
    "xarm7, pose, degree 3": lambda _: _polynomial(rp.Robot.load("xarm7").task(None, "pose"), 3),
    "iiwa, pose, degree 2": lambda folder: _polynomial(iiwa(folder).task("flange", "pose"), 2),
    "tiago, position, degree 2": lambda _: _polynomial(
        rp.Robot.load("tiago").task(None, "position"), 2
    ),
    "talos, pose, degree 2": lambda _: _polynomial(
        rp.Robot.load("talos").task("wrist_left_ft_tool_link", "pose"), 2
    ),
    "talos from its torso": lambda _: _polynomial(_with_base(), 2),
    "ppr, degree 5 of some joints": lambda _: _partial(),
    "planar7r, xy, degree 3": lambda _: _polynomial(rp.Robot.load("planar7r").task(None, "xy"), 3),
    "random axes and slides": lambda folder: _polynomial(spatial_task(6, folder, seed=2), 2),
    "both hands of talos, degree 2": lambda _: _polynomial(_both_hands(), 2),
    "elbow and hand of panda": lambda _: _polynomial(_elbow_and_hand(), 2),
    "random axes, axis task": lambda folder: _polynomial(
        spatial_task(7, folder, kind="axis", seed=5), 3
    ),
}
"""By name: what makes the inverse and a configuration in the middle of where it serves."""


def in_numpy(inverse: rp.RepeatableInverse) -> rp.RepeatableInverse:
    """The same inverse on the NumPy law, which is that of arms that C cannot hold."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("REPCTL_NATIVE", "no")
        other = rp.RepeatableInverse(inverse.task, inverse.potentials, region=inverse.region)
        other.leaf(inverse.task.reference)  # chooses its law
    return other
