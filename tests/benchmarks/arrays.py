"""F over a batch in C, NumPy, JAX and torch, as ratios to a frame Jacobian; errors of each.

    python tests/benchmarks/arrays.py [poses]

Processor times in one thread, the minimum of three runs, all in turns. Packages that are not
installed are left out.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from importlib import import_module
from typing import Any

os.environ |= {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
os.environ |= {"XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false"}

import numpy as np
import pinocchio as pin

import repctl_pin as rp

CHUNK = 4096
WORLD = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED


def function() -> rp.InverseFunction:
    task = rp.Robot.load("panda").task("panda_hand_tcp", "pose")
    cell = rp.Cell(task, task.placement(task.reference), 0.05, 0.2)
    options = rp.FitOptions(held_out=64)
    desired = rp.Pseudoinverse(task)
    return rp.nearest_inverse_function(desired, cell, degree=4, options=options).function


def in_chunks(f: Callable[[Any], Any], xp: Any, X: np.ndarray) -> np.ndarray:
    parts = [f(xp.asarray(X[i : i + CHUNK])) for i in range(0, len(X), CHUNK)]
    return np.concatenate([np.asarray(part) for part in parts])


def namespaces() -> dict[str, Any]:
    found = {"NumPy": np}
    for label, name in (("JAX", "jax.numpy"), ("torch", "torch")):
        try:
            found[label] = import_module(name)
        except ImportError:
            print(f"{label} is not installed")
    if "JAX" in found:
        import_module("jax").config.update("jax_enable_x64", True)
    if "torch" in found:
        found["torch"].set_num_threads(1)
    return found


def main(count: int) -> None:
    F = function()
    p, R = F.cell.placements(F.cell.sample(count, seed=58))
    X = np.tile(np.eye(4), (count, 1, 1))
    X[:, :3, :3], X[:, :3, 3] = R, p
    task = F.task
    model, data = task.model, task.model.createData()
    frame, q = model.getFrameId(task.frame), task.reference
    runs: dict[str, Callable[[], Any]] = {
        "Jacobian": lambda: [
            pin.computeFrameJacobian(model, data, q, frame, WORLD) for _ in range(20_000)
        ],
        "C": lambda: F.batch(X, missing="nan"),
    }
    for label, xp in namespaces().items():
        f = rp.arrays.inverse_function(F, xp)
        for kind in (np.float64, np.float32):
            given = X.astype(kind)
            in_chunks(f, xp, given[: 2 * CHUNK])  # compiles
            runs[f"{label} {kind.__name__}"] = lambda f=f, xp=xp, x=given: in_chunks(f, xp, x)
    least, results = dict.fromkeys(runs, np.inf), {}
    for _ in range(3):
        for label, work in runs.items():
            begin = time.process_time()
            results[label] = work()
            least[label] = min(least[label], time.process_time() - begin)
    base = least["Jacobian"] / 20_000
    print(f"{count} poses in chunks of {CHUNK}; a frame Jacobian takes {1e6 * base:.2f} µs")
    for label in list(runs)[1:]:
        off = np.abs(results[label] - results["C"])
        missing = int(np.isnan(results[label][:, 0]).sum())
        ratio = least[label] / count / base
        print(f"| {label} | {ratio:.2f} | {np.nanmax(off):.1e} | {missing} |")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 100_000)
