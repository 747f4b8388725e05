"""Closed paths, and what a strategy does on them."""

from .best_leaf import BestLeaf, best_leaf
from .elbow import elbow
from .follow import follow
from .motion import Motion
from .paths import Path, circle, figure_eight, polygon, read_waypoints, rose, waypoints
from .reach import check_reach, reach

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
    "read_waypoints",
    "rose",
    "waypoints",
]
