"""Functions q = F(x) over a cell of poses: one configuration for each pose."""

from ...base.plugins import Extension

EXTENSION = Extension(
    __name__,
    names={
        "place.best_cell": "BestCell best_cell",
        "geometry.cell": "Cell",
        "cell_design": "CellDesign",
        "cell_file": "load_cell",
        "function": "InverseFunction",
        "fit.nearest_function": "NoFunctionError nearest_inverse_function",
        "geometry.sector": "Sector",
    },
    commands={"cell": "cell_command"},
    files={"repctl cell": "cell_file"},
    parts={"problem": "cell_design:PROBLEM"},
)
