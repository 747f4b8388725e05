"""Recorded demonstrations: one configuration for each of their poses."""

from .recording import Recording
from .relabel import Relabeled, relabel

__all__ = ["Recording", "Relabeled", "relabel"]
