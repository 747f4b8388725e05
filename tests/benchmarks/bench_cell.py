"""What the function of a cell and its control cost, as ratios in one run on one core:

    python -m pytest tests/benchmarks/bench_cell.py -o python_files="bench_*.py" -n 0

Expansion-GRR takes 317 to 494 µs a query on its authors' machine; a frame's Jacobian takes about
0.4 µs on a quiet one, so 40 of them are 16 µs, a twentieth."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from timing import seconds

import repctl_pin as rp

Q0 = np.array([0, -np.pi / 4, 0, -3 * np.pi / 4, 0, np.pi / 2, np.pi / 4])
WORLD = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED


def test_a_pose_and_a_step_beside_frame_jacobians(panda_pose: rp.Task, say) -> None:
    """F at 200 random poses of a cell with rotations; steps along them beside a quadratic
    field's."""
    task, desired = panda_pose, rp.Pseudoinverse(panda_pose)
    cell = rp.Cell(task, task.placement(Q0), 0.05, 0.2)
    found = rp.nearest_inverse_function(
        desired, cell, posture=Q0, degree=3, options=rp.FitOptions(held_out=64)
    )
    quadratic = rp.nearest_repeatable(desired, rp.Polynomial(Q0, 2, 0.4), rp.Box(Q0, 0.2)).inverse
    F, U = found.function, cell.sample(200)
    targets, Q = [cell.at(u) for u in U], F.batch(U)
    near, none = [cell.at(0.99 * u) for u in U], np.zeros(task.r)
    model, data = task.model, task.model.createData()
    frame = model.getFrameId(task.frame, pin.FrameType.BODY)
    loops = {
        "a Jacobian": lambda: [pin.computeFrameJacobian(model, data, Q0, frame, WORLD) for _ in U],
        "F": lambda: [F(x) for x in targets],
        "step": lambda: [
            found.inverse.step(q, x, 0.01, leaf=none) for q, x in zip(Q, near, strict=True)
        ],
        "quadratic step": lambda: [
            quadratic.step(q, x, 0.01, leaf=none) for q, x in zip(Q, near, strict=True)
        ],
    }
    best = dict.fromkeys(loops, np.inf)
    for _ in range(100):  # they take turns, so that a ratio holds on a busy machine too
        for name, loop in loops.items():
            best[name] = min(best[name], 1e6 * seconds(loop, 1) / len(U))
    in_jacobians, beside = best["F"] / best["a Jacobian"], best["step"] / best["quadratic step"]
    times = ", ".join(f"{name} {t:.2f}" for name, t in best.items())
    say(f"µs: {times}; F {in_jacobians:.0f} Jacobians, a step {beside:.1f} times the quadratic's")
    assert in_jacobians < 40 and beside < 6
