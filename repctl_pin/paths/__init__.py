"""Closed paths of a frame: shapes, waypoints, polylines and orientations."""

from .pieces import pieces_of as pieces_of
from .polyline import Waypoints as Waypoints
from .polyline import polygon as polygon
from .polyline import waypoints as waypoints
from .shapes import circle as circle
from .shapes import figure_eight as figure_eight
from .shapes import rose as rose
from .task_path import ClosedPath as ClosedPath
from .task_path import Cycle as Cycle
from .task_path import TaskPath as TaskPath
from .task_path import closed_path as closed_path
from .waypoint_file import read_waypoints as read_waypoints
