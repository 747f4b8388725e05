"""Timed motions through poses of a cell, from rest to rest.

A cell is a box of poses over which a function F gives one configuration per pose. So the arm is in
the same configuration whenever it returns to a pose.
"""

from ...base.plugins import Extension

EXTENSION = Extension(__name__, commands={"move": "move_command"})
