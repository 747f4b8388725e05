"""Status codes of a governor's tick."""

from __future__ import annotations

from enum import IntEnum


class Status(IntEnum):
    """Outcome of a tick of :class:`Governor`.

    Attributes
    ----------
    OK
        The target is reached, or the frame has the requested twist.
    SINGULAR
        J_V is singular ahead, or the target is out of reach: the arm stops before it.
    BAD_NUMBER
        A number of the input is not finite or too large, or its matrix is not a rotation: the arm
        stops.
    OUTSIDE
        The region Ω ends ahead: the arm stops before its edge.
    SLOWED
        On the way, as fast as the limits of speed, acceleration and jerk allow.
    LIMIT
        A joint limit is ahead: the arm slows down and stops before it.

    Examples
    --------
    >>> governor = rp.Governor(design.inverse, 0.001, rp.Limits(acceleration=5.0))
    >>> governor.start(q0)
    >>> q, status = governor.step(task.placement(q0))
    >>> status is rp.Status.OK
    True
    """

    OK = 0
    SINGULAR = 1
    BAD_NUMBER = 2
    OUTSIDE = 3
    SLOWED = 4
    LIMIT = 5


BLOCKED = (Status.LIMIT, Status.OUTSIDE, Status.SINGULAR)
"""Outcomes of a tick in which something ahead stops the arm."""
