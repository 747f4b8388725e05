"""Timing of motions: time-optimal from rest to rest within limits, and feed override.

A motion gives the joint path. Its timing gives the time at which each point is passed, as early as
the limits of speed, acceleration, jerk and torque allow. A run executes a timed motion at a speed
that the user can change at any time (feed override).
"""

from ...base.plugins import Extension

EXTENSION = Extension(__name__, parts={"cycle_time": "timing:fastest_cycle"})
