"""Closed paths, and what a strategy does on them."""

from ..robot.length import elbow
from .approach import approach
from .best_leaf import BestLeaf, best_leaf
from .follow import check_length, follow
from .motion import Motion
from .paths import ClosedPath, TaskPath, closed_path
from .polyline import polygon, waypoints
from .shapes import circle, figure_eight, rose
from .solve_ik import check_reach, reach_start, solve_ik
from .timing import TimedMotion, timed
from .waypoint_file import read_waypoints
from .write_motion import write_motion

__all__ = [
    "BestLeaf",
    "ClosedPath",
    "Motion",
    "TaskPath",
    "TimedMotion",
    "approach",
    "best_leaf",
    "check_length",
    "check_reach",
    "circle",
    "closed_path",
    "elbow",
    "figure_eight",
    "follow",
    "polygon",
    "reach_start",
    "read_waypoints",
    "rose",
    "solve_ik",
    "timed",
    "waypoints",
    "write_motion",
]
