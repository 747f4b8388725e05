"""Proved lower bounds on the leaf margin and the limit margin of a design.

They hold on its whole region or cell, not only at samples, and are found by branch and bound.
"""

from ..certificate import Proof
from .certify import prove

__all__ = ["Proof", "prove"]
