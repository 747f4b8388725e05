"""Potentials h_i(q) and their gradients: the functions a repeatable control keeps constant."""

from .field import Field, FieldMap
from .polynomial import Polynomial

__all__ = ["Field", "FieldMap", "Polynomial"]
