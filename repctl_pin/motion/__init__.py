"""Closed paths, and what a strategy does on them."""

from .best_leaf import BestLeaf, best_leaf
from .elbow import elbow
from .follow import follow
from .motion import Motion
from .paths import Path, circle, figure_eight, polygon, rose, waypoints
from .reach import check_reach, reach, reach_start
from .waypoint_file import read_waypoints

__all__ = [
    "BestLeaf",
    "Motion",
    "Path",
    "best_leaf",
    "check_reach",
    "circle",
    "elbow",
    "figure_eight",
    "follow",
    "polygon",
    "reach",
    "reach_start",
    "read_waypoints",
    "rose",
    "waypoints",
]
