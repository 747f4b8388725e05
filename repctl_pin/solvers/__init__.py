"""Numerical methods that do not depend on robots.

These are Newton's method, Levenberg–Marquardt, descent in a box, and block-tridiagonal systems.
"""

from .block_tridiagonal import solve_block_tridiagonal
from .box_descent import StepLengths, descend_in_box
from .levenberg_marquardt import Damping, Point, Step, levenberg_marquardt
from .newton import newton, newton_rows

__all__ = [
    "Damping",
    "Point",
    "Step",
    "StepLengths",
    "descend_in_box",
    "levenberg_marquardt",
    "newton",
    "newton_rows",
    "solve_block_tridiagonal",
]
