"""Fastest first cycle of each motion of a study."""

from __future__ import annotations

from dataclasses import replace

from ...errors import InputError
from ...motion.limits import Limits, presumed_acceleration
from ...motion.motion import Motion
from ...studies.study_result import Row
from .timing import timed


def with_cycle_time(row: Row) -> Row:
    """Add the minimum time of the motion's first cycle to a row of a study."""
    if row.motion is None:
        return row
    return replace(row, cycle_time=_fastest_cycle(row.motion))


def _fastest_cycle(motion: Motion) -> float | None:
    """Compute the minimum time of the first cycle from rest to rest, s; None without a solution."""
    end = motion.steps + 1
    once = replace(
        motion, cycles=1, t=motion.t[:end], q=motion.q[:end], qdot=motion.qdot[:end]
    )
    acceleration = presumed_acceleration(motion.task)[0]
    try:
        return timed(once, Limits(acceleration=acceleration)).duration
    except InputError:  # it does not move, or no speed is slow enough
        return None
