"""Notes of a study: what a user should know of its motions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..arguments import Array
from ..integrability import drift_per_area
from ..motion import Motion
from ..motion.joint_motion import cycle_of
from ..motion.motion import ON_PATH
from ..robot.task import Task
from ..strategies import Pseudoinverse
from .study_result import Row

EXTRA_SPEED = 0.05
"""Extra joint speed in cycle 1, relative to J⁺, above which it is explained."""

LITTLE = 1e-4
"""Drift per cycle that is too small to see, rad or m."""


def motion_notes(task: Task, q0: Array, rows: Sequence[Row]) -> list[str]:
    """Collect the notes on the motions of a study; J⁺ is first, the repeatable controller last."""
    plain, closed = rows[0].motion, rows[-1].motion
    return [
        *_path_losses(rows),
        *_violations(rows),
        *_drift_elsewhere(Pseudoinverse(task), q0, plain),
        *_extra_speed(plain, closed),
    ]


def unlimited_speeds(task: Task) -> list[str]:
    """Name the joints without a speed limit."""
    limits = zip(task.robot_joints, task.joint_limits[2], strict=True)
    names = [name for name, limit in limits if not np.isfinite(limit)]
    if not names:
        return []
    return [f"no speed limit in the URDF, so speeds are not checked: {', '.join(names)}"]


def _path_losses(rows: Sequence[Row]) -> list[str]:
    """Say under which controller the frame leaves its path, when, and by how much."""
    notes: list[str] = []
    for row in rows:
        motion = row.motion
        if motion is None or motion.path_loss is None:
            continue
        when, distance, angle = motion.path_loss
        cycle = cycle_of(when, motion.cycles)
        leaves = f"{row.label}: {motion.task.frame} leaves the path in cycle {cycle}"
        turned = f" and {angle:.2g} rad" if angle > ON_PATH else ""
        why = "the arm is near a singularity, or the steps are too few"
        notes.append(f"{leaves}, by up to {distance:.2g} m{turned}; {why}")
    return notes


def _violations(rows: Sequence[Row]) -> list[str]:
    """Say which joint limits are violated and which bodies collide, under which controller."""
    notes: list[str] = []
    for row in rows:
        motion = row.motion
        if motion is None:
            continue
        notes.extend(f"{row.label}: {violation}" for violation in row.violations)
        if motion.speed_ratio > 1 + 1e-9:
            times = f"{motion.speed_ratio:.2g} times as fast as its limit allows"
            notes.append(f"{row.label}: {motion.fastest_joint} goes {times}")
    return notes


def _drift_elsewhere(plain: Pseudoinverse, q0: Array, motion: Motion | None) -> list[str]:
    """Say in which plane J⁺ drifts, if it hardly does on the path of the study."""
    task = plain.task
    if motion is None or motion.drift[0] > LITTLE or task.m < 3:
        return []
    per_area = drift_per_area(plain, q0)
    a, b = np.unravel_index(int(per_area.argmax()), per_area.shape)
    most = float(per_area[a, b])
    if most < 0.01:
        return []
    plane = "".join("xyz"[k] for k in sorted((a, b)))
    small = f"on small loops in {plane} it drifts by {most:.2g} {task.unit} per m²"
    return [f"J⁺ hardly drifts on this path, but {small}"]


def _extra_speed(plain: Motion | None, closed: Motion | None) -> list[str]:
    """Explain a repeatable motion that is much faster than J⁺: its own cost, and J⁺'s drift."""
    if plain is None or closed is None or plain.path_loss or closed.path_loss:
        return []
    extra = closed.first_rms_speed / plain.first_rms_speed - 1
    if extra <= EXTRA_SPEED:
        return []
    Q, qdot = closed.q[: closed.steps], closed.qdot[: closed.steps]
    J = closed.task.jacobians(Q)
    least = (np.linalg.pinv(J) @ (J @ qdot[:, :, None]))[:, :, 0]
    same = np.sqrt((qdot**2).sum() / (least**2).sum()) - 1
    drift = f"{plain.drift[0]:.2g} {plain.task.unit} in cycle 1"
    rest = f"the rest of {extra:+.1%} is due to J⁺'s drift of {drift}"
    return [
        f"joint speed: {same:+.1%} relative to J⁺ at the same configurations; "
        f"{rest}, to configurations in which the path takes less"
    ]
