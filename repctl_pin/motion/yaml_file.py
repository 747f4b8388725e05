"""A motion as robots take it: with the velocities of its control, and as ROS's JointTrajectory in YAML."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..arguments import Array
from ..strategies import Strategy
from .motion import Motion
from .timing import TimedMotion


def commanded(motion: Motion, strategy: Strategy) -> Motion:
    """Give a motion the velocities ``q̇ = G ẋ`` of its strategy at its points, in place of the steps' means."""
    period = (motion.t[-1] - motion.t[0]) / motion.cycles
    ends = (motion.t - motion.t[0]) / period % 1.0
    task = motion.task
    Qdot = [
        strategy.velocity(q, task.rate(q, motion.path.twist(min(float(s), 1.0 - 1e-12))) / period)
        for q, s in zip(motion.q, ends, strict=True)
    ]
    return replace(motion, qdot=np.array(Qdot))


def yaml_text(motion: Motion | TimedMotion) -> str:
    """Write ROS 2's ``trajectory_msgs/msg/JointTrajectory``, as ``ros2 topic pub`` and controllers take it.

    With accelerations where the motion is timed.
    """
    if isinstance(motion, TimedMotion):
        names, t = motion.joints, motion.t
        rows = {"positions": motion.q, "velocities": motion.qdot, "accelerations": motion.qddot}
    else:
        names, t = motion.task.robot_joints, motion.t - motion.t[0]
        rows = {"positions": motion.joints(motion.q), "velocities": motion.joints(motion.qdot)}
    lines = ["header:", "  stamp: {sec: 0, nanosec: 0}", "  frame_id: ''"]
    lines.append("joint_names: [" + ", ".join(_quoted(name) for name in names) + "]")
    lines.append("points:")
    for moment, *values in zip(t, *rows.values(), strict=True):
        nanoseconds = round(float(moment) * 1e9)
        said = [f"  {what}: {_row(row)}" for what, row in zip(rows, values, strict=True)]
        said.append(f"  time_from_start: {{sec: {nanoseconds // 10**9}, nanosec: {nanoseconds % 10**9}}}")
        lines += ["-" + said[0][1:], *said[1:]]
    return "\n".join(lines) + "\n"


def _row(values: Array) -> str:
    return "[" + ", ".join(f"{v:.12f}" for v in values) + "]"


def _quoted(name: str) -> str:
    """Quote a name for YAML, which folds the ends of lines where they are not written as escapes."""
    if name.isprintable():
        return "'" + name.replace("'", "''") + "'"
    plain = (c if c.isprintable() and c not in '"\\' else f"\\U{ord(c):08x}" for c in name)
    return '"' + "".join(plain) + '"'
