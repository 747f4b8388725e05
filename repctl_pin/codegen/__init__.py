"""A repeatable control as C: for a robot's own loop, and compiled for Python's."""

from .compile import compiled
from .export import export_c

__all__ = ["compiled", "export_c"]
