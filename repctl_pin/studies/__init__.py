"""The main job: one arm, one closed path, every strategy side by side."""

from .study import study
from .study_result import Row, Study, bodies_dict, limits_dict, picked, region_dict

__all__ = ["Row", "Study", "bodies_dict", "limits_dict", "picked", "region_dict", "study"]
