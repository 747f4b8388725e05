"""Millions of ticks of the governor in C, on nine arms and three pairs of hands: random twists,
targets, jumps, reversals and garbage, without and with levels.
Run: python tests/attack/governor_ticks.py [ticks per arm] [repeats] [arm ...]

The second line of an arm is that with levels. Its ``hand`` is the largest error of a resting frame
while the level moves, m and of rotation matrices; ``level`` that of a level that was reached.
Times are in Jacobians of the first frame by Pinocchio, called from Python. Ticks above 0.1 ms are
timed again, and the least time counts."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pinocchio as pin

import repctl_pin as rp
from repctl_pin.model.several_frames import of_singles

sys.path.insert(0, str(Path(__file__).parents[1]))

from arms import Q_PANDA, planar_urdf
from controls import control, iiwa

HARNESS = Path(__file__).with_name("governor_ticks.c")
DT = 1e-3

IIWA = np.radians([85, 85, 100, 75, 130, 135, 135])
"""Published speed limits of iiwa14, rad/s."""

RAIL = """<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>
<origin xyz="{xyz}"/><axis xyz="{axis}"/>
<limit lower="{low}" upper="{high}" effort="100" velocity="{speed}"/></joint>
<link name="{child}"/>"""


def rail(folder: Path) -> rp.Robot:
    """Write an arm of six joints on a rail of 3 m."""
    rows = [
        ("rail", "prismatic", "0 0 0", "0 1 0", 1.5, 1.5),
        ("j1", "revolute", "0 0 0.15", "0 0 1", 3.1, 3.0),
        ("j2", "revolute", "0 0.12 0", "0 1 0", 3.1, 3.0),
        ("j3", "revolute", "0 -0.09 0.42", "0 1 0", 2.9, 3.0),
        ("j4", "revolute", "0 0 0.39", "0 1 0", 3.1, 3.0),
        ("j5", "revolute", "0 0.09 0", "0 0 1", 3.1, 3.0),
        ("j6", "revolute", "0 0 0.095", "0 1 0", 3.1, 3.0),
    ]
    joints, parent = "", "base"
    for name, kind, xyz, axis, half, speed in rows:
        joints += RAIL.format(
            name=name, kind=kind, parent=parent, child=f"l_{name}", xyz=xyz, axis=axis,
            low=-half, high=half, speed=speed,
        )  # fmt: skip
        parent = f"l_{name}"
    joints += (
        f'<joint name="end" type="fixed"><parent link="{parent}"/><child link="tool"/>'
        '<origin xyz="0 0.1 0"/></joint><link name="tool"/>'
    )
    path = folder / "rail.urdf"
    path.write_text(f'<robot name="rail"><link name="base"/>{joints}</robot>', encoding="utf-8")
    return rp.Robot.load(path)


def start_of(task: rp.Task) -> np.ndarray:
    """Choose the least singular of some configurations well inside the limits."""
    middle, half = (task.lower + task.upper) / 2, (task.upper - task.lower) / 2
    Q = middle + 0.6 * half * np.random.default_rng(7).uniform(-1, 1, (256, task.n))
    return Q[int(np.argmax(np.linalg.svd(task.jacobians(Q), compute_uv=False)[:, -1]))]


Arm = tuple[rp.Task, np.ndarray, "np.ndarray | float", "np.ndarray | float"]


def _panda(_: Path) -> Arm:
    task = rp.Robot.load("panda").task("panda_hand_tcp", "pose")
    return (
        task, Q_PANDA,
        np.array([15, 7.5, 10, 12.5, 15, 20, 20]),
        np.array([7500, 3750, 5000, 6250, 7500, 10000, 10000.0]),
    )  # fmt: skip


def _panda_of(kind: str, folder: Path) -> Arm:
    _, start, acceleration, jerk = _panda(folder)
    return rp.Robot.load("panda").task("panda_hand_tcp", kind), start, acceleration, jerk


def _planar_5(folder: Path) -> Arm:
    (folder / "planar5.urdf").write_text(planar_urdf([0.4, 0.4, 0.3, 0.3, 0.2], range_=2.0))
    task = rp.Robot.load(folder / "planar5.urdf").task("tool", "xy")
    return task, np.array([0.3, 0.8, -0.6, 0.8, 0.5]), 6.0, 400.0


def _iiwa(folder: Path) -> Arm:
    task = iiwa(folder).task("flange", "pose")
    return task, np.array([0.0, 0.6, 0.0, -1.4, 0.0, 1.1, 0.0]), 10.0, 2000.0


def _xarm7(_: Path) -> Arm:
    task = rp.Robot.load("xarm7").task(None, "pose")
    return task, start_of(task), 15.0, 1000.0


def _baxter(_: Path) -> Arm:
    task = rp.Robot.load("baxter").task("left_gripper", "pose")
    return task, start_of(task), 5.0, 500.0


def _rail(folder: Path) -> Arm:
    task = rail(folder).task("tool", "pose")
    return task, np.array([0.0, 0.3, 0.5, 0.9, -0.6, 0.7, 0.3]), 6.0, 300.0


def _planar(_: Path) -> Arm:
    task = rp.Robot.load("planar3r").task("tool", "xy")
    return task, np.array([0.3, 0.8, 0.8]), 6.0, 400.0


def _hands(robot: str, left: str, right: str) -> Arm:
    task = rp.Robot.load(robot).task([left, right])
    return task, start_of(task), 5.0, 500.0


_BAXTER = ("baxter", "left_gripper", "right_gripper")
_TALOS = ("talos", "gripper_left_base_link", "gripper_right_base_link")
_TIAGO = ("tiago_dual", "wrist_left_ft_tool_link", "wrist_right_ft_tool_link")

ARMS: dict[str, Callable[[Path], Arm]] = {
    "panda": _panda,
    "iiwa14": _iiwa,
    "xarm7": _xarm7,
    "baxter": _baxter,
    "rail": _rail,
    "planar3r": _planar,
    "planar5r": _planar_5,
    "panda, axis": partial(_panda_of, "axis"),
    "panda, position": partial(_panda_of, "position"),
    "baxter, both hands": lambda _: _hands(*_BAXTER),
    "talos, both hands": lambda _: _hands(*_TALOS),
    "tiago_dual, both hands": lambda _: _hands(*_TIAGO),
}


def jacobian_time(task: rp.Task, q: np.ndarray) -> float:
    """Measure the CPU time of Pinocchio's frame Jacobian, called from Python, µs."""
    task, q = of_singles(task, q)[0]
    model, data, frame = task.model, task.model.createData(), task._frame_id
    axes, found = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED, []
    for _ in range(20):
        began = time.process_time()
        for _ in range(2000):
            pin.computeFrameJacobian(model, data, q, frame, axes)
        found.append((time.process_time() - began) / 2000)
    return 1e6 * min(found)


