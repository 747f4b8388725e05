"""Teleoperation of hand and elbow: a synthetic operator drives two arms within all limits.

The operator's hand and elbow go around closed curves and come back; then the joints do, too.
Run: python examples/teleoperation.py
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin

import repctl_pin as rp

DT, EVERY = 0.004, 5
"""Time step of the loop, s, and ticks between two messages of the tracker."""

CYCLES, PERIOD = 3, 6.0
"""Number of cycles of the operator, and their duration, s."""

OUT = Path("repctl-out/teleoperation.png")


def operator(t: float) -> tuple[pin.SE3, np.ndarray]:
    """Return the operator's hand and elbow at time t, s, in the frame of the tracker."""
    a = 2 * np.pi * t / PERIOD
    way = np.array([0.06 * np.sin(a), 0.1 * np.sin(2 * a), 0.06 * (1 - np.cos(a))])
    lift = np.array([0.0, 0.18 * np.sin(a), 0.12 * np.sin(a)])
    return pin.SE3(np.eye(3), np.array([0.4, 0.2, 1.1]) + way), np.array([0.1, 0.4, 1.0]) + lift


def arms() -> dict[str, tuple[rp.Task, np.ndarray, rp.Limits]]:
    """Load a panda, and the left arm of the humanoid talos; with their starts and limits."""
    panda = rp.Robot.load("panda").task("panda_hand_tcp", "pose")
    talos = rp.Robot.load("talos", base="torso_2_link").task("wrist_left_ft_tool_link", "pose")
    return {
        "panda": (panda, np.array(panda.reference), rp.Limits(acceleration="panda", jerk="panda")),
        "talos": (
            talos,
            np.array([0.2, 0.5, 0.0, -1.4, 0.0, 0.0, 0.1]),
            rp.Limits(acceleration=5.0, jerk=500.0),
        ),
    }


def designed(task: rp.Task, q0: np.ndarray) -> rp.RepeatableInverse:
    """Design the repeatable inverse nearest to J⁺ around the start."""
    options = rp.FitOptions(samples=256, held_out=64)
    design = rp.nearest_repeatable(
        rp.Pseudoinverse(task), None, rp.Box(q0, 0.5), degree=1, options=options
    )
    # without Ω: the elbow may go farther than the design was made for
    return rp.RepeatableInverse(task, design.inverse.potentials)


def drive(
    inverse: rp.RepeatableInverse, q0: np.ndarray, limits: rp.Limits
) -> dict[str, np.ndarray]:
    """Follow the operator for some cycles, with one second at rest after each."""
    task = inverse.task
    governor = rp.Governor(inverse, DT, limits, margin=0.02)
    governor.start(q0)

    # engaged, hand and elbow of the arm move 0.8 times as far as those of the operator
    clutch = rp.Clutch(scale=0.8)
    hand, elbow = operator(0.0)
    clutch.engage(hand, task.placement(q0), elbow=elbow, elbow_at=inverse.elbow(q0))
    log: dict[str, list[object]] = {name: [] for name in ("q", "wanted", "elbow", "ends")}
    failures = 0
    for _ in range(CYCLES):
        for k in range(round((PERIOD + 1.0) / DT)):
            if k % EVERY == 0:
                hand, elbow = operator(min(k * DT, PERIOD))
                x, point = clutch.target(hand), clutch.elbow(elbow)
                try:  # from a configuration that is a function of x alone
                    begin = inverse.solve(x, q0)
                    leaf = inverse.leaf_toward(begin, elbow=point, margin=0.03).leaf
                except rp.RepctlError:
                    leaf, failures = None, failures + 1  # the last level is kept
            q, _ = governor.step(x, leaf=leaf)
            log["q"].append(q)
            log["wanted"].append(point)
            log["elbow"].append(inverse.elbow(q))
        log["ends"].append(q)
    return {name: np.array(values) for name, values in log.items()} | {"failures": failures}


def picture(logs: dict[str, dict[str, np.ndarray]]) -> None:
    """Draw the elbows beside that of the operator, and the joints, over the time."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 5), layout="constrained")
    axes = figure.subplots(2, len(logs), sharex=True, sharey="row")
    for (name, log), (above, below) in zip(logs.items(), axes.T, strict=True):
        t = DT * np.arange(len(log["q"]))
        for i, axis in enumerate("xyz"):
            start = log["wanted"][0, i]
            (line,) = above.plot(t, 100 * (log["elbow"][:, i] - start), label=axis)
            way = 100 * (log["wanted"][:, i] - start)
            above.plot(t, way, "--", color=line.get_color(), lw=0.8)
        above.set_title(name)
        below.plot(t, np.degrees(log["q"] - log["q"][0]))
        below.set_xlabel("t, s")
    axes[0, 0].set_ylabel("elbow from the start, cm")
    axes[1, 0].set_ylabel("joints from the start, °")
    above.plot([], [], "k--", lw=0.8, label="operator")
    lines, labels = above.get_legend_handles_labels()
    figure.legend(lines, labels, loc="outside upper center", ncols=4, frameon=False)
    OUT.parent.mkdir(exist_ok=True)
    figure.savefig(OUT, dpi=100)


def main() -> None:
    """Drive both arms, and print what came back."""
    logs = {}
    for name, (task, q0, limits) in arms().items():
        log = logs[name] = drive(designed(task, q0), q0, limits)
        travel = np.linalg.norm(np.ptp(log["elbow"], axis=0))
        off = np.abs(log["ends"] - log["ends"][0]).max()
        print(f"{name}: the elbow moved by {100 * travel:.0f} cm; after each cycle,")
        print(f"    the joints were within {off:.0e} rad of those after the first one")
        print(f"    messages of the tracker without a level: {log['failures']}")
    picture(logs)
    print(f"wrote {OUT}")


if __name__ == "__main__":
    main()
