"""The main job: one arm, one closed path, every strategy side by side."""

from .result import Row, Study
from .study import study

__all__ = ["Row", "Study", "study"]
