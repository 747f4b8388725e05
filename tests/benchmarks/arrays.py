"""F over a batch in C, NumPy, JAX and torch, as ratios to a frame Jacobian; errors of each.

    python tests/benchmarks/arrays.py [poses]

Processor times in one thread, the minimum of three runs, all in turns; one run of more than 100,000
poses. Packages that are not installed are left out.
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

CHUNK, MANY = 4096, 100_000
WORLD = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED


def function() -> rp.InverseFunction:
    task = rp.Robot.load("panda").task("panda_hand_tcp", "pose")
    cell = rp.Cell(task, task.placement(task.reference), 0.05, 0.2)
    options = rp.FitOptions(held_out=64)
    desired = rp.Pseudoinverse(task)
    return rp.nearest_inverse_function(desired, cell, degree=4, options=options).function


def in_chunks(f: Callable[..., Any], xp: Any, X: np.ndarray, C: np.ndarray) -> np.ndarray:
    rows = [slice(i, i + CHUNK) for i in range(0, len(X), CHUNK)]
    parts = [f(xp.asarray(X[each]), xp.asarray(C[each])) for each in rows]
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


def targets(F: rp.InverseFunction, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Random poses, of which one in ten or so lies outside the cell, and leaves."""
    rng = np.random.default_rng(58)
    p, R = F.cell.placements(rng.uniform(-1.02, 1.02, (count, F.cell.k)))
    X = np.tile(np.eye(4), (count, 1, 1))
    X[:, :3, :3], X[:, :3, 3] = R, p
    return X, rng.uniform(-0.5, 0.5, (count, F.task.r))


def derivative_error(F: rp.InverseFunction, f: Any, xp: Any, X: np.ndarray, C: np.ndarray) -> float:
    """Largest error of ∂q along x and c, against central differences of F in C."""
    jvp = import_module("jax").jvp if "jax" in xp.__name__ else xp.func.jvp
    dX, dC = np.zeros_like(X), np.ones_like(C)
    dX[:, :3, 3] = [0.01, -0.02, 0.01]
    _, slope = jvp(f, (xp.asarray(X), xp.asarray(C)), (xp.asarray(dX), xp.asarray(dC)))
    h = 1e-5
    ahead, behind = (F.batch(X + s * dX, leaf=C + s * dC, missing="nan") for s in (h, -h))
    return float(np.nanmax(np.abs(np.asarray(slope) - (ahead - behind) / (2 * h))))


def main(count: int) -> None:
    F = function()
    X, C = targets(F, count)
    task = F.task
    model, data = task.model, task.model.createData()
    frame, q = model.getFrameId(task.frame), task.reference
    runs: dict[str, Callable[[], Any]] = {
        "Jacobian": lambda: [
            pin.computeFrameJacobian(model, data, q, frame, WORLD) for _ in range(20_000)
        ],
        "C": lambda: F.batch(X, leaf=C, missing="nan"),
    }
    slopes = {}
    for label, xp in namespaces().items():
        f = rp.arrays.inverse_function(F, xp)
        if label != "NumPy":
            slopes[f"{label} float64"] = derivative_error(F, f, xp, X[:CHUNK], C[:CHUNK])
        for kind in (np.float64, np.float32):
            given = X.astype(kind), C.astype(kind)
            in_chunks(f, xp, *(each[: 2 * CHUNK] for each in given))  # compiles
            runs[f"{label} {kind.__name__}"] = lambda f=f, xp=xp, at=given: in_chunks(f, xp, *at)
    least, results = dict.fromkeys(runs, np.inf), {}
    for _ in range(3 if count <= MANY else 1):
        for label, work in runs.items():
            begin = time.process_time()
            results[label] = work()
            least[label] = min(least[label], time.process_time() - begin)
    base, missing = least["Jacobian"] / 20_000, np.isnan(results["C"][:, 0])
    print(f"{count} poses in chunks of {CHUNK}; a frame Jacobian takes {1e6 * base:.2f} µs")
    print(f"{missing.sum()} have no configuration in C")
    print("| | time | difference | other poses NaN | derivative |")
    for label in list(runs)[1:]:
        off = np.nanmax(np.abs(results[label] - results["C"]))
        others = int((np.isnan(results[label][:, 0]) != missing).sum())
        ratio, slope = least[label] / count / base, slopes.get(label, np.nan)
        print(f"| {label} | {ratio:.2f} | {off:.1e} | {others} | {slope:.1e} |", flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 100_000)
