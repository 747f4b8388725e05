"""One inverse kinematic function for a whole cell of the workspace: a pose in, the same joints out."""

from .cell import Cell
from .function import InverseFunction
from .nearest import NoFunctionError, nearest_inverse_function
from .result import CellDesign
from .stops import Stop

__all__ = ["Cell", "CellDesign", "InverseFunction", "NoFunctionError", "Stop", "nearest_inverse_function"]
