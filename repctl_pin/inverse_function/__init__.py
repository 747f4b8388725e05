"""Inverse kinematic functions q = F(x) over a cell of the workspace, which give the same
configuration for the same pose."""

from .cell import Cell
from .cell_design import CellDesign
from .failures import FailureReason
from .function import InverseFunction
from .nearest_function import NoFunctionError, nearest_inverse_function
from .sector import Sector

__all__ = [
    "Cell",
    "CellDesign",
    "FailureReason",
    "InverseFunction",
    "NoFunctionError",
    "Sector",
    "nearest_inverse_function",
]
