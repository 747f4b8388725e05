"""Test a third-party controller: is the differential inverse kinematics of pink repeatable?

`rp.follow` takes any function (q, ẋ) → q̇. Here the function calls pink, with a frame task whose
target is ẋ dt ahead; daqp solves the quadratic program. The end effector of the panda follows a
circle of 0.1 m for ten cycles, from the same start, under three controllers:

    pink               the frame task alone: it drifts like the pseudoinverse, cycle after cycle
    J⁺                 the pseudoinverse, for comparison
    pink + repeatable  the frame task and a RepeatableTask, which holds h(q) = c: closed

You can test a loop of roboticstoolbox, Drake or mink in the same way: write the function, call
rp.follow.

    pip install '.[pink]' daqp
    python examples/audit_pink.py
"""

from __future__ import annotations

import argparse
from collections.abc import Callable

import numpy as np
import pink
import pinocchio as pin
from pink.tasks import FrameTask

import repctl_pin as rp
from repctl_pin.extensions.integrations.pink import RepeatableTask
from repctl_pin.show.text.table import table

Q0 = np.array([0, -np.pi / 4, 0, -3 * np.pi / 4, 0, np.pi / 2, np.pi / 4])
DT = 0.01


def pink_control(
    task: rp.Task, *extra: RepeatableTask
) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """Make a function (q, ẋ) → q̇ that calls pink for the velocity of the frame."""
    configuration = pink.Configuration(task.model, task.model.createData(), Q0)
    frame = FrameTask(task.frame, position_cost=1.0, orientation_cost=1.0)
    for other in extra:
        other.set_target_from_configuration(configuration)

    def velocity(q: np.ndarray, xdot: np.ndarray) -> np.ndarray:
        configuration.update(q)
        here = configuration.get_transform_frame_to_world(task.frame)
        there = pin.SE3(pin.exp3(DT * xdot[3:]) @ here.rotation, here.translation + DT * xdot[:3])
        frame.set_target(there)
        return pink.solve_ik(configuration, [frame, *extra], DT, solver="daqp")

    return velocity


def audit(cycles: int, steps: int) -> dict[str, rp.Motion]:
    """Follow the circle with each controller, by Euler steps with feedback of the task error."""
    task = rp.Robot.load("panda").task("panda_hand_tcp", "pose")
    design = rp.nearest_repeatable(
        rp.Pseudoinverse(task), rp.Polynomial(Q0, 2, 0.4), rp.Box(Q0, 0.4)
    )
    path = rp.circle(task, Q0, 0.1, normal="yz", start_angle=np.pi)
    controls = {
        "pink": pink_control(task),
        "J⁺": rp.Pseudoinverse(task),
        "pink + repeatable": pink_control(task, RepeatableTask(design.inverse)),
    }
    options = {
        "cycles": cycles,
        "steps": steps,
        "period": steps * DT,
        "integrator": "euler",
        "feedback": 20.0,
    }
    return {
        name: rp.follow(control, path, Q0, task=task, **options)
        for name, control in controls.items()
    }


def main() -> None:
    """Print drift, tracking error and peak speed of each controller."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cycles", type=int, default=10)
    parser.add_argument("--steps", type=int, default=500, help="steps per cycle")
    options = parser.parse_args()
    rows = [
        [
            name,
            f"{m.drift[0]:.2e}",
            f"{m.drift[-1]:.2e}",
            f"{m.tracking_error.max():.1e}",
            f"{m.peak_speed:.2f}",
        ]
        for name, m in audit(options.cycles, options.steps).items()
    ]
    header = [
        "controller",
        "drift, cycle 1, rad",
        f"cycle {options.cycles}",
        "tracking error, m",
        "peak speed, rad/s",
    ]
    print(table(header, rows))


if __name__ == "__main__":
    main()
