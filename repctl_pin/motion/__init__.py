"""Motions of a strategy on closed paths: integration, limits and files.

The modules ``best_leaf``, ``least_start``, ``csv_file`` and ``write_motion`` are not imported here,
because a study does not need them.
"""

from ..model.length import elbow as elbow
from .fitting_circle import fitting_circle as fitting_circle
from .follow import check_length as check_length
from .follow import follow as follow
from .follow import followed as followed
from .follow import unresolved as unresolved
from .joint_motion import violations_of as violations_of
from .leaf_lock import LeafLock as LeafLock
from .least_closed_motion import least_closed_motion as least_closed_motion
from .limits import Limits as Limits
from .motion import Motion as Motion
from .solve_ik import check_reach as check_reach
from .solve_ik import is_reached as is_reached
from .solve_ik import reach_start as reach_start
from .solve_ik import solve_ik as solve_ik
