"""Notes of a study on its motions: path losses, violations, drift, and extra joint speed.

A path loss means that the frame leaves its path. Joint speed is compared with that of J⁺, and with
the minimum over closed motions. The notes are texts that a table prints below its rows.

``Row`` is the result of one strategy in a study: its motion and figures, or why it stopped.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..base.arguments import Array, ratio_in_percent
from ..base.errors import InputError, SingularityError
from ..design import Design
from ..model.task import Task
from ..motion import LeafLock, Motion, followed, least_closed_motion
from ..motion.joint_motion import checked_words, cycle_of
from ..motion.motion import ON_PATH
from ..paths import TaskPath
from ..strategies import Pseudoinverse
from .other_planes import drift_in_other_planes
from .study_result import Row

_EXTRA_SPEED = 0.05
"""Extra joint speed in cycle 1, relative to J⁺, above which a note explains it."""

_POINTS = 32
"""Number of points per cycle of each compared motion."""

_WORTH = 0.05
"""Relative saving in joint speed above which another start is recommended."""


def motion_notes(task: Task, q0: Array, rows: Sequence[Row]) -> list[str]:
    """Collect the notes on the motions of a study from q0 (n,), as texts.

    ``rows`` has one result per controller: J⁺ first, the repeatable one last.
    """
    plain, closed = rows[0].motion, rows[-1].motion
    return [
        *_path_losses(rows),
        *(f"{row.label}: {said}" for row in rows for said in violation_texts(row)),
        *_looked_at(rows),
        *drift_in_other_planes(Pseudoinverse(task), q0, plain),
        *_extra_speed(plain, closed),
    ]


def unlimited_speeds(task: Task) -> list[str]:
    """Make a note that names the joints without a speed limit in the model.

    Their speeds cannot be checked. The list has one text; it is empty if all joints have a limit.
    """
    limits = zip(task.joint_names, task.velocity_limit, strict=True)
    names = [name for name, limit in limits if not np.isfinite(limit)]
    if not names:
        return []
    return [f"no speed limit in the model, so speeds are not checked: {', '.join(names)}"]


def _looked_at(rows: Sequence[Row]) -> list[str]:
    """Make a note per controller whose motion was checked for collisions at its samples only."""
    return [
        f"{row.label}: collisions checked{words}, not between them, because "
        f"{' and '.join(row.motion.clearance.undecided or ())} stay close together"
        for row in rows
        if row.motion is not None and (words := checked_words(row.motion))
    ]


def _path_losses(rows: Sequence[Row]) -> list[str]:
    """Make a note per controller whose frame leaves the path: the cycle and the maximum errors.

    The drift of such a motion is meaningless. ``rows`` has one result per controller.
    """
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


def violation_texts(row: Row) -> list[str]:
    """List the violations of a motion as texts: exceeded joint limits, collisions, speed limits.

    Each text names the joint or the links; the list is empty without violations.
    """
    motion, said = row.motion, [str(violation) for violation in row.violations]
    if motion is not None and (over := motion.worst_overspeed):
        _, joint, ratio = over
        said.append(f"{joint} reaches {ratio:.2g} times its speed limit")
    return said


def _extra_speed(plain: Motion | None, closed: Motion | None) -> list[str]:
    """Make a note if the joint speed of the repeatable motion exceeds that of J⁺ by over 5 %.

    The note splits the extra speed into two parts: one relative to J⁺ at the same configurations,
    and one because J⁺ drifts to configurations where the path needs less joint speed. ``plain`` is
    the motion of J⁺, ``closed`` the repeatable one. The list is empty if the extra joint speed is
    at most 5 %, or if one of the two motions is None or leaves its path.
    """
    if plain is None or closed is None or plain.path_loss or closed.path_loss:
        return []
    extra = closed.first_rms_speed / plain.first_rms_speed - 1
    if extra <= _EXTRA_SPEED:
        return []
    Q, qdot = closed.q[: closed.steps], closed.qdot[: closed.steps]
    J = closed.task.jacobians(Q)
    least = (np.linalg.pinv(J) @ (J @ qdot[:, :, None]))[:, :, 0]
    same = np.sqrt((qdot**2).sum() / (least**2).sum()) - 1
    drift = f"{plain.drift[0]:.2g} {plain.task.unit} in cycle 1"
    rest = f"the rest of {100 * extra:+.1f} % is due to J⁺'s drift of {drift}"
    return [
        f"joint speed: {100 * same:+.1f} % relative to J⁺ at the same configurations; "
        f"{rest}, to configurations in which the path needs less joint speed"
    ]


def least_motion_notes(design: Design, path: TaskPath, q0: Array) -> list[str]:
    """Make the notes that compare a design's motion with closed motions of minimum joint speed.

    The first note compares the joint speed with the minimum from the start q0 (n,). A second one
    follows if another start near it, on its self-motion, needs over 5 % less joint speed than the
    design's motion from q0. The list is empty if the design's motion violates a limit, leaves the
    path or is not closed, or if no closed motion of minimum speed is found.
    """
    lock = LeafLock(4)
    try:
        own = followed(design.inverse, path, q0, cycles=1, steps=_POINTS, integrator=lock)
        if not own.closes or own.path_loss or own.first_violation:
            return []
        least = least_closed_motion(design.task, path, q0, steps=_POINTS, guess=own)
    except (InputError, SingularityError):
        return []
    above = max(own.rms_speed / least.rms_speed - 1, 0.0)
    size = ratio_in_percent(above, 2) if above > 1e-5 else "less than 0.001 %"
    notes = [f"joint speed: {size} above a local minimum of closed motions from this start"]
    saved = 1 - _from_anywhere(least) / own.rms_speed
    if saved > _WORTH:
        notes.append(
            f"another elbow position needs {100 * saved:.0f} % less joint speed; "
            "use --best-leaf speed"
        )
    return notes


def _from_anywhere(least: Motion) -> float:
    """Find the minimum joint speed (rms) of closed motions whose start is optimised, too.

    The search begins at the closed motion ``least``, and moves its start along the self-motion. At
    least half of the joint-limit margin of ``least`` is required. The result is in rad/s or m/s; it
    is infinite if no such motion is found, or if bodies collide in the motion found.
    """
    margin = float(least.limit_margin.min()) / 2
    try:
        found = least_closed_motion(
            least.task,
            least.path,
            least.q[0],
            steps=_POINTS,
            free_start=True,
            limit_margin=margin if 0 < margin < np.inf else 0.0,
            guess=least,
        )
    except (InputError, SingularityError):
        return np.inf
    return found.rms_speed if found.clearance.touch is None else np.inf
