"""Potentials h(q), which a repeatable controller keeps constant, and their gradients.

The arm then stays on one leaf, the set h(q) = c. There, the configuration is a function of the pose
alone, so closed paths end in the configuration they began in. A study uses polynomials only, so the
other bases are not imported here.
"""

from .basis import CurvedPotentials, Joined, PotentialBasis, Potentials
from .polynomial import Polynomial

__all__ = ["CurvedPotentials", "Joined", "Polynomial", "PotentialBasis", "Potentials"]
