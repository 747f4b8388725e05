"""Functions q = F(x) over a cell of poses: one configuration for each pose."""

from ...base.plugins import Extension

EXTENSION = Extension(
    __name__,
    commands={"cell": "cell_command"},
    files={"repctl cell": "cell_file"},
    parts={"problem": "cell_design_result:PROBLEM"},
)
