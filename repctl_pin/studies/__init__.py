"""The main job: one arm, one closed path, every strategy side by side."""

from .study import study
from .study_result import Row, Study

__all__ = ["Row", "Study", "study"]
