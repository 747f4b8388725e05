"""Functions of cells beside other programs: ten cycles of random closed tours through all of a cell
with rotations.

One command, one process, some minutes; it prints the table of docs/cells-measured.md:

    pip install -e '.[bench]'
    python tests/benchmarks/repeatability/cells.py

Every program starts at the joints of F, and undoes the whole task error in each step. Extra joint
speed is over the least that the same motion of the frame takes at the program's own joints."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from pathlib import Path

os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"))

import numpy as np
import ours
import peers
import pinocchio as pin
from cycles import joints_of, microseconds
from robots import STARTS, task_of
from scenes import Scene

import repctl_pin as rp

ARMS = ("panda", "iiwa14", "xarm7")
TOURS, LAPS, STEPS = 3, 10, 1000
HALF_WIDTH, ROTATION = 0.08, 0.25  # m, rad


def cell_design(task: rp.Task, arm: str) -> rp.CellDesign:
    """Design over a cell round the benchmark's start."""
    cell = rp.Cell(task, task.placement(STARTS.get(arm, task.reference)), HALF_WIDTH, ROTATION)
    return rp.nearest_inverse_function(rp.Pseudoinverse(task), cell)


def tour(cell: rp.Cell, seed: int) -> Callable[[float], pin.SE3]:
    """A random smooth closed path: three waves in each coordinate, up to 0.9 of the cell."""
    rng, k = np.random.default_rng(seed), 2 * np.pi * np.arange(1, 4)
    a, b = rng.normal(size=(2, cell.k, 3)) / np.arange(1, 4)
    s = np.linspace(0, 1, 721)[:, None]
    most = np.abs(np.cos(k * s) @ a.T + np.sin(k * s) @ b.T).max(axis=0)
    a, b = 0.9 * a / most[:, None], 0.9 * b / most[:, None]
    return lambda s: cell.at(a @ np.cos(k * s) + b @ np.sin(k * s))


def programs(design: rp.CellDesign, scene: Scene) -> dict[str, ours.Step]:
    """Make every loop that can be had for this arm; say which cannot."""
    made = {"pinv loop": ours.pinv_loop(scene), "pink": peers.pink_loop(scene)}
    try:
        made["ssik Tracker"] = peers.ssik_loop(scene)
    except peers.AbsentError as error:
        print(f"ssik Tracker is left out: {error}")
    F = design.function
    return made | {
        "repctl_pin, F": lambda q, target: F(target),
        "repctl_pin, step": ours.repeatable(scene, design.inverse),
    }


def extra_speed(task: rp.Task, Q: np.ndarray) -> float:
    """Measure the joint steps (T, n) over their parts that move the frame, root mean square."""
    steps = np.diff(Q, axis=0)
    J = task.jacobians((Q[1:] + Q[:-1]) / 2)
    least = np.einsum("Knm,Km->Kn", np.linalg.pinv(J), np.einsum("Kmn,Kn->Km", J, steps))
    return float(np.sqrt((steps**2).sum() / (least**2).sum()) - 1)


def main() -> None:
    """Go round and print a row for every program on every arm, the worst of its tours."""
    print(
        "| arm | program | drift, cycle 1 | cycle 10 | extra joint speed | largest step | µs per "
        "query | of pinv |"
    )
    print("|---|---|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for arm in ARMS:
            task = task_of(arm, Path(folder))
            design = cell_design(task, arm)
            found: dict[str, list[tuple[float, ...]]] = {}
            stopped: dict[str, str] = {}
            for seed in range(TOURS):
                path = tour(design.cell, seed)
                targets = [path((k + 1) / STEPS) for k in range(STEPS)]
                q0 = design.function(path(0.0))
                scene = Scene(arm, f"tour {seed}", "on", task, targets, q0, q0)
                loops = programs(design, scene)
                if not seed:
                    times = microseconds(loops, scene)
                    loops = programs(design, scene)  # some go by joints of their own
                for name, step in loops.items():
                    Q, why = joints_of(step, scene, LAPS)
                    stopped |= {name: f"; {why}"} if why else {}
                    drift = np.append(np.linalg.norm(Q[STEPS::STEPS] - Q[0], axis=1), np.nan)
                    last = drift[LAPS - 1] if len(drift) > LAPS else np.nan
                    steps = np.abs(np.diff(Q, axis=0)).max(initial=0.0)
                    found.setdefault(name, []).append((drift[0], last, extra_speed(task, Q), steps))
            for name, rows in found.items():
                first, last, extra, steps = np.max(rows, axis=0)
                ratio = times[name] / times["pinv loop"]
                print(
                    f"| {arm} | {name} | {first:.1g} | {last:.1g} | {100 * extra:.2g} % | "
                    f"{steps:.2g} | "
                    f"{times[name]:.1f} | {ratio:.2f}{stopped.get(name, '')} |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
