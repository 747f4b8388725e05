"""Verdict on motions in the terms of the tables: displacement, speed, limits, bodies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from ...model.bodies import bodies_of
from ...model.length import arm_length
from ...motion.displacement import end_displacements
from ...motion.joint_motion import TOO_FAST, JointMotion, cycle_of
from ...motion.motion import ON_PATH, Motion
from ...paths.winding import winding
from .lines import capital
from .numbers import NOTHING, counted, metres, percent, radians
from .parts import part_name

_STILL = 1e-5
"""Displacement of a part, in arm lengths, below which it counts as back at its start."""

SMALL = 0.01
"""Displacement of a part, m, below which it has hardly drifted."""

TURNED = 0.1
"""Displacement of a joint, rad, from which it is named if no part is displaced."""


@dataclass(frozen=True)
class MotionSummary:
    """The quantities of one motion that verdicts and headlines report.

    A verdict does not use the last three, from ``leaves`` on.

    Attributes
    ----------
    label : str
        Name of the controller.
    off : float
        Displacement at the end of the part that is off most, m, see :mod:`.displacement`.
    speed : float
        Joint speed ‖q̇‖ over the first cycle, rms.
    limit_violation : (int, str) or None
        The cycle in which a joint first exceeds its limits, and that joint.
    body_distance : float or None
        Minimum distance between bodies, m; None without bodies.
    collision_cycle : int
        The cycle in which two bodies first collide; 0 if none do.
    speed_ratio : float
        Maximum ratio of a joint's speed to its limit; above 1 the limit is violated.
    joint_displacement : (float, str)
        Maximum displacement of a revolute joint at the end, rad, and that joint; 0 if the motion is
        closed.
    overall_speed : float or None
        Joint speed ‖q̇‖ over all cycles, rms; None for one cycle.
    path_loss : (int, float, float) or None
        The cycle in which the frame leaves its path, and its largest errors, m and rad; None if it
        never does.
    size : float
        Length of the arm, m.
    part : str
        Display name of the part that is displaced most at the end.
    link : str
        That part's link in the URDF.
    hand_off : float
        Distance of the frame from its start at the end, m, in the coordinates that the task
        controls.
    ends : dict of str to float
        Displacement at the end of each other end effector that moves with the arm, m, by link.
    unchecked : int
        Number of bodies without a collision shape, which are not checked for collisions.
    leaves : (int, str) or None
        The cycle in which a joint leaves its range if it drifts on at this rate, and the joint.
    near : tuple of str
        The two links with the minimum body distance; empty without bodies.
    winding : (int, str)
        Number of turns of the path around the axis of the first joint, and that joint.
    """

    label: str
    off: float
    speed: float
    limit_violation: tuple[int, str] | None = None
    body_distance: float | None = None
    collision_cycle: int = 0
    speed_ratio: float = 0.0
    joint_displacement: tuple[float, str] = (0.0, "")
    overall_speed: float | None = None
    path_loss: tuple[int, float, float] | None = None
    size: float = 1.0
    part: str = ""
    link: str = ""
    hand_off: float = 0.0
    ends: Mapping[str, float] = field(default_factory=dict)
    unchecked: int = 0
    leaves: tuple[int, str] | None = None
    near: tuple[str, ...] = ()
    winding: tuple[int, str] = (0, "")

    @property
    def back(self) -> bool:
        """True if every part of the arm is back where it began, within a tenth of a millimetre."""
        return self.off < NOTHING

    @property
    def still(self) -> bool:
        """True if every part is back where it began, within a hundred-thousandth of the arm."""
        return self.off < _STILL * self.size

    @property
    def turned(self) -> bool:
        """True if a joint is displaced although no part is."""
        return self.off < SMALL and self.joint_displacement[0] >= TURNED

    @property
    def twists(self) -> bool:
        """True if a joint turned far although no part moved far.

        The joint turned by at least 0.1 rad, and by more than 1 rad for each tenth of the arm's
        length that the farthest part moved. Or the joint turned and no part moved."""
        angle = self.joint_displacement[0]
        far = angle >= TURNED and angle * self.size > 10 * self.off
        return far or (angle > 0 and self.off < _STILL * self.size)


def motion_summary(
    label: str, motion: JointMotion, moved: tuple[str, float], *, bodies: bool = True
) -> MotionSummary:
    """Extract the quantities of a motion that the verdict reports.

    Parameters
    ----------
    label
        Name of the controller.
    motion
        The motion.
    moved : (str, float)
        The part that is off most at the end, as its link, and how far it is off, m.
    bodies
        True to evaluate body distances. They are wrong if joints outside the task move.
    """
    task, closes = motion.task, motion.closes
    (link, off), first, last = moved, motion.q[0], motion.q[-1]
    hand = task.error(last, task.placements(first))[task.kind.linear]
    violation, coarse = motion.first_violation, motion.coarse
    loss = motion.path_loss if isinstance(motion, Motion) else None
    turned = np.abs(motion.q[-1] - motion.q[0]) * task.revolute * (not closes)  # (n,)
    body_distance, collision = (
        (float(coarse.body_distance.min()), coarse.first_touch)
        if bodies
        else (np.inf, None)
    )
    return MotionSummary(
        label,
        off,
        motion.first_rms_speed,
        None if violation is None else (motion.broken_cycle, violation[1]),
        body_distance if np.isfinite(body_distance) else None,
        0 if collision is None else cycle_of(collision[0], motion.cycles),
        motion.speed_ratio,
        (float(turned.max()), task.joint_names[int(turned.argmax())]),
        motion.rms_speed if motion.cycles > 1 else None,
        None if loss is None else (cycle_of(loss[0], motion.cycles), *loss[1:]),
        arm_length(task, first) or 1.0,
        part_name(task, first, link),
        link,
        float(np.linalg.norm(hand)),
        {
            link: float(d[-1])
            for link, d in end_displacements(task, motion.q[[0, -1]]).items()
        },
        len(bodies_of(task).unchecked) if bodies else 0,
        winding=(winding(task, motion.path), task.joint_names[0])
        if isinstance(motion, Motion)
        else (0, ""),
    )


def without_shape(count: int) -> str:
    """Write how many bodies have no collision shape."""
    return f"{count} {'body' if count == 1 else 'bodies'} without a shape"


def verdict(summaries: Sequence[MotionSummary], cycles: int) -> str:
    """Compare motions in words: the first is the reference, the last the repeatable one.

    Parameters
    ----------
    summaries
        Summary of each motion.
    cycles
        Number of cycles of each.
    """
    times = counted(cycles, "cycle")
    words = []
    if any(summary.path_loss for summary in summaries):
        said = _compared(summaries, [_loss(summary) for summary in summaries])
        words.append(f"End effector: {said}.")
    twists = any(summary.twists for summary in summaries)
    parts = {one.part for one in summaries if not one.still}
    part = parts.pop() if len(parts) == 1 else "" if parts else "farthest part"
    name = f"{capital(part or 'farthest part')}{' and joint' if twists else ''}"
    texts = [_displacement(one, twists, named=not part) for one in summaries]
    words.append(f"{name} displacement after {times}: {_compared(summaries, texts)}.")
    if len(summaries) > 1:
        said = _speeds(summaries[0], summaries[-1], times)
        words.append(f"Joint speed, relative to {_short(summaries[0])}: {said}.")
    too_fast = [summary.speed_ratio > TOO_FAST for summary in summaries]
    if any(too_fast):
        speeds = [
            f"up to {d.speed_ratio:.2g} times the limit" if fast else "respected"
            for d, fast in zip(summaries, too_fast, strict=True)
        ]
        said = _compared(summaries, speeds)
        words.append(f"Speed limits: {said}.")
    limits = [
        f"violated in cycle {d.limit_violation[0]} by {d.limit_violation[1]}"
        if d.limit_violation
        else "respected"
        for d in summaries
    ]
    said = _compared(summaries, limits)
    violated = any(summary.limit_violation for summary in summaries)
    words.append(f"Joint limits: {said}." if violated else "Joint limits respected.")
    if all(summary.body_distance is not None for summary in summaries):
        collides = any(summary.collision_cycle for summary in summaries)
        said = _compared(
            summaries, [_bodies(summary, collides) for summary in summaries]
        )
        words.append(
            f"Body distance: {said}." if collides else f"Minimum body distance: {said}."
        )
    if unchecked := max(summary.unchecked for summary in summaries):
        words.append(f"Collisions not checked: {without_shape(unchecked)}.")
    return " ".join(words)


def _compared(summaries: Sequence[MotionSummary], texts: Sequence[str]) -> str:
    """Join the texts on motions, each labelled by its controller; equal texts are written once."""
    if len(set(texts)) == 1:
        return texts[0]
    return " → ".join(
        f"{text} ({_short(summary)})"
        for summary, text in zip(summaries, texts, strict=True)
    )


def _short(summary: MotionSummary) -> str:
    return summary.label.removeprefix("nearest ")


def _loss(summary: MotionSummary) -> str:
    """Write in which cycle the frame leaves its path, and by how much."""
    if summary.path_loss is None:
        return "on the path"
    cycle, distance, angle = summary.path_loss
    by = [metres(distance)] if distance > ON_PATH * summary.size else []
    by += [f"{angle:.2g} rad"] if angle > ON_PATH else []
    return f"leaves the path in cycle {cycle}, by up to {' and '.join(by)}"


def _speeds(first: MotionSummary, last: MotionSummary, times: str) -> str:
    """Format the joint speed of the last motion relative to the first one.

    It is that of the first cycle and, if it differs, that of all cycles.
    """
    if first.path_loss or last.path_loss:
        return "not compared, since the path is left"
    if not first.speed > 0:
        return "–"
    once = percent(last.speed / first.speed - 1)
    if not (first.overall_speed and last.overall_speed):
        return once
    overall = percent(last.overall_speed / first.overall_speed - 1)
    return once if once == overall else f"{once} in cycle 1, {overall} over {times}"


def _displacement(summary: MotionSummary, twists: bool, *, named: bool) -> str:
    """Format how far the farthest part is off and, if ``twists``, the joint that turned most.

    ``named`` tells whether to name the part.
    """
    moved = "0" if summary.still else metres(summary.off)
    moved += f" ({summary.part})" if named and not summary.still else ""
    angle, name = summary.joint_displacement
    return f"{moved}, {name} {radians(angle)}" if twists and angle > 0 else moved


def _bodies(summary: MotionSummary, collides: bool) -> str:
    if summary.collision_cycle:
        return f"collision in cycle {summary.collision_cycle}"
    distance = metres(summary.body_distance or 0.0)
    return f"minimum {distance}" if collides else distance
