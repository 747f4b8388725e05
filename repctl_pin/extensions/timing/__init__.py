"""Timing of motions from rest to rest within limits: TOPP-RA, jerk, and runs."""

from ...plugins import Extension

EXTENSION = Extension(
    __name__,
    names={"run": "Run", "timing": "approach timed"},
    parts={"study_row": "timing:with_cycle_time"},
)
