"""Closed paths of a frame: shapes, waypoints, polylines and orientations."""

from .pieces import pieces_of as pieces_of
from .task_path import Cycle as Cycle
