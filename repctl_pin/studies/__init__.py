"""The main job: one arm, one closed path, every strategy side by side."""

from .study import Row, Study, study

__all__ = ["Row", "Study", "study"]
