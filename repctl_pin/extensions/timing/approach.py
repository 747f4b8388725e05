"""Approach: the movement from the present configuration to a motion, from rest to rest.

n is the number of joints. ``Profile`` is the timing of a few cycles: segments with pauses between
them. ``JointMotion`` is a joint motion over several cycles: q, q̇ (T, n) at times t, without the
path of the frame.
"""

from __future__ import annotations

import warnings
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from ...base.arguments import Array, flag, positive, require_choice, require_type
from ...base.errors import InputError
from ...model.bodies import bodies_of, named_links
from ...model.task import RECOVERABLE, Task
from ...motion.joint_motion import JointMotion
from ...motion.limits import Limits, joint_limits
from ...motion.timed_motion import TimedMotion
from .speed_profile import Profile, fastest, require_possible
from .timing import sampled_profile

_LOOKED_AT = 101
"""Number of points of an approach at which body distances are measured first."""


def approach(
    q_now: ArrayLike,
    motion: JointMotion,
    limits: Limits,
    *,
    to: Literal["start", "nearest"] = "start",
    rate: float = 1000.0,
    bodies: bool = True,
) -> TimedMotion:
    """Time a straight joint-space path from the present configuration to a motion, rest to rest.

    ``q = q_now + a (q_goal − q_now)``, with a from 0 to 1, is traversed as quickly as the limits
    allow. If both ends are within the joint limits, so is the straight path between them. A
    measured joint may exceed its limits by at most 0.1 rad or m; it then moves straight back
    inside, never farther out.

    Parameters
    ----------
    q_now : (n,) array
        Current configuration, rad (m for prismatic joints).
    motion
        Motion to approach.
    limits
        Limits of acceleration and, if given, of speed, jerk, torque and the tool's speed.
    to
        Goal: ``start`` is the motion's first configuration; ``nearest`` is the configuration in the
        motion's first cycle that is nearest to q_now; :class:`Run` can begin there.
    rate
        Samples per second, Hz.
    bodies
        True to check for collisions of the robot with itself or its surroundings along the straight
        path. A warning names links without a shape, whose collisions are not detected.

    Returns
    -------
    TimedMotion
        Motion from q_now to the goal: one traversal of the straight path, without a return.

    Raises
    ------
    InputError
        If q_now exceeds the joint limits by more than 0.1 rad or m, or the goal exceeds them; if
        the arm is at the goal already, or would collide; or if ``limits`` does not fit the robot.

    Examples
    --------
    >>> limits = rp.Limits(acceleration=5.0)  # rad/s²
    >>> way = rp.approach(q0 + 0.2, motion, limits, bodies=False)  # the links have no shapes
    >>> np.allclose(way.q[-1], motion.q[0])
    True
    """
    task = require_type(motion, JointMotion, "motion", "a motion, such as rp.follow makes").task
    bodies = flag(bodies, "bodies")
    rate = positive(rate, "rate", "samples per second")
    kept = joint_limits(task, limits)
    now = task.check(q_now, "q_now", beyond=RECOVERABLE)
    goal = motion.q[0]
    if require_choice(to, ("start", "nearest"), "goal") == "nearest":
        goal = motion.q[np.argmin(np.linalg.norm(motion.q[: motion.steps + 1] - now, axis=1))]
    ends = [now, task.check(goal, f"the motion's {'start' if to == 'start' else 'nearest point'}")]
    begin, end = np.array(ends)
    if np.linalg.norm(end - begin) < 1e-9:
        where = "at the start of the motion" if to == "start" else "on the motion's path"
        raise InputError(f"the arm is {where} already; start the motion without rp.approach()")
    require_possible(np.array([begin, end]), kept, rate)
    line = begin + np.linspace(0, 1, _LOOKED_AT)[:, None] * (end - begin)
    if bodies:
        _check_bodies(task, line)
    segment = fastest(line, kept)
    if kept.jerk is not None:
        from .jerk import with_jerk

        segment = with_jerk(segment, kept)
    ends_of_line = [0, len(line) - 1]
    profile = Profile([segment], [0.0], ends_of_line, ends_of_line, kept)
    return sampled_profile(profile, task.joint_names, 0, rate, kept, 0)


def _check_bodies(task: Task, line: Array) -> None:
    """Raise InputError if bodies collide on a straight joint path: T points ``line`` (T, n).

    Warn of links without a body.
    """
    known = bodies_of(task)
    touch = known._along(line, np.arange(len(line))).touch
    if touch is not None:
        at, (one, other) = touch
        percent = 100 * at / (len(line) - 1)
        raise InputError(
            f"{one!r} and {other!r} collide at {percent:.0f} % of the straight "
            "joint-space path; go through an intermediate configuration, or pass "
            "bodies=False if this collision is not real"
        )
    if known.unchecked:
        lacking = named_links(known.unchecked)
        warnings.warn(
            f"links without a shape are not checked for collisions: {lacking}; "
            "give the missing shapes (package_dirs=)",
            stacklevel=3,
        )
