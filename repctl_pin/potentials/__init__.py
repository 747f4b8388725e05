"""Potentials h(q), which a repeatable controller keeps constant, and their gradients.

The arm then stays on one leaf, the set h(q) = c, as a function of the pose alone, so that closed
paths end where they began. A study uses polynomials only, so the other bases are not imported here.
"""

from .basis import CurvedPotentials, Joined, PotentialBasis, Potentials
from .polynomial import Polynomial

__all__ = ["CurvedPotentials", "Joined", "Polynomial", "PotentialBasis", "Potentials"]
