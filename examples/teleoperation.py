"""Teleoperation of hand and elbow: a synthetic operator drives a panda within all limits.

The operator's hand and elbow go around closed curves and come back; then the joints do, too.
Run: python examples/teleoperation.py [picture.png]
"""

from __future__ import annotations

import sys

import numpy as np
import pinocchio as pin

import repctl_pin as rp

DT, EVERY = 0.004, 5
"""Time step of the loop, s, and ticks between two messages of the tracker."""

CYCLES, PERIOD = 3, 6.0
"""Number of cycles of the operator, and their duration, s."""


def operator(t: float, hand: pin.SE3, elbow: np.ndarray) -> tuple[pin.SE3, np.ndarray]:
    """Return the operator's hand and elbow at time t, s: both have the period of a cycle."""
    a = 2 * np.pi * t / PERIOD
    way = np.array([0.05 * np.sin(a), 0.08 * np.sin(2 * a), 0.05 * (1 - np.cos(a))])
    lift = np.array([0.0, 0.15 * np.sin(a), 0.1 * np.sin(a)])
    return pin.SE3(hand.rotation, hand.translation + way), elbow + lift


def drive(inverse: rp.RepeatableInverse, q0: np.ndarray) -> dict[str, np.ndarray]:
    """Follow the operator for some cycles, then wait at the start; return what happened."""
    task = inverse.task
    governor = rp.Governor(inverse, DT, rp.Limits(acceleration="panda", jerk="panda"), margin=0.02)
    governor.start(q0)
    hand, elbow = task.placement(q0), inverse.elbow(q0)
    log: dict[str, list[object]] = {"t": [], "q": [], "wanted": [], "elbow": []}
    ends = []
    for _ in range(CYCLES):
        for k in range(round((PERIOD + 1.0) / DT)):  # one second at rest after each cycle
            t = min(k * DT, PERIOD)
            if k % EVERY == 0:
                x, point = operator(t, hand, elbow)
                try:  # from a configuration that is a function of x alone
                    begin = inverse.solve(x, q0)
                    leaf = inverse.leaf_toward(begin, elbow=point, margin=0.03).leaf
                except rp.RepctlError:
                    leaf = None  # the last level is kept
            q, _ = governor.step(x, leaf=leaf)
            log["t"].append(DT * len(log["t"]))
            log["q"].append(q)
            log["wanted"].append(point)
            log["elbow"].append(inverse.elbow(q))
        ends.append(q)
    return {name: np.array(values) for name, values in log.items()} | {"ends": np.array(ends)}


def picture(log: dict[str, np.ndarray], file: str) -> None:
    """Draw the elbow beside the operator's, and the joints, over the time."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.5, 5), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True)
    for i, name in enumerate("xyz"):
        (line,) = above.plot(log["t"], 100 * log["elbow"][:, i], label=f"{name}, arm")
        above.plot(log["t"], 100 * log["wanted"][:, i], "--", color=line.get_color(), lw=0.8)
    above.set_ylabel("elbow, cm (dashed: operator)")
    above.legend(loc="center right", fontsize=8)
    below.plot(log["t"], np.degrees(log["q"] - log["q"][0]))
    below.set_ylabel("joints from the start, °")
    below.set_xlabel("t, s")
    figure.savefig(file, dpi=120)


def main() -> None:
    """Design an inverse of a panda, drive it, and print what came back."""
    task = rp.Robot.load("panda").task("panda_hand_tcp", "pose")
    q0 = np.array(task.reference)
    options = rp.FitOptions(samples=256, held_out=64)
    design = rp.nearest_repeatable(
        rp.Pseudoinverse(task), None, rp.Box(q0, 0.5), degree=1, options=options
    )
    # without Ω: the elbow may go farther than the design was made for
    inverse = rp.RepeatableInverse(task, design.inverse.potentials)
    log = drive(inverse, q0)
    travel = np.ptp(log["elbow"], axis=0)
    print(f"the elbow moved by {100 * np.linalg.norm(travel):.0f} cm")
    for cycle, end in enumerate(log["ends"], 1):
        off = np.abs(end - log["ends"][0]).max()
        print(f"cycle {cycle}: the joints are within {off:.1e} rad of those after cycle 1")
    if len(sys.argv) > 1:
        picture(log, sys.argv[1])


if __name__ == "__main__":
    main()
