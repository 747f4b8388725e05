"""Timing of motions from rest to rest within limits: time-optimal, jerk-limited, and runs.

A motion gives the joint path. Its timing says when each point is passed, as quickly as the limits
of speed, acceleration, jerk and torque allow. A run replays a timed motion with a variable speed.
"""

from ...base.plugins import Extension

EXTENSION = Extension(__name__, parts={"study_row": "timing:with_cycle_time"})
