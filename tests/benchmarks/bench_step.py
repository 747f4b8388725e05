"""What a step of the control loop costs, and how far the joints drift: ours, the usual loops, and pink.

The panda's flange goes round a circle of 0.1 m, 500 steps a cycle, every loop with feed-forward and the same
feedback of the task error. The loops take turns in short bursts and each one's best burst counts, so that
ratios hold on a busy machine too.

    pip install 'repctl-pin[bench]'
    python tests/benchmarks/bench_step.py
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(variable, "1")

import numpy as np  # noqa: E402
import pinocchio as pin  # noqa: E402

import repctl_pin as rp  # noqa: E402
from repctl_pin.show.text.table import table  # noqa: E402

STEPS, PERIOD, CYCLES = 500, 5.0, 10
DT = PERIOD / STEPS
GAIN = 1 / DT
"""1/s: each step undoes the whole task error."""
Q0 = np.array([0, -np.pi / 4, 0, -3 * np.pi / 4, 0, np.pi / 2, np.pi / 4])
WORLD = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED

Step = Callable[[np.ndarray, pin.SE3, np.ndarray], np.ndarray]


def hand_written(task: rp.Task, solve: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> Step:
    """The loop people write: one Jacobian, the placement it leaves behind, one solve."""
    model, data, frame = task.model, task.model.createData(), task.model.getFrameId(task.frame)

    def step(q: np.ndarray, target: pin.SE3, twist: np.ndarray) -> np.ndarray:
        J = pin.computeFrameJacobian(model, data, q, frame, WORLD)
        here = data.oMf[frame]
        e = np.concatenate([target.translation - here.translation, pin.log3(target.rotation @ here.rotation.T)])
        return q + DT * solve(J, twist + GAIN * e)

    return step


def pink_step(task: rp.Task) -> Step:
    """pink's own: a frame task, solved by daqp."""
    import pink
    from pink.tasks import FrameTask

    configuration = pink.Configuration(task.model, task.model.createData(), Q0)
    frame = FrameTask(task.frame, position_cost=1.0, orientation_cost=1.0)

    def step(q: np.ndarray, target: pin.SE3, twist: np.ndarray) -> np.ndarray:
        if q is not configuration.q:
            configuration.update(q)
        frame.set_target(target)
        configuration.integrate_inplace(pink.solve_ik(configuration, [frame], DT, solver="daqp"), DT)
        return configuration.q

    return step


def loops(task: rp.Task) -> dict[str, Step]:
    """Make all the loops."""

    def ours(degree: int) -> Step:
        design = rp.nearest_repeatable(rp.Pseudoinverse(task), rp.Polynomial(Q0, degree, 0.4), rp.Box(Q0, 0.4))
        inverse = design.inverse
        leaf = inverse.leaf(Q0)
        return lambda q, target, twist: inverse.step(q, target, DT, twist, leaf=leaf, gain=GAIN)

    def open_loop(strategy: rp.RepeatableInverse | rp.Pseudoinverse) -> Step:
        return lambda q, target, twist: q + DT * strategy.velocity(q, twist)

    quadratic = rp.nearest_repeatable(rp.Pseudoinverse(task), rp.Polynomial(Q0, 2, 0.4), rp.Box(Q0, 0.4)).inverse
    return {
        "pinv loop": hand_written(task, lambda J, b: np.linalg.pinv(J) @ b),
        "solve(J Jᵀ) loop": hand_written(task, lambda J, b: J.T @ np.linalg.solve(J @ J.T, b)),
        "pink FrameTask (daqp)": pink_step(task),
        "ours, degree 1": ours(1),
        "ours, degree 2": ours(2),
        "ours, degree 3": ours(3),
        "ours, degree 2, no feedback": open_loop(quadratic),
        "our J⁺, no feedback": open_loop(rp.Pseudoinverse(task)),
    }


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=200, help="bursts of 250 steps of each loop (default 200)")
    options = parser.parse_args()
    task = rp.Robot.load("panda").task("panda_hand_tcp", "pose")
    path = rp.circle(task, Q0, 0.1, normal="yz", start_angle=np.pi)
    grid = np.arange(STEPS) / STEPS
    way = [(path.placement(s), path.twist(s) / PERIOD) for s in grid]
    steps = loops(task)

    drift = {}
    for name, step in steps.items():
        q, ends = Q0, []
        for _ in range(CYCLES):
            for target, twist in way:
                q = step(q, target, twist)
            ends.append(np.linalg.norm(q - Q0))
        drift[name] = ends[0], ends[-1]

    best = dict.fromkeys(steps, np.inf)
    jacobian, data, frame = np.inf, task.model.createData(), task.model.getFrameId(task.frame)
    for _ in range(options.rounds):
        for name, step in steps.items():
            q, burst = Q0, way[:250]
            start = time.perf_counter()
            for target, twist in burst:
                q = step(q, target, twist)
            best[name] = min(best[name], (time.perf_counter() - start) / len(burst))
        start = time.perf_counter()
        for _ in range(250):
            pin.computeFrameJacobian(task.model, data, Q0, frame, WORLD)
        jacobian = min(jacobian, (time.perf_counter() - start) / 250)

    base, pink = best["pinv loop"], best["pink FrameTask (daqp)"]
    rows = [
        [name, f"{drift[name][0]:.1e}", f"{drift[name][1]:.1e}", f"{1e6 * t:.1f}", f"{t / base:.2f}", f"{t / pink:.2f}"]
        for name, t in best.items()
    ]
    print(f"panda, pose, {path.name}, {STEPS} steps a cycle; the frame Jacobian alone takes {1e6 * jacobian:.2f} µs\n")
    print(table(["loop", "drift, cycle 1, rad", f"cycle {CYCLES}", "µs a step", "of pinv", "of pink"], rows))


if __name__ == "__main__":
    main()
