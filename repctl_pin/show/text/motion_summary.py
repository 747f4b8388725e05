"""Summaries of motions, for headlines and tables: displacement, speed, limits, bodies.

The displacement of a part of the arm is the distance between its positions at the start and at the
end of all cycles. The outlook is the cycle in which a joint leaves its range if every further cycle
drifts like the last one. A chain consists of the joints that move one frame. Cycles are counted
from 1; joints and links are given by name.

``JointMotion`` is a joint motion over several cycles: q, q̇ (T, n) at times t, without the path of
the frame. ``MotionSummary`` is the quantities of one motion that headlines and short tables report.
``Row`` is the result of one strategy in a study: its motion and figures, or why it stopped.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ...model.bodies import bodies_of
from ...model.length import arm_length
from ...motion.body_displacement import end_displacements, farthest_link
from ...motion.joint_motion import JointMotion, checked_words, cycle_of
from ...motion.limit_prediction import leaves_range
from ...motion.motion import Motion
from ...paths.winding import winding
from ...studies.study_result import Row
from .numbers import NOTHING
from .part_names import part_name

SMALL = 0.01
"""Displacement of a part, m, below which it has hardly drifted."""

TURNED = 0.1
"""Displacement of a joint, rad, from which it is named if no part is displaced."""


@dataclass(frozen=True)
class MotionSummary:
    """The quantities of one motion that headlines and short tables report.

    Attributes
    ----------
    label : str
        Name of the controller.
    off : float
        Displacement of the most displaced part at the end, m.
    speed : float
        Joint speed ‖q̇‖ over the first cycle, rms, rad/s or m/s.
    mean_speed : float
        Joint speed over all cycles, rms, rad/s or m/s.
    limit_violation : (int, str) or None
        The cycle in which a joint first exceeds its limits, and that joint.
    body_distance : float or None
        Minimum distance between bodies, m; None without bodies.
    collision : (int, (str, str)) or None
        The cycle in which two bodies first collide, and their two links.
    overspeed : (int, str, float) or None
        The largest violation of a speed limit: its cycle, the joint, and the ratio of its speed to
        the limit; None if no speed limit is violated.
    joint_displacement : (float, str)
        Maximum displacement of a revolute joint at the end, rad, and that joint; 0 if the motion is
        closed.
    path_loss : (int, float, float) or None
        The cycle in which the frame leaves its path, and the largest errors of the frame in the
        whole motion, m and rad; None if the frame never leaves its path.
    size : float
        Length of the arm, m: the sum of the distances between successive revolute joints, and from
        the last of them to the frame; 1 without revolute joints.
    part : str
        Display name of the part that is displaced most at the end.
    link : str
        That part's link in the URDF.
    hand_off : float
        Distance between the positions of the frame at the start and at the end, m. Only position
        coordinates that the task controls count.
    ends : dict of str to float
        Displacement at the end of each other end effector that moves with the arm, m, by link.
    checked : str
        Text that follows the minimum body distance, and says at how many points of the motion
        bodies were checked; empty if the distance is the minimum over the whole motion.
    unchecked : str
        Text on the bodies that are not checked for collisions, see :attr:`.Bodies.not_checked`.
    leaves : (int, str) or None
        The cycle in which a joint leaves its range if every further cycle drifts like the last
        one, and the joint.
    near : tuple of str
        The two links with the minimum body distance; empty without bodies.
    winding : (int, str)
        Number of turns of the path around the axis of the first joint, and that joint.
    speeds_checked : bool
        True if every joint has a speed limit in the model, and the times of the motion are known.
    """

    label: str
    off: float
    speed: float
    mean_speed: float
    limit_violation: tuple[int, str] | None = None
    body_distance: float | None = None
    collision: tuple[int, tuple[str, str]] | None = None
    overspeed: tuple[int, str, float] | None = None
    joint_displacement: tuple[float, str] = (0.0, "")
    path_loss: tuple[int, float, float] | None = None
    size: float = 1.0
    part: str = ""
    link: str = ""
    hand_off: float = 0.0
    ends: Mapping[str, float] = field(default_factory=dict)
    checked: str = ""
    unchecked: str = ""
    leaves: tuple[int, str] | None = None
    near: tuple[str, ...] = ()
    winding: tuple[int, str] = (0, "")
    speeds_checked: bool = True

    @property
    def back(self) -> bool:
        """True if every part of the arm ends within 0.1 mm of where it began."""
        return self.off < NOTHING

    @property
    def turned(self) -> bool:
        """True if no part is displaced by 1 cm or more, but a revolute joint by 0.1 rad or more.

        A headline then names the joint instead of a part.
        """
        return self.off < SMALL and self.joint_displacement[0] >= TURNED


def motion_summary(
    label: str, motion: JointMotion, moved: tuple[str, float], *, bodies: bool = True
) -> MotionSummary:
    """Summarise a motion, without its outlook, which :func:`with_outlook` adds.

    Parameters
    ----------
    label
        Name of the controller.
    motion
        The motion.
    moved : (str, float)
        Link of the most displaced part at the end, and its displacement, m.
    bodies
        True to evaluate body distances; they are valid only if no joint outside the task moves.
    """
    task, closes = motion.task, motion.closes
    (link, off), first, last = moved, motion.q[0], motion.q[-1]
    hand = task.error(last, task.placements(first))[task.kind.linear]
    loss = motion.path_loss if isinstance(motion, Motion) else None
    turned = np.abs(motion.q[-1] - motion.q[0]) * task.revolute * (not closes)  # (n,)
    body_distance, collision = (
        (motion.clearance.distance, motion.first_touch) if bodies else (np.inf, None)
    )
    return MotionSummary(
        label,
        off,
        motion.first_rms_speed,
        motion.rms_speed,
        in_cycle(motion.first_violation, motion.cycles),
        body_distance if np.isfinite(body_distance) else None,
        in_cycle(collision, motion.cycles),
        in_cycle(motion.worst_overspeed, motion.cycles),
        (float(turned.max()), task.joint_names[int(turned.argmax())]),
        in_cycle(loss, motion.cycles),
        arm_length(task, first) or 1.0,
        part_name(task, first, link),
        link,
        float(np.linalg.norm(hand)),
        {link: float(d[-1]) for link, d in end_displacements(task, motion.q[[0, -1]]).items()},
        checked=checked_words(motion) if bodies else "",
        unchecked=bodies_of(task).not_checked if bodies else "",
        winding=winding(task, motion.path) if isinstance(motion, Motion) else (0, ""),
        speeds_checked=bool(np.isfinite(task.velocity_limit).all()),
    )


def in_cycle(event: tuple[Any, ...] | None, cycles: int) -> Any:
    """Replace the first entry of an event, a time in cycles, by its cycle's number; None stays."""
    return None if event is None else (cycle_of(event[0], cycles), *event[1:])


def with_outlook(summary: MotionSummary, played: Sequence[JointMotion]) -> MotionSummary:
    """Return a copy of a summary with its attributes ``leaves`` and ``near`` set.

    ``leaves`` is the outlook, the earliest of all chains. ``near`` has the two links with the
    minimum body distance; it is empty if the summary has no body distance.

    Parameters
    ----------
    summary
        Summary of the motion.
    played
        The same motion, split into the motions of the joints of each chain.
    """
    found = [leaves for leaves in map(leaves_range, played) if leaves is not None]
    near = () if summary.body_distance is None else played[0].clearance.links
    return replace(summary, leaves=min(found, default=None), near=near)


def row_summary(row: Row) -> MotionSummary | None:
    """Summarise the motion of one controller in a study, for its headline; None if it stopped."""
    motion = row.motion
    if motion is None:
        return None
    moved = farthest_link(motion)
    return with_outlook(motion_summary(row.label, motion, moved), [motion])
