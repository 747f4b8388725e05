"""Potentials h(q), which a repeatable controller keeps constant, and their gradients."""

from .basis import Joined, PotentialBasis
from .custom import CustomPotentials
from .fourier import Fourier
from .maps import CurvedPotentials, Potentials
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
