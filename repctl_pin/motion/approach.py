"""The approach: from where the arm is to where its cycle begins."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..arguments import flag, positive, wanted
from ..errors import InputError
from ..robot.bodies import bodies_of
from .motion import Motion
from .timing import TimedMotion, limits_of, rest_to_rest

_POINTS = 101


def approach(
    q_now: ArrayLike,
    motion: Motion,
    *,
    acceleration: ArrayLike | str | None = None,
    velocity: ArrayLike | None = None,
    torque: bool = False,
    rate: float = 1000.0,
    bodies: bool = True,
) -> TimedMotion:
    """Move the joints straight, from rest to rest, from where the arm is to the start of a motion.

    ``q(s) = q_now + s (q_start − q_now)``, as quickly as the limits allow. Both ends are inside the joint limits,
    hence so is all between.

    Parameters
    ----------
    q_now : (n,) array
        Where the arm is, rad (m for sliding joints).
    motion
        Its first configuration is the goal.
    acceleration : float or (n,) array, or str
        rad/s² (m/s²), as :func:`timed` takes it.
    velocity : float or (n,) array, optional
        rad/s (m/s); by default the URDF's.
    torque, rate
        As :func:`timed` takes them.
    bodies
        Check that the robot does not touch itself, or its surroundings, on the way.

    Returns
    -------
    TimedMotion
        Of one cycle: there, not back.

    Raises
    ------
    InputError
        If q_now or the start is outside the joint limits, the arm is there already or would touch itself, or a limit
        cannot be used.

    Examples
    --------
    >>> way = rp.approach(q0 + 0.2, motion, acceleration=5.0)
    >>> np.allclose(way.q[-1], motion.q[0])
    True
    """
    task = wanted(motion, Motion, "motion", "a motion, such as rp.follow makes").task
    bodies = flag(bodies, "bodies")
    limits = limits_of(task, velocity, acceleration, torque=flag(torque, "torque"))
    ends = [task.check(q_now, "q_now"), task.check(motion.q[0], "the motion's start")]
    begin, end = motion.joints(np.array(ends))
    if np.linalg.norm(end - begin) < 1e-9:
        raise InputError("the arm is at the start of the motion already; there is nothing to approach")
    share = np.linspace(0, 1, _POINTS)[:, None]
    if bodies:
        straight = ends[0] + share * (ends[1] - ends[0])
        known = bodies_of(task)
        distances = known.distances(straight)
        if distances[at := int(np.argmin(distances))] < 0:
            one, other = known.nearest(straight[at]).links
            raise InputError(
                f"on the straight way {one!r} and {other!r} touch, {share[at, 0]:.0%} of it done: go round by another "
                "configuration, or give bodies=False if they do not"
            )
    line = begin + share * (end - begin)
    return rest_to_rest(line, task.robot_joints, positive(rate, "rate", "samples per second"), limits)
