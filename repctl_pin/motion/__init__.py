"""Closed paths, and what a strategy does on them."""

from .follow import Motion, follow
from .paths import Path, circle, figure_eight, polygon, read_waypoints, rose, waypoints
from .reach import check_reach, reach

__all__ = [
    "Motion",
    "Path",
    "check_reach",
    "circle",
    "figure_eight",
    "follow",
    "polygon",
    "reach",
    "read_waypoints",
    "rose",
    "waypoints",
]
