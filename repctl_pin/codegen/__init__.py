"""A repeatable control as C: for a robot's own loop, and compiled for Python's."""

from .compile import compiled as compiled
from .export import export_c as export_c