def run(name: str, ticks: int, seed: int, repeats: int, folder: Path) -> list[dict[str, float]]:
    """Export, build and drive one arm, without and with levels; what was measured."""
    task, start, acceleration, jerk = ARMS[name](folder)
    inverse, n = control(task, start, rp.Polynomial(start, 2, 0.5)), task.n
    rp.export_c(inverse, folder / name, "arm")
    command = f"gcc -std=c99 -O2 -D_POSIX_C_SOURCE=199309L arm.c {HARNESS} -I. -o run -lm"
    subprocess.run(command.split(), cwd=folder / name, check=True)
    margin = 0.02
    speeds = IIWA if name == "iiwa14" else task.velocity_limit
    rows = [
        start, speeds, np.broadcast_to(acceleration, n), np.broadcast_to(jerk, n),
        task.lower, task.upper, [margin],
    ]  # fmt: skip
    numbers = " ".join(f"{value!r}" for part in rows for value in np.asarray(part, float).tolist())
    before = jacobian_time(task, start)
    counts = [str(ticks), str(seed), str(DT), str(repeats)]
    said = [
        subprocess.run(
            ["./run", *counts, levels],
            cwd=folder / name, input=numbers, capture_output=True, text=True, check=True,
        ).stdout.split()[:-1]
        for levels in "01"
    ]  # fmt: skip
    unit = min(before, jacobian_time(task, start))
    keys = (
        "velocity acceleration jerk margin leaf apart arrived not_arrived median mean per_mille "
        "longest OK SINGULAR BAD_NUMBER OUTSIDE SLOWED LIMIT hand level"
    )
    found = [dict(zip(keys.split(), map(float, words), strict=True)) for words in said]
    for one in found:
        for key in ("median", "mean", "per_mille", "longest"):
            one[key] /= unit
        one["jacobian"] = unit
    return found


def main() -> None:
    """Print two lines per arm."""
    ticks = int(sys.argv[1]) if len(sys.argv) > 1 else 20_000
    repeats = int(sys.argv[2]) if len(sys.argv) > 2 else 3
    for name in sys.argv[3:] or ARMS:
        with tempfile.TemporaryDirectory() as folder:
            lines = run(name, ticks, 1, repeats, Path(folder))
        for found in lines:
            told = ", ".join(f"{key} {value:.10g}" for key, value in found.items())
            print(name, told, flush=True)


if __name__ == "__main__":
    main()
