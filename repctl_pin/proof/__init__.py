"""Proved, not sampled: the leaf margin and the limits over whole boxes, tubes and cells, by branch
and bound."""

from ..certificate import Proof
from .certify import prove

__all__ = ["Proof", "prove"]
