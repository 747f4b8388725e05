"""Potentials h(q), which a repeatable controller keeps constant, and their gradients.

A study uses polynomials only, so the other bases are not imported here.
"""

from .basis import CurvedPotentials, Joined, PotentialBasis, Potentials
from .polynomial import Polynomial

__all__ = [
    "CurvedPotentials",
    "Joined",
    "Polynomial",
    "PotentialBasis",
    "Potentials",
]
