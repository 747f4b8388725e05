"""Studies: comparison of all strategies on one arm and one closed path."""

from .study import study
from .study_result import Row, Study, bodies_dict, limits_dict, picked, region_dict

__all__ = [
    "Row",
    "Study",
    "bodies_dict",
    "limits_dict",
    "picked",
    "region_dict",
    "study",
]
