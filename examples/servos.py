"""Simulate ten cycles with lagging servos, noisy encoders and a push at the elbow.

MuJoCo simulates the dynamics of a panda. Each joint has a position servo, soft enough to lag and to
sag under gravity; the controller reads encoders with noise and runs at 500 Hz. In the fourth cycle,
a force of 30 N pushes the elbow for 0.2 s.

1. *Velocity control by J⁺.* q̇ = J⁺ (ẋ + K e): the end effector follows its path, but the elbow
   drifts, and the displacement by the push remains.
2. *The nearest repeatable inverse with the leaf lock.* The gains are the same; the step also feeds
   back c − h(q).

`torques.py` controls the same arm by torques instead. Requires MuJoCo: pip install mujoco.

    python examples/servos.py
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from pushed_arm import DT, PushedArm, designed, page

import repctl_pin as rp
from repctl_pin.base.files import prepare_folder, write_whole
from repctl_pin.show.palette import COLOURS

PERIOD, CYCLES = 4.0, 10
"""Duration of a cycle, s, and number of cycles."""

NOISE = 2e-5
"""Standard deviation of the encoder noise, rad."""

GAIN = 10.0
"""Feedback gain K of the task error, 1/s."""

PUSH_CYCLE = 4
"""Cycle in which the elbow is pushed."""

FORCE, SECONDS = 30.0, 0.2
"""Force and duration of the push, N and s."""

Control = Callable[[np.ndarray, float], np.ndarray]
"""A function (measured q, fraction of the cycle) → q̇."""


def ten_cycles(task: rp.Task, path: rp.TaskPath, q0: np.ndarray, control: Control) -> np.ndarray:
    """Simulate a controller with servos; return q after every step (T + 1, n)."""
    arm, noise = PushedArm(task, q0, servos=True), np.random.default_rng(1)
    q, command, visited = q0.copy(), q0.copy(), [q0]
    steps = round(PERIOD / DT)
    for k in range(CYCLES * steps):
        measured = q + NOISE * noise.normal(size=task.n)
        command = command + DT * control(measured, (k % steps) / steps)
        since = k * DT - (PUSH_CYCLE - 1) * PERIOD
        q = arm.step(command, FORCE if 0 <= since < SECONDS else 0.0)
        visited.append(q)
    return np.array(visited)


def controls(design: rp.Design, path: rp.TaskPath, q0: np.ndarray) -> dict[str, Control]:
    """Make the controllers J⁺ and nearest repeatable, with the same feedback of the task error."""
    task, inverse, plain = design.task, design.inverse, design.desired
    leaf = inverse.leaf(q0)

    def pseudoinverse(q: np.ndarray, s: float) -> np.ndarray:
        xdot = path.twist(s)[task.rows] / PERIOD
        return plain.velocity(q, xdot + GAIN * task.error(q, path.placement(s)))

    def repeatable(q: np.ndarray, s: float) -> np.ndarray:
        twist = path.twist(s) / PERIOD
        return (inverse.step(q, path.placement(s), DT, twist, leaf=leaf, gain=GAIN) - q) / DT

    return {"J⁺": pseudoinverse, "nearest repeatable": repeatable}


def main() -> dict[str, np.ndarray]:
    """Print the displacements; return those at the end of each cycle, relative to the end of
    cycle 2."""
    design = designed()
    task = design.task
    q0 = np.array(task.reference)
    path = rp.circle(task, q0, radius=0.1, normal="x")
    print(
        f"{CYCLES} cycles with servos; "
        f"a push of {FORCE:g} N for {SECONDS:g} s in cycle {PUSH_CYCLE}\n"
        "‖q − q(end of cycle 2)‖ at the end of cycles 3, 4, 5 and 10, rad:"
    )
    found, moved = {}, {}
    for name, control in controls(design, path, q0).items():
        moved[name] = ten_cycles(task, path, q0, control)
        ends = moved[name][:: round(PERIOD / DT)]
        off = found[name] = np.linalg.norm(ends - ends[2], axis=1)
        shown = ", ".join(f"{off[k]:.2f}" if off[k] > 1e-4 else "< 1e-4" for k in (3, 4, 5, 10))
        print(f"  {name:19s} {shown}")
    colours = [COLOURS["pseudoinverse"], COLOURS["repeatable"]]
    html = page(task, moved, colours, CYCLES, path.name)
    print(f"wrote {write_whole(prepare_folder(Path('repctl-out')) / 'servos.html', html)}")
    return found


if __name__ == "__main__":
    found = main()
