"""Code generation: repeatable inverses and cell functions as C, exported or compiled for Python."""

from .compile import compiled as compiled
from .export import export_c as export_c
