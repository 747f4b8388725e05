"""Closed paths of a frame; paths of several frames, and waypoints, have modules of their own.

A path is a function of s, which runs from 0 to 1 along a cycle; it does not depend on time.
"""

from . import polynomial_pieces as polynomial_pieces  # paths pickle by their pieces
from .shapes import circle as circle
from .shapes import figure_eight as figure_eight
from .shapes import rose as rose
from .task_path import ClosedPath as ClosedPath
from .task_path import Cycle as Cycle
from .task_path import TaskPath as TaskPath
from .task_path import closed_path as closed_path
