"""Potentials h_i(q) and their gradients: the functions a repeatable control keeps constant."""

from .basis import CurvedPotentials, PotentialBasis, Potentials
from .custom import CustomPotentials
from .fourier import Fourier
from .joined import Joined
from .polynomial import Polynomial

__all__ = [
    "CurvedPotentials",
    "CustomPotentials",
    "Fourier",
    "Joined",
    "Polynomial",
    "PotentialBasis",
    "Potentials",
]
