"""Potentials h_i(q) and their gradients: the functions a repeatable control keeps constant."""

from .custom import Potentials
from .field import CurvedMap, Field, FieldMap
from .fourier import Fourier
from .joined import Joined
from .polynomial import Polynomial

__all__ = ["CurvedMap", "Field", "FieldMap", "Fourier", "Joined", "Polynomial", "Potentials"]
