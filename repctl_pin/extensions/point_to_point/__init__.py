"""Timed motions through poses of a cell, from rest to rest."""

from ...plugins import Extension

EXTENSION = Extension(
    __name__,
    names={"motion_between": "MotionBetween motion_between"},
    commands={"move": "move_command"},
)
